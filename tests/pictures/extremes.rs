//! Gaussians with extreme values, which break splat renderers.

use std::f64::consts::{FRAC_PI_4, PI};
use std::io::Write;

use crate::common::agree::{GREEN, RED, agrees, agrees_within, ahead, ball, logit, reference_of, render};
use crate::common::free::{Free, build};
use crate::common::{Gpu, ROUNDING, Random, again_in_subgroups_of_four, gaussians};
use glam::DQuat;
use smalto::formats;
use smalto::options::Options;
use smalto::render::{GpuScene, Renderer};
use smalto::rules::Background;
use smalto::scene::{self, Gaussians, MAX_SH_DEGREE, Raw, sh_coefficients};

#[test]
fn an_empty_scene_is_the_background() {
    let gpu = Gpu::new();
    let camera = ahead([40, 30], 30.0);
    let behind = gaussians(&[(ball([0.0, 0.0, -5.0], 1.0, 0.9), RED)]);
    let faint = gaussians(&[(ball([0.0, 0.0, 5.0], 1.0, 0.0039), RED)]);
    let aside = gaussians(&[(ball([500.0, 0.0, 5.0], 1.0, 0.9), RED)]);
    for (name, scene) in [("empty", gaussians(&[])), ("behind", behind), ("faint", faint), ("aside", aside)] {
        let scene = GpuScene::new(&gpu.0, &scene, &Options::EXACT).unwrap();
        let mut still = Renderer::new(&gpu.0, &Options::EXACT, &scene).unwrap();
        let background = [0.25, 0.5, 0.75];
        let frame = still.render(&camera, Background::Colour(background)).unwrap();
        assert_eq!(frame.totals.listed_kept, 0, "{name}");
        let [r, g, b] = background;
        assert!(still.pixels().unwrap().rgba.iter().all(|p| *p == [r, g, b, 0.0]), "{name}");
    }
}

/// A tilted splat, 1e8 px long and 3000 wide: the tilt is seen a thousand pixels from its mean.
#[test]
fn splats_whose_squared_length_overflows_keep_their_tilt() {
    let rotation = [(PI / 8.0).cos(), 0.0, 0.0, (PI / 8.0).sin()];
    let log_scale = [1e6, 7.5, 1e-3].map(f64::ln);
    let scene = gaussians(&[(Raw { mean: [0.0, 0.0, 5.0], log_scale, rotation, opacity_logit: 2.0 }, RED)]);
    agrees("tilt", &scene, &ahead([16, 2048], 2000.0));
}

#[test]
fn scales_from_zero_to_the_largest_float_agree() {
    for exponent in
        [f64::NEG_INFINITY, -87.0, -50.0, -30.0, -16.6, -8.0, 0.0, 8.0, 11.1, 17.0, 20.0, 44.4, 60.0, 88.0, 400.0]
    {
        for axes in [[exponent; 3], [exponent, -3.0, -3.0], [exponent, exponent, f64::NEG_INFINITY]] {
            let rotation = [0.9, 0.3, -0.2, 0.1];
            let raw = Raw { mean: [0.3, -0.2, 5.0], log_scale: axes, rotation, opacity_logit: logit(0.8) };
            let scene = gaussians(&[(raw, RED), (ball([0.0, 0.0, 6.0], 0.5, 0.9), GREEN)]);
            agrees(&format!("{axes:?}"), &scene, &ahead([64, 48], 50.0));
        }
    }
}

#[test]
fn opacities_around_the_threshold_agree() {
    let threshold = f64::from(1.0_f32 / 255.0);
    let over = f64::from((1.0_f32 / 255.0).next_up());
    for opacity in [threshold * 0.999, threshold, over, threshold * 1.0001, threshold * 1.01, 0.01, 0.5, 0.99, 0.9999] {
        // The mean on a pixel centre, and between four.
        for offset in [0.5, 0.0] {
            let mean = [offset / 100.0 * 5.0, offset / 100.0 * 5.0, 5.0];
            let scene = gaussians(&[(ball(mean, 0.05, opacity), RED)]);
            agrees(&format!("opacity {opacity}"), &scene, &ahead([32, 32], 100.0));
        }
    }
    let below = gaussians(&[(ball([0.0, 0.0, 5.0], 0.05, f64::from((1.0_f32 / 255.0).next_down())), RED)]);
    assert!(render(&below, &ahead([33, 33], 100.0)).rgba.iter().all(|p| *p == [0.0; 4]), "below is nothing at all");
}

#[test]
fn opacity_logits_of_any_size_agree() {
    let of = |opacity_logit| {
        let raw = Raw { opacity_logit, ..ball([0.0, 0.0, 5.0], 0.05, 0.5) };
        agrees("logit", &gaussians(&[(raw, RED)]), &ahead([33, 33], 100.0)).at(16, 16)[3]
    };
    for (logit, alpha) in [(f64::NEG_INFINITY, 0.0), (-1e30, 0.0), (-100.0, 0.0), (0.0, 0.5)] {
        assert_eq!(of(logit), alpha, "logit {logit}");
    }
    for logit in [100.0, 1e30, f64::INFINITY] {
        assert!((of(logit) - 0.99).abs() < 1e-6, "alpha is capped");
    }
}

#[test]
fn a_second_saturated_splat_is_left_out_as_in_the_original() {
    // (1 - 0.99f)^2 is just below 1e-4f in f32, so the original never adds the second.
    let opaque = |z| Raw { opacity_logit: f64::INFINITY, ..ball([0.0, 0.0, z], 10.0, 0.5) };
    let scene = gaussians(&[(opaque(5.0), RED), (opaque(6.0), GREEN), (opaque(7.0), GREEN)]);
    let pixels = agrees("saturated", &scene, &ahead([16, 16], 100.0));
    let middle = pixels.at(8, 8);
    assert!((middle[0] - 0.99).abs() < 1e-4 && middle[1] == 0.0, "{middle:?}");
}

#[test]
fn negative_and_bright_colours_agree() {
    let scene = gaussians(&[
        (ball([0.0, 0.0, 5.0], 0.3, 0.7), [-19.5, 0.2, 3000.0]),
        (ball([0.1, 0.0, 6.0], 0.5, 0.7), [1e4, -1e4, 0.5]),
    ]);
    let pixels = render(&scene, &ahead([48, 48], 50.0));
    let exact = reference_of(&scene, &ahead([48, 48], 50.0));
    for (pixel, exact) in pixels.rgba.iter().zip(&exact.pixels) {
        assert!(pixel.iter().all(|v| *v >= 0.0), "nothing is subtracted");
        for (value, expected) in pixel.iter().zip(exact.colour) {
            let allowed = exact.doubt + ROUNDING * expected.max(1.0);
            assert!((f64::from(*value) - expected).abs() <= allowed);
        }
    }
}

/// Needles across the image: half a pixel thin, up to `length` px long.
fn needles(length: f64, count: usize) -> Gaussians {
    let mut random = Random(length as u64);
    let focal = 200.0;
    let raws: Vec<_> = (0..count)
        .map(|i| {
            let depth = 5.0 + 0.01 * i as f64;
            let turn = DQuat::from_rotation_z(random.between(0.0, std::f64::consts::PI));
            let tilt = DQuat::from_rotation_y(random.between(-0.3, 0.3));
            let q = turn * tilt;
            let raw = Raw {
                mean: [random.between(-2.0, 2.0), random.between(-1.5, 1.5), depth],
                log_scale: [(length * depth / focal).ln(), -20.0, -9.0],
                rotation: [q.w, q.x, q.y, q.z],
                opacity_logit: logit(random.between(0.2, 0.95)),
            };
            (raw, [random.between(0.0, 1.0) as f32, 0.5, 0.2])
        })
        .collect();
    gaussians(&raws)
}

#[test]
fn needles_of_any_length_agree() {
    // Rounding moves a needle's weight in proportion to its length over its thickness (u |d| / sigma, u = 2^-24).
    for (length, tolerance) in
        [(2.0, 1e-4), (20.0, 1e-4), (200.0, 1e-4), (1500.0, 5e-4), (15_000.0, 4e-3), (150_000.0, 4e-2)]
    {
        let name = format!("needles of {length} px");
        let pixels = agrees_within(tolerance, &name, &needles(length, 40), &ahead([160, 120], 200.0));
        let drawn = pixels.rgba.iter().filter(|p| p[3] > 0.01).count();
        assert!(drawn > 1000, "{name} are there: {drawn} pixels");
    }
}

/// From a pixel long to three million, through pixel centres, at 45 degrees and at random.
#[test]
fn needles_of_a_million_to_one_agree() {
    let mut random = Random(8);
    let (focal, depth) = (200.0, 5.0);
    for width_px in [1e-6, 1e-3, 3.0] {
        let angles = [FRAC_PI_4, 3.0 * FRAC_PI_4].into_iter().chain((0..8).map(|_| random.between(0.0, PI)));
        let raws: Vec<_> = angles
            .enumerate()
            .map(|(i, angle)| {
                let width = width_px / focal * depth;
                let log_scale = [1e6 * width, width, width].map(f64::ln);
                let [x, y] = [20.5, -10.5].map(|px| px * i as f64 / 4.0 / focal * depth);
                let rotation = [(angle / 2.0).cos(), 0.0, 0.0, (angle / 2.0).sin()];
                (Raw { mean: [x, y, depth + 0.1 * i as f64], log_scale, rotation, opacity_logit: logit(0.6) }, RED)
            })
            .collect();
        agrees(&format!("{width_px} px wide"), &gaussians(&raws), &ahead([160, 120], focal));
    }
}

#[test]
fn quaternions_of_any_length_agree() {
    let unit = [0.8, 0.2, -0.4, 0.4];
    let lengths: [f32; 9] = [1.0, -1.0, 0.3, 1e-10, 1e-25, 1e-37, 1e-40, 1e20, 3e38];
    let raws: Vec<_> = lengths
        .iter()
        .enumerate()
        .map(|(i, length)| {
            // As a file holds them.
            let rotation = unit.map(|v| f64::from(v as f32 * length));
            let mean = [0.5 * i as f64 - 2.0, 0.0, 5.0];
            (Raw { mean, log_scale: [-1.5, -3.0, -5.0], rotation, opacity_logit: 2.0 }, RED)
        })
        .collect();
    let scene = gaussians(&raws);
    assert_eq!(scene.len(), lengths.len());
    for (rotation, length) in scene.rotations().iter().zip(lengths) {
        // 1e-40 is a float of sixteen bits.
        let tolerance = if length.is_normal() { 1e-6 } else { 2e-5 };
        let close = |i: usize| (rotation[i] - length.signum() * unit[i] as f32).abs() < tolerance;
        assert!((0..4).all(close), "length {length:e}: {rotation:?}");
    }
    agrees("quaternions", &scene, &ahead([160, 40], 150.0));
}

/// What a flush to zero of values below the normal floats may change is nothing that is seen.
#[test]
fn denormal_values_are_drawn_as_zero() {
    let with = |tiny: f64| {
        let thin = |x: f64, axes: [f64; 3]| Raw {
            mean: [x, tiny, 5.0 + tiny],
            log_scale: axes.map(f64::ln),
            rotation: [1.0, tiny, -tiny, 0.0],
            opacity_logit: 1.0,
        };
        let coefficients = |dc: f32| (0..16).map(|i| if i == 0 { [dc; 3] } else { [tiny as f32; 3] }).collect();
        let raws = [ball([tiny, -tiny, 6.0], 0.3, 0.7), thin(-0.5, [0.2, tiny, 0.1]), thin(0.5, [tiny; 3])];
        let all = raws.map(|raw| Free { raw, sh: coefficients(0.9) });
        build(&[&all[..], &[Free { raw: thin(0.2, [0.1; 3]), sh: coefficients(tiny as f32) }]].concat(), 3)
    };
    let camera = ahead([64, 48], 100.0);
    let zero = agrees("zero", &with(0.0), &camera);
    for tiny in [1e-45, 3e-41, 1e-38] {
        let pixels = agrees("denormal", &with(tiny), &camera);
        assert!(smalto::measure::metrics::max_error(&pixels, &zero) < 1e-6, "{tiny:e}");
    }
}

#[test]
fn harmonics_of_any_size_agree() {
    let mut random = Random(4);
    for largest in [20.0, 1e4, 9e35] {
        let all: Vec<Free> = (0..60)
            .map(|i| {
                let mean = [random.between(-1.5, 1.5), random.between(-1.0, 1.0), 4.0 + 0.05 * f64::from(i)];
                let raw = ball(mean, random.between(0.05, 0.4), random.between(0.1, 0.9));
                let mut coefficient = || std::array::from_fn(|_| random.between(-largest, largest) as f32);
                Free { raw, sh: (0..sh_coefficients(MAX_SH_DEGREE)).map(|_| coefficient()).collect() }
            })
            .collect();
        // A colour is at most 7.05 times the largest coefficient (the root of their number, 25, times the norm of the
        // basis, the root of 25 / 4 pi), rounded thirty times.
        let rounding = ROUNDING + 30.0 * 0.5_f64.powi(24) * 7.05 * largest;
        for degree in 0..=MAX_SH_DEGREE {
            let pixels = agrees_within(rounding, "harmonics", &build(&all, degree), &ahead([64, 48], 50.0));
            assert!(pixels.rgba.iter().flatten().all(|v| *v >= 0.0), "nothing is subtracted");
        }
    }
}

const NAMES: [&str; 14] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2",
    "rot_3",
];

/// The scene that a PLY file with these rows is read as.
fn read_ply(rows: &[[f32; 14]]) -> scene::Scene {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    let properties: String = NAMES.iter().map(|name| format!("property float {name}\n")).collect();
    let count = rows.len();
    write!(file, "ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{properties}end_header\n").unwrap();
    file.write_all(bytemuck::cast_slice(rows)).unwrap();
    formats::read(file.path()).unwrap()
}

#[test]
fn gaussians_that_are_not_finite_are_dropped_and_counted() {
    let good = |i: usize| [0.1 * i as f32, 0.2, 5.0, 0.5, -0.3, 0.2, 1.0, -1.0, -2.0, -1.5, 0.9, 0.1, 0.2, -0.3];
    let rows: Vec<[f32; 14]> = (0..50).map(good).collect();
    let clean = read_ply(&rows);
    let mut damaged = rows.clone();
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for (i, name) in NAMES.iter().enumerate() {
            // An infinite logit is an opacity of 0 or 1, the logarithm of a flat Gaussian's scale is minus infinity.
            let is_legal = match *name {
                "opacity" => value.is_infinite(),
                name if name.starts_with("scale") => value == f32::NEG_INFINITY,
                _ => false,
            };
            if !is_legal {
                let mut row = good(i);
                row[i] = value;
                damaged.insert(3 * i, row);
            }
        }
    }
    let bad = damaged.len() - rows.len();
    assert_eq!(bad, 3 * NAMES.len() - 2 - 3);
    let mut without_direction = good(0);
    without_direction[10..].fill(0.0);
    damaged.push(without_direction);
    let mut transparent = good(0);
    transparent[6] = f32::NEG_INFINITY;
    damaged.push(transparent);
    let read = read_ply(&damaged);
    assert_eq!(read.gaussians, clean.gaussians, "what is left is drawn as if the rest had never been");
    let report = read.report;
    assert_eq!((report.read, report.not_finite, report.zero_rotation, report.transparent), (52 + bad, bad, 1, 1));
}

#[test]
fn numbers_agree_in_subgroups_of_four() {
    again_in_subgroups_of_four(&["extremes::", "--skip", "subgroups_of_four"]);
}
