//! What breaks splat renderers: scenes and cameras at the edge of the numbers.

mod common;

use std::f64::consts::PI;

use common::{Gpu, ROUNDING, Random, again_in_subgroups_of_four, compare, gaussians};
use glam::{DQuat, DVec3, dvec2};
use smalto::camera::Camera;
use smalto::memory::OutOfMemory;
use smalto::options::{Background, Options};
use smalto::pixels::Pixels;
use smalto::reference;
use smalto::render::{Demand, GpuScene, Still, Workspace};
use smalto::scene::{Gaussians, Raw, synthetic};

/// Looks along z from the origin; `focal` px.
fn ahead(size: [u32; 2], focal: f64) -> Camera {
    let mut camera = Camera::looking_at(DVec3::ZERO, DVec3::Z, size, 1.0);
    camera.focal_px = dvec2(focal, focal);
    camera
}

/// A round Gaussian.
fn ball(mean: [f64; 3], scale: f64, opacity: f64) -> Raw {
    Raw { mean, log_scale: [scale.ln(); 3], rotation: [1.0, 0.0, 0.0, 0.0], opacity_logit: logit(opacity) }
}

fn logit(opacity: f64) -> f64 {
    (opacity / (1.0 - opacity)).ln()
}

fn render(scene: &Gaussians, camera: &Camera) -> Pixels {
    let gpu = Gpu::new();
    let pixels = gpu.render(scene, camera, &Options::EXACT);
    let portable = gpu.render(scene, camera, &Options { portable: true, ..Options::EXACT });
    assert!(pixels == portable, "the portable path draws the same bits");
    assert!(pixels.rgba.iter().flatten().all(|v| v.is_finite()), "every pixel is finite");
    assert!(pixels.rgba.iter().all(|p| (0.0..=1.0).contains(&p[3])), "coverage is a fraction");
    pixels
}

/// Renders on the GPU and holds it to the reference: rounding, and what is in doubt.
fn agrees(name: &str, scene: &Gaussians, camera: &Camera) -> Pixels {
    let pixels = render(scene, camera);
    let rendering = reference::render(scene, camera, &Options::EXACT.rules, Background::BLACK);
    let comparison = compare(&pixels, &rendering);
    assert_eq!(comparison.unexplained, 0, "{name}: {comparison:?}");
    pixels
}

const RED: [f32; 3] = [1.0, 0.0, 0.0];
const GREEN: [f32; 3] = [0.0, 1.0, 0.0];

#[test]
fn nothing_to_draw_is_the_background() {
    let gpu = Gpu::new();
    let camera = ahead([40, 30], 30.0);
    let behind = gaussians(&[(ball([0.0, 0.0, -5.0], 1.0, 0.9), RED)]);
    let faint = gaussians(&[(ball([0.0, 0.0, 5.0], 1.0, 0.0039), RED)]);
    let aside = gaussians(&[(ball([500.0, 0.0, 5.0], 1.0, 0.9), RED)]);
    for (name, scene) in [("empty", gaussians(&[])), ("behind", behind), ("faint", faint), ("aside", aside)] {
        let scene = GpuScene::new(&gpu.0, &scene, &Options::EXACT).unwrap();
        let mut still = Still::new(&gpu.0, &Options::EXACT, &scene).unwrap();
        let background = [0.25, 0.5, 0.75];
        let frame = still.render(&camera, Background::Colour(background)).unwrap();
        assert_eq!(frame.totals.instances_kept, 0, "{name}");
        let [r, g, b] = background;
        assert!(still.pixels().unwrap().rgba.iter().all(|p| *p == [r, g, b, 0.0]), "{name}");
    }
}

#[test]
fn images_of_any_shape_agree() {
    let scene = synthetic::cactus(3000).unwrap().gaussians;
    let camera = |size| Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), size, 0.9);
    for size in [[1, 1], [2, 1], [1, 3], [15, 16], [16, 16], [17, 13], [31, 33], [100, 1], [1, 100], [257, 129]] {
        agrees(&format!("{size:?}"), &scene, &camera(size));
    }
}

#[test]
fn images_as_wide_or_high_as_images_get_agree() {
    let mut random = Random(5);
    let raws: Vec<_> = (0..200)
        .map(|_| {
            let mean = [random.between(-8.0, 8.0), random.between(-8.0, 8.0), random.between(5.0, 15.0)];
            (ball(mean, random.between(0.01, 3.0), random.between(0.1, 0.9)), RED)
        })
        .collect();
    let scene = gaussians(&raws);
    agrees("wide", &scene, &ahead([16384, 3], 10_000.0));
    agrees("high", &scene, &ahead([3, 16384], 10_000.0));
}

#[test]
fn more_than_65535_tiles_agree() {
    let raws = [
        (ball([0.0, 0.0, 5.0], 0.4, 0.9), RED),
        (ball([-4.0, -4.0, 6.0], 0.01, 0.9), GREEN),
        (ball([5.9, 5.9, 6.0], 0.1, 0.99), GREEN),
        (ball([0.0, 0.0, 9.0], 50.0, 0.1), RED),
    ];
    // 257 x 257 tiles: their numbers need 17 bits, the blend more than 65,535 workgroups.
    let pixels = agrees("tiles", &gaussians(&raws), &ahead([4097, 4097], 2048.0));
    assert!(pixels.at(4062, 4062)[1] > 0.5, "the last rows of tiles are drawn");
}

#[test]
fn the_near_plane_is_exact() {
    let near = Options::EXACT.rules.near;
    let (below, above) = (near.next_down(), near.next_up());
    for (z, is_drawn) in [(below, false), (near, false), (above, true), (-near, false), (0.0, false)] {
        let scene = gaussians(&[(ball([0.0, 0.0, z.into()], 0.001, 0.9), RED)]);
        let pixels = agrees("near", &scene, &ahead([33, 33], 30.0));
        assert_eq!(pixels.at(16, 16)[0] > 0.5, is_drawn, "at depth {z:e}");
    }
}

#[test]
fn a_camera_inside_large_splats_agrees() {
    let scene = gaussians(&[
        (ball([0.1, 0.0, 0.3], 5.0, 0.5), RED),
        (ball([0.0, 0.0, 1.0], 1e4, 0.3), GREEN),
        (ball([0.0, 0.1, 4.0], 0.5, 0.9), RED),
    ]);
    agrees("inside", &scene, &ahead([120, 90], 100.0));
}

/// A tilted splat, 1e8 px long and 3000 wide: the tilt is seen a thousand pixels from its mean.
#[test]
fn a_splat_longer_than_its_squares_can_be_keeps_its_tilt() {
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
    for opacity in [threshold * 0.999, threshold, threshold * 1.0001, threshold * 1.01, 0.01, 0.5, 0.99, 0.9999] {
        // The mean on a pixel centre, and between four.
        for offset in [0.5, 0.0] {
            let mean = [offset / 100.0 * 5.0, offset / 100.0 * 5.0, 5.0];
            let scene = gaussians(&[(ball(mean, 0.05, opacity), RED)]);
            agrees(&format!("opacity {opacity}"), &scene, &ahead([32, 32], 100.0));
        }
    }
    let opaque = Raw { opacity_logit: f64::INFINITY, ..ball([0.0, 0.0, 5.0], 0.05, 0.5) };
    let pixels = agrees("opaque", &gaussians(&[(opaque, RED)]), &ahead([33, 33], 100.0));
    assert!((pixels.at(16, 16)[3] - 0.99).abs() < 1e-6, "alpha is capped");
}

#[test]
fn two_saturated_splats_leave_out_the_second_as_the_original_does() {
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
    let exact = reference::render(&scene, &ahead([48, 48], 50.0), &Options::EXACT.rules, Background::BLACK);
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
        let (scene, camera) = (needles(length, 40), ahead([160, 120], 200.0));
        let pixels = render(&scene, &camera);
        let exact = reference::render(&scene, &camera, &Options::EXACT.rules, Background::BLACK);
        let mut wrong = 0;
        for (pixel, exact) in pixels.rgba.iter().zip(&exact.pixels) {
            let error = (0..3).map(|i| (f64::from(pixel[i]) - exact.colour[i]).abs()).fold(0.0, f64::max);
            wrong += usize::from(error > tolerance + exact.doubt);
        }
        assert_eq!(wrong, 0, "needles of {length} px");
        let drawn = pixels.rgba.iter().filter(|p| p[3] > 0.01).count();
        assert!(drawn > 1000, "needles of {length} px are there: {drawn} pixels");
    }
}

#[test]
fn wide_fields_of_view_stay_finite() {
    let scene = synthetic::cactus(2000).unwrap().gaussians;
    for degrees in [120.0_f64, 170.0, 179.0, 179.9] {
        let target = DVec3::new(0.0, -1.2, 0.0);
        let camera = Camera::looking_at(DVec3::new(0.5, -1.5, -1.0), target, [96, 64], degrees.to_radians());
        render(&scene, &camera);
    }
}

#[test]
fn narrow_fields_of_view_agree() {
    // Focal length 1e6 px: a hundredth of a degree. f32 places the mean to about a tenth of a pixel there.
    let scene = gaussians(&[(ball([0.0, 0.0, 100.0], 0.001, 0.9), RED), (ball([1e-4, 0.0, 120.0], 0.002, 0.5), GREEN)]);
    let camera = ahead([65, 65], 1e6);
    let pixels = render(&scene, &camera);
    let exact = reference::render(&scene, &camera, &Options::EXACT.rules, Background::BLACK).to_pixels();
    assert!(smalto::metrics::psnr(&pixels, &exact) > 40.0);
}

#[test]
fn a_scene_far_from_the_origin_looks_the_same() {
    let local = synthetic::cactus(3000).unwrap().gaussians;
    let eye = DVec3::new(1.5, -2.5, -4.0);
    let target = DVec3::new(0.0, -1.2, 0.0);
    for offset in [1e2, 1e4, 1e6] {
        // Means as 32-bit floats hold them there: that loss is the file's, not the renderer's.
        let shift = DVec3::new(offset, -offset / 3.0, offset / 7.0);
        let raws: Vec<_> = (0..local.len())
            .map(|i| {
                let mean = DVec3::from(local.means()[i].map(f64::from)) + shift;
                let raw = Raw {
                    mean: mean.to_array(),
                    log_scale: local.scales()[i].map(|s| f64::from(s).ln()),
                    rotation: local.rotations()[i].map(f64::from),
                    opacity_logit: logit(local.opacities()[i].min(0.999).into()),
                };
                (raw, [0.2, 0.6, 0.3])
            })
            .collect();
        let camera = Camera::looking_at(eye + shift, target + shift, [128, 96], 0.9);
        agrees(&format!("offset {offset}"), &gaussians(&raws), &camera);
    }
}

#[test]
fn depths_over_nine_orders_of_magnitude_are_in_order() {
    let mut raws = vec![(ball([0.0, 0.0, 1e6], 3e4, 0.9), GREEN)];
    for power in -2..6 {
        let z = 0.3 * 10_f64.powi(power) + 0.2;
        raws.push((ball([0.0, 0.0, z * (1.0 + 1e-6)], 0.05 * z, 0.3), [0.0, 0.0, 1.0]));
        raws.push((ball([0.0, 0.0, z], 0.05 * z, 0.3), RED));
    }
    agrees("depths", &gaussians(&raws), &ahead([64, 64], 100.0));
}

#[test]
fn equal_depths_keep_the_order_of_the_file_in_every_run() {
    let mut random = Random(3);
    // 4,000 splats on 3 depths.
    let raws: Vec<_> = (0..4000)
        .map(|i| {
            let mean = [random.between(-2.0, 2.0), random.between(-2.0, 2.0), 4.0 + f64::from(i % 3)];
            (
                ball(mean, 0.1, random.between(0.05, 0.9)),
                [random.between(0.0, 1.0) as f32, random.between(0.0, 1.0) as f32, 0.5],
            )
        })
        .collect();
    let (scene, camera) = (gaussians(&raws), ahead([96, 96], 100.0));
    let first = agrees("ties", &scene, &camera);
    let gpu = Gpu::new();
    let scene = GpuScene::new(&gpu.0, &scene, &Options::EXACT).unwrap();
    let mut still = Still::new(&gpu.0, &Options::EXACT, &scene).unwrap();
    for run in 0..30 {
        still.render(&camera, Background::BLACK).unwrap();
        assert!(still.pixels().unwrap() == first, "run {run} draws the same bits");
    }
}

#[test]
fn means_on_tile_borders_and_pixel_centres_agree() {
    let mut raws = Vec::new();
    for px in [-16.0, -0.5, 0.0, 0.5, 15.5, 16.0, 16.5, 31.5, 32.0, 47.5, 48.0, 48.5] {
        for py in [0.0, 15.5, 16.0, 24.5, 32.0, 48.0] {
            let at = |p: f64| (p - 24.0) / 100.0 * 5.0;
            raws.push((ball([at(px), at(py), 5.0 + 0.01 * raws.len() as f64], 0.02, 0.8), RED));
        }
    }
    agrees("borders", &gaussians(&raws), &ahead([48, 48], 100.0));
}

#[test]
fn thousands_of_faint_layers_agree() {
    let raws: Vec<_> =
        (0..5000).map(|i| (ball([0.0, 0.0, 5.0 + 0.001 * f64::from(i)], 20.0, 1.2 / 255.0), RED)).collect();
    agrees("layers", &gaussians(&raws), &ahead([40, 40], 50.0));
}

/// More entries in one tile than llvmpipe lets a loop run: all must count.
#[test]
fn a_tile_list_longer_than_65535_is_drawn_to_its_end() {
    // Most cover one corner; a faint one now and then covers the tile, so that each missing stretch is seen.
    let entry = |i: u32| {
        let z = 5.0 + 1e-5 * f64::from(i);
        if i % 400 == 399 {
            (ball([0.1, 0.1, z], 0.2, 0.02), GREEN)
        } else {
            (ball([-0.35, -0.35, z], 0.002, 0.5), RED)
        }
    };
    let mut raws: Vec<_> = (0..70_000).map(entry).collect();
    raws.push((ball([0.1, 0.1, 8.0], 0.2, 0.95), GREEN));
    let scene = gaussians(&raws);
    let camera = ahead([16, 16], 100.0);
    let gpu = Gpu::new();
    for portable in [false, true] {
        let options = Options { portable, ..Options::EXACT };
        let gpu_scene = GpuScene::new(&gpu.0, &scene, &Options::EXACT).unwrap();
        let mut still = Still::new(&gpu.0, &options, &gpu_scene).unwrap();
        let frame = still.render(&camera, Background::BLACK).unwrap();
        assert!(frame.totals.longest_list > 65_535, "the list is long: {}", frame.totals.longest_list);
        let rendering = reference::render(&scene, &camera, &options.rules, Background::BLACK);
        let pixels = still.pixels().unwrap();
        assert_eq!(compare(&pixels, &rendering).unexplained, 0);
        assert!(pixels.at(10, 10)[1] > 0.9, "the last splat shows: {:?}", pixels.at(10, 10));
    }
}

#[test]
fn long_lists_agree_in_subgroups_of_four() {
    again_in_subgroups_of_four(&["a_tile_list_longer_than_65535_is_drawn_to_its_end"]);
}

#[test]
fn what_does_not_fit_grows_and_is_rendered_again() {
    let gpu = Gpu::new();
    let scene = synthetic::cactus(5000).unwrap().gaussians;
    let camera = Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), [160, 120], 0.9);
    let gpu_scene = GpuScene::new(&gpu.0, &scene, &Options::EXACT).unwrap();
    let roomy = gpu.render(&scene, &camera, &Options::EXACT);
    let enough = Demand::guess(&gpu.0, 5000, 80);
    for (name, room) in [
        ("visible", Demand { visible: 10, ..enough }),
        ("spans", Demand { spans: 10, ..enough }),
        ("instances", Demand { instances: 10, ..enough }),
        ("all", Demand { visible: 1, spans: 1, instances: 1, ..enough }),
        ("nothing", Demand::default()),
    ] {
        let still = Still::new(&gpu.0, &Options::EXACT, &gpu_scene).unwrap();
        let mut still = still.with_room(room).unwrap();
        let frame = still.render(&camera, Background::BLACK).unwrap();
        assert!(frame.attempts > 1, "{name}: did not fit at first");
        assert!(still.pixels().unwrap() == roomy, "{name}: the picture is complete");
        assert_eq!(still.render(&camera, Background::BLACK).unwrap().attempts, 1, "{name}: the room stays");
    }
}

/// Where the spare room is over a limit of the device, the room that is needed is enough.
#[test]
fn what_fits_exactly_is_not_refused() {
    let gpu = Gpu::new();
    let most = gpu.0.facts().limits.storage_range.min(128 << 20) / 36;
    let mut work = Workspace::new(&gpu.0, Demand::default()).unwrap();
    let demand = Demand { gaussians: 1 << 23, visible: most, ..Demand::default() };
    assert!(work.grow(&gpu.0, demand).unwrap());
    assert!(!work.grow(&gpu.0, demand).unwrap());
}

/// 2^32 instances and more: counted in 64 bits, and refused with the bytes it would take.
#[test]
fn more_instances_than_32_bits_count_are_refused() {
    let gpu = Gpu::new();
    // Each covers 128 x 128 tiles.
    let count = (1_u64 << 32) / (128 * 128) + 1;
    let raws: Vec<_> = (0..count).map(|i| (ball([0.0, 0.0, 5.0 + 1e-4 * i as f64], 1e3, 0.5), RED)).collect();
    let scene = GpuScene::new(&gpu.0, &gaussians(&raws), &Options::EXACT).unwrap();
    let mut still = Still::new(&gpu.0, &Options::EXACT, &scene).unwrap();
    let error = still.render(&ahead([2048, 2048], 1000.0), Background::BLACK).unwrap_err();
    assert!(error.is::<OutOfMemory>(), "{error:#}");
    assert!(error.to_string().contains("instance"), "{error:#}");
}

#[test]
fn random_splats_from_the_whole_range_stay_finite_and_convex() {
    let mut random = Random(17);
    for round in 0..12 {
        let mut raws = Vec::new();
        for _ in 0..300 {
            let z = 10_f64.powf(random.between(-2.0, 6.0));
            let mean = [z * random.between(-2.0, 2.0), z * random.between(-2.0, 2.0), z - 0.1];
            let log_scale = std::array::from_fn(|_| random.between(-18.0, 18.0));
            let length = 10_f64.powf(random.between(-20.0, 20.0));
            let rotation = std::array::from_fn(|_| length * random.between(-1.0, 1.0));
            let opacity_logit = random.between(-10.0, 10.0) * if random.below(10) == 0 { 10.0 } else { 1.0 };
            raws.push((
                Raw { mean, log_scale, rotation, opacity_logit },
                std::array::from_fn(|_| random.between(0.1, 0.9) as f32),
            ));
        }
        let scene = gaussians(&raws);
        let pixels = render(&scene, &ahead([80, 60], 60.0));
        for pixel in &pixels.rgba {
            // Colours between 0.1 and 0.9, over black.
            let coverage = pixel[3];
            assert!(
                pixel[..3].iter().all(|c| *c <= 0.9 * coverage + 1e-5 && *c >= 0.1 * coverage - 1e-5),
                "round {round}: {pixel:?}"
            );
        }
    }
}
