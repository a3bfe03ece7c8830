//! The rules of the picture: with each, the GPU agrees with the reference, and not with the reference of other rules.

use crate::common::agree::{GREEN, RED, agrees_by, ahead, ball};
use crate::common::cloud::{camera, cloud};
use crate::common::free::{Free, build};
use crate::common::{Comparison, Gpu, ROUNDING, Random, compare, gaussians};
use glam::DVec3;
use smalto::camera::Camera;
use smalto::measure::metrics::max_error;
use smalto::options::Options;
use smalto::packing::Statistics;
use smalto::pixels::Pixels;
use smalto::reference::{self, Rendering};
use smalto::render::{GpuScene, Renderer};
use smalto::rules::{Background, Footprint, Order, Rules, TILE};
use smalto::scene::{Gaussians, Raw};

/// dB of a picture in which one splat's row or column of tiles is cut elsewhere: a square ends where a radius is
/// rounded up and a border down, both of which f32 may decide the other way. None does on lavapipe.
const SQUARES_PSNR: f64 = 50.0;
/// Pixels of two tiles, for the same reason.
const SQUARES_PIXELS: usize = 2 * (TILE * TILE) as usize;
/// A rule shows where a pixel differs by so much: ten times what rounding is allowed.
const SHOWS: f32 = 10.0 * ROUNDING as f32;

/// The random cloud, Gaussians far below a pixel, and some before the near plane of training.
fn scene() -> Gaussians {
    let mut random = Random(3);
    let mut all = cloud(&mut random, 600, 1, 0.3);
    for small in cloud(&mut random, 300, 1, 0.3) {
        let raw = Raw { log_scale: small.raw.log_scale.map(|s| s - 3.0), ..small.raw };
        all.push(Free { raw, sh: small.sh });
    }
    for near in cloud(&mut random, 30, 1, 0.3) {
        let by = 0.1 / near.raw.mean[2];
        let log_scale = near.raw.log_scale.map(|s| s + by.ln() - 1.0);
        all.push(Free { raw: Raw { mean: near.raw.mean.map(|v| v * by), log_scale, ..near.raw }, sh: near.sh });
    }
    build(&all, 1)
}

fn rules() -> Vec<(&'static str, Rules)> {
    let trained = Rules::TRAINED;
    vec![
        ("distance", Rules { order: Order::Distance, ..trained }),
        ("three sigma", Rules { extent: Footprint::ThreeSigma, ..trained }),
        ("squares", Rules { extent: Footprint::ThreeSigmaSquares, ..trained }),
        ("alpha 1/64", Rules { alpha_min: 1.0 / 64.0, ..trained }),
        ("alpha 1/1024", Rules { alpha_min: 1.0 / 1024.0, ..trained }),
        ("cap 0.9", Rules { alpha_max: 0.9, ..trained }),
        ("stop at 0.05", Rules { transmittance_min: 0.05, ..trained }),
        ("antialiased", Rules { antialiased: true, ..trained }),
        ("features", Rules { features: true, ..trained }),
        ("near 0.05", Rules { near: 0.05, ..trained }),
        ("near 2", Rules { near: 2.0, ..trained }),
        ("inria", Rules::INRIA),
        ("gsplat", Rules::GSPLAT),
        ("khr", Rules::KHR),
    ]
}

fn reference_by(rules: &Rules, scene: &Gaussians) -> Rendering {
    reference::render(scene, &camera(), rules, Background::BLACK)
}

fn assert_agrees(name: &str, rules: &Rules, found: &Comparison) {
    match rules.extent {
        Footprint::ThreeSigmaSquares => {
            assert!(found.unexplained <= SQUARES_PIXELS && found.psnr > SQUARES_PSNR, "{name}: {found:?}");
        }
        _ => assert_eq!(found.unexplained, 0, "{name}: {found:?}"),
    }
}

#[test]
fn the_gpu_follows_every_rule() {
    let gpu = Gpu::new();
    let scene = scene();
    let trained = reference_by(&Rules::TRAINED, &scene);
    for (name, rules) in rules() {
        let exact = reference_by(&rules, &scene);
        let pixels = gpu.render(&scene, &camera(), &Options { rules, ..Options::EXACT });
        let found = compare(&pixels, &exact);
        println!("{name}: {found:?}");
        assert_agrees(name, &rules, &found);
        let shows = max_error(&exact.to_pixels(), &trained.to_pixels());
        assert!(shows > SHOWS, "{name} does not show in this scene: {shows}");
        assert!(compare(&pixels, &trained).unexplained > 0, "{name}: the comparison sees another rule");
    }
}

#[test]
fn presets_draw_by_their_rules_on_every_path() {
    let gpu = Gpu::new();
    let scene = scene();
    for (name, options) in Options::PRESETS {
        let [pixels, portable] =
            [options.portable, true].map(|portable| gpu.render(&scene, &camera(), &Options { portable, ..options }));
        if options.stop == 0.0 {
            let exact = reference_by(&options.rules, &scene);
            for pixels in [&pixels, &portable] {
                assert_agrees(name, &options.rules, &compare(pixels, &exact));
            }
        } else {
            // A pixel may go on a few splats longer on the fast path.
            let error = f64::from(max_error(&pixels, &portable));
            assert!(error <= 2.0 * f64::from(options.stop), "{name}: {error}");
        }
    }
}

#[test]
fn complete_and_trained_pictures_differ_by_less_than_the_certificate() {
    let gpu = Gpu::new();
    let scene = scene();
    let (trained, complete) = (Rules::TRAINED, Rules::TRAINED.complete());
    let [trained, complete] = [trained, complete].map(|rules| reference_by(&rules, &scene));
    let gpu_scene = GpuScene::certifiable(&gpu.0, &scene, &Statistics::of(&scene), &Options::EXACT).unwrap();
    let mut still = Renderer::certified(&gpu.0, &Options::EXACT, &gpu_scene).unwrap();
    still.render(&camera(), Background::BLACK).unwrap();
    let certificate = still.certificate().unwrap().unwrap();
    let (mut largest, mut closest) = (0.0_f64, 0.0_f64);
    for ((a, b), bound) in trained.pixels.iter().zip(&complete.pixels).zip(&certificate.rgba) {
        let apart = (0..3).map(|i| (a.colour[i] - b.colour[i]).abs()).fold(0.0, f64::max);
        let bound = f64::from(bound[0]);
        assert!(apart <= bound + ROUNDING + a.doubt, "{apart:e} passes {bound:e}");
        largest = largest.max(apart);
        closest = closest.max(apart / bound.max(1e-3));
    }
    assert!(largest > 5e-3, "the rules leave something out: {largest}");
    assert!(closest > 0.2, "the certificate is not loose: {closest}");
}

/// Discs that cross at the middle of the image: red comes nearer on the left, green on the right.
fn crossing() -> Gaussians {
    let disc = |turn: f64| Raw {
        mean: [0.0, 0.0, 4.0],
        log_scale: [0.0, 0.0, 1e-3_f64.ln()],
        rotation: [(turn / 2.0).cos(), 0.0, (turn / 2.0).sin(), 0.0],
        opacity_logit: 4.0,
    };
    gaussians(&[(disc(-0.8), RED), (disc(0.8), GREEN)])
}

#[test]
fn crossing_discs_are_sorted_in_every_pixel() {
    let camera = ahead([64, 48], 60.0);
    let picture = |order: Order| {
        let rules = Rules { order, ..Rules::TRAINED };
        reference::render(&crossing(), &camera, &rules, Background::BLACK).to_pixels()
    };
    let is_red = |pixels: &Pixels, x: usize| pixels.rgba[24 * 64 + x][0] > 2.0 * pixels.rgba[24 * 64 + x][1];
    let sides = |pixels: &Pixels| [22, 41].map(|x| is_red(pixels, x));
    assert_eq!(sides(&picture(Order::PerPixel)), [true, false]);
    assert_eq!(sides(&picture(Order::Depth)), [true, true], "one of two equal depths is in front everywhere");
}

#[test]
fn separate_balls_need_no_sort_per_pixel() {
    let mut random = Random(5);
    let balls: Vec<_> = (0..60)
        .map(|i| {
            let mean = [random.between(-1.0, 1.0), random.between(-0.7, 0.7), 2.0 + f64::from(i)];
            (ball(mean, 0.1, random.between(0.1, 0.9)), [random.between(0.0, 1.0) as f32; 3])
        })
        .collect();
    let scene = gaussians(&balls);
    let [by_depth, per_pixel] =
        [Order::Depth, Order::PerPixel].map(|order| reference_by(&Rules { order, ..Rules::TRAINED }, &scene));
    assert!(by_depth.pixels == per_pixel.pixels);
    assert!(by_depth.pixels.iter().any(|p| p.transmittance < 0.5));
}

#[test]
fn sorting_per_pixel_is_refused_on_the_gpu() {
    let gpu = Gpu::new();
    let options = Options { rules: Rules { order: Order::PerPixel, ..Rules::TRAINED }, ..Options::EXACT };
    let scene = GpuScene::new(&gpu.0, &crossing(), &options).unwrap();
    let error = Renderer::new(&gpu.0, &options, &scene).err().expect("it is refused");
    assert_eq!(error.to_string(), "only the reference sorts the splats of every pixel on its own");
}

/// Distances stay as the camera turns; depths do not.
#[test]
fn the_order_by_distance_stays_as_the_camera_turns() {
    let gpu = Gpu::new();
    let scene = gaussians(&[(ball([0.0, 0.0, 3.0], 0.6, 0.95), RED), (ball([0.35, 0.0, 3.02], 0.6, 0.95), GREEN)]);
    let red_is_in_front = |turn: f64, order: Order| {
        let camera = Camera::looking_at(DVec3::ZERO, DVec3::new(turn.sin(), 0.0, turn.cos()), [64, 64], 1.2);
        let rules = Rules { order, ..Rules::TRAINED };
        let pixels = gpu.render(&scene, &camera, &Options { rules, ..Options::EXACT });
        let between = camera.view(DVec3::new(0.17, 0.0, 3.0));
        let x = (camera.focal_px.x * between.x / between.z + camera.centre_px.x) as usize;
        let [red, green, ..] = pixels.rgba[32 * 64 + x];
        red > green
    };
    assert_eq!([-0.4, 0.4].map(|turn| red_is_in_front(turn, Order::Distance)), [true, true]);
    assert_eq!([-0.4, 0.4].map(|turn| red_is_in_front(turn, Order::Depth)), [false, true]);
}

/// Without a clamp an alpha may be 1: the splat that makes a pixel opaque is drawn, whatever lies in front of it.
#[test]
fn a_splat_of_alpha_one_is_drawn_and_hides_all_behind_it() {
    // Whether a product of roundings is above 1 depends on the threshold. Each number of layers is drawn with three of
    // the thresholds.
    let thresholds = [1.0 / 255.0, 1.0 / 192.0, 1.0 / 100.0, 1e-3, 1e-4, 1e-5, 3e-6, 1e-6];
    for (layers, alpha_min) in (0..8_u8).flat_map(|i| [0, 1, 4].map(|k| (i, thresholds[usize::from(i + k) % 8]))) {
        let rules = Rules { alpha_min, alpha_max: 1.0, transmittance_min: 0.0, ..Rules::TRAINED };
        let options = Options { rules, ..Options::EXACT };
        let faint = (0..layers).map(|i| (ball([0.0, 0.0, 2.0 + 0.01 * f64::from(i)], 3.0, 0.07), GREEN));
        // Its opacity is 1 in f32, its mean on the centre of the middle pixel.
        let opaque = (ball([0.0, 0.0, 4.0], 1.0, 1.0 - 1e-9), RED);
        let behind = (ball([0.0, 0.0, 5.0], 3.0, 0.9), [0.0, 0.0, 1.0]);
        let scene = gaussians(&faint.chain([opaque, behind]).collect::<Vec<_>>());
        let picture = agrees_by(&options, "alpha 1", &scene, &ahead([9, 9], 20.0));
        let [red, _, blue, alpha] = picture.rgba[4 * 9 + 4];
        let all = [red, blue, alpha];
        assert!(red > 0.4 && blue < 2e-6 && alpha > 1.0 - 2e-6, "{layers} layers, {alpha_min}: {all:?}");
    }
}
