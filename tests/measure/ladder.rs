//! The rungs of the ladder, and the counts of a frame, against the CPU.

use crate::common::{Gpu, Random, gaussians};
use glam::DVec3;
use smalto::camera::Camera;
use smalto::measure::ladder::{RUNGS, Rung, Variant, VariantFrame};
use smalto::options::Options;
use smalto::pixels::Pixels;
use smalto::procedural::cactus;
use smalto::reference::{self, Splat, Tiling};
use smalto::render::{GpuScene, Renderer, Totals};
use smalto::rules::{Background, Rules, TILE};
use smalto::scene::{Gaussians, Raw};

fn camera(size: [u32; 2]) -> Camera {
    Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), size, 0.9)
}

fn draw(gpu: &Gpu, rung: &Rung, scene: &Gaussians, cameras: &[Camera]) -> (VariantFrame, Pixels) {
    let scene = GpuScene::new(&gpu.0, scene, &Options::EXACT).unwrap();
    let mut variant = Variant::new(&gpu.0, rung, &Options::EXACT, &scene).unwrap();
    let frames = cameras.iter().map(|camera| variant.render(camera).unwrap());
    (frames.last().unwrap(), variant.pixels().unwrap())
}

#[test]
fn the_last_rung_is_the_frame_of_the_portable_path() {
    let gpu = Gpu::new();
    let (scene, camera) = (cactus(4000).unwrap().gaussians, camera([150, 90]));
    let last = draw(&gpu, &RUNGS[RUNGS.len() - 1], &scene, std::slice::from_ref(&camera));
    assert!(last.1 == gpu.render(&scene, &camera, &Options { portable: true, ..Options::EXACT }));
}

#[test]
fn rungs_with_equal_tiles_agree_bit_for_bit_even_after_growth() {
    let gpu = Gpu::new();
    let scene = cactus(3000).unwrap().gaussians;
    // The second view needs more room than the first.
    let cameras = [camera([40, 40]), camera([130, 90])];
    for group in [&RUNGS[..10], &RUNGS[10..]] {
        let (frame, pixels) = draw(&gpu, &group[0], &scene, &cameras);
        for rung in group.iter().skip(1) {
            let (other_frame, other_pixels) = draw(&gpu, rung, &scene, &cameras);
            let counts = |t: &Totals| (t.visible, t.listed_kept, t.longest_list);
            assert_eq!(counts(&other_frame.totals), counts(&frame.totals), "{}", rung.name);
            // No two splats of this scene lie at one depth.
            assert!(other_pixels == pixels, "{}", rung.name);
        }
    }
}

#[test]
fn rungs_blend_lists_longer_than_a_pass() {
    let gpu = Gpu::new();
    let mut random = Random(7);
    // Faint specks, so that no pixel is ever opaque: every entry of the list counts.
    let speck = |_| {
        let mean = [random.between(-0.5, 0.5), random.between(-0.5, 0.5), random.between(3.0, 4.0)];
        let raw = Raw { mean, log_scale: [-8.0; 3], rotation: [1.0, 0.0, 0.0, 0.0], opacity_logit: -5.2 };
        (raw, [0.9, 0.5, 0.2])
    };
    let specks: Vec<_> = (0..70_000).map(speck).collect();
    let scene = gaussians(&specks);
    let camera = [Camera::looking_at(DVec3::ZERO, DVec3::Z, [16, 16], 0.35)];
    let exact = reference::render(&scene, &camera[0], &Options::EXACT.rules, Background::BLACK).to_pixels();
    for rung in &RUNGS {
        let (frame, pixels) = draw(&gpu, rung, &scene, &camera);
        assert!(frame.totals.longest_list > 40_000, "{}", frame.totals.longest_list);
        let psnr = smalto::measure::metrics::psnr(&pixels, &exact);
        assert!(psnr > 60.0, "{}: {psnr} dB", rung.name);
    }
}

#[test]
fn rungs_draw_the_background_of_an_empty_scene() {
    let gpu = Gpu::new();
    let scene = cactus(300).unwrap().gaussians;
    let away = [Camera::looking_at(DVec3::new(0.0, 0.0, -1e4), DVec3::new(0.0, 0.0, -2e4), [33, 17], 0.9)];
    for rung in &RUNGS {
        let (frame, pixels) = draw(&gpu, rung, &scene, &away);
        assert_eq!((frame.totals.visible, frame.totals.listed_kept), (0, 0), "{}", rung.name);
        assert!(pixels.rgba.iter().all(|p| *p == [0.0; 4]), "{}", rung.name);
    }
}

#[test]
fn three_sigma_squares_are_those_of_the_original() {
    let gpu = Gpu::new();
    let mut random = Random(3);
    let mut between = |low, high| random.between(low, high);
    // Needles and discs around the middle of the image: all are visible, many reach over its border.
    let gaussian = |_| {
        let mean = [between(-0.8, 0.8), between(-0.4, 0.4), between(3.0, 5.0)];
        let log_scale = [between(-6.0, -1.0), between(-6.0, -1.0), between(-6.0, -1.0)];
        let rotation = [between(-1.0, 1.0), between(-1.0, 1.0), between(-1.0, 1.0), between(-1.0, 1.0)];
        (Raw { mean, log_scale, rotation, opacity_logit: 2.0 }, [0.5; 3])
    };
    let scene = gaussians(&(0..2000).map(gaussian).collect::<Vec<_>>());
    let camera = Camera::looking_at(DVec3::ZERO, DVec3::Z, [300, 150], 0.9);
    let (frame, _) = draw(&gpu, &RUNGS[0], &scene, std::slice::from_ref(&camera));
    let tiling = Tiling::of(camera.size_px);
    let rules = Rules::INRIA;
    let tiles = |id: u32| {
        let splat = reference::project(&scene, id, &camera, &rules);
        reference::tiles(&splat, tiling, &rules).len() as u32
    };
    let expected: u32 = (0..2000).map(tiles).sum();
    let found = frame.totals.listed_kept;
    assert_eq!(frame.totals.visible, 2000);
    // f32 rounds a radius or a border the other way here and there.
    assert!(found.abs_diff(expected) * 1000 < expected, "{found} instances, {expected} expected");
}

#[test]
fn counting_frames_agree_with_the_reference_and_draw_the_same_picture() {
    let gpu = Gpu::new();
    let (scene, camera) = (cactus(3000).unwrap().gaussians, camera([96, 70]));
    let options = Options { portable: true, ..Options::EXACT };
    let gpu_scene = GpuScene::new(&gpu.0, &scene, &Options::EXACT).unwrap();
    let count = |options: &Options| {
        let mut still = Renderer::new(&gpu.0, options, &gpu_scene).unwrap();
        still.render(&camera, Background::BLACK).unwrap();
        let plain = still.pixels().unwrap();
        still.count_work(true).unwrap();
        let totals = still.render(&camera, Background::BLACK).unwrap().totals;
        // What is counted is the portable path's.
        let counted = still.pixels().unwrap();
        assert!(counted == plain || !options.portable && smalto::measure::metrics::psnr(&counted, &plain) >= 110.0);
        totals
    };
    let (portable, default) = (count(&options), count(&Options::EXACT));
    let (evaluations, stopped) = reference_counts(&scene, &camera, &options.rules);
    // f32 decides a few thresholds otherwise than f64.
    let near = |found: u32, expected: u32| found.abs_diff(expected) <= expected / 1000 + 2;
    assert!(near(portable.evaluations_low, evaluations), "{} of {evaluations}", portable.evaluations_low);
    assert!(near(portable.stopped_pixels, stopped), "{} of {stopped}", portable.stopped_pixels);
    assert_eq!(default.stopped_pixels, portable.stopped_pixels);
    assert!(default.evaluations_low < portable.evaluations_low, "splats that miss a block are not walked");
    assert!(portable.walked_low >= portable.evaluations_low);
    assert_eq!((portable.listed_tiles, portable.evaluations_high, portable.walked_high), (30, 0, 0));
}

/// Alphas up to the end of each pixel, and the pixels that end before their list does.
fn reference_counts(scene: &Gaussians, camera: &Camera, rules: &Rules) -> (u32, u32) {
    let [alpha_min, alpha_max, transmittance_min] =
        [rules.alpha_min, rules.alpha_max, rules.transmittance_min].map(f64::from);
    let tiling = Tiling::of(camera.size_px);
    let mut splats: Vec<Splat> = {
        let visible = reference::cull(scene, camera, rules).into_iter();
        visible.map(|id| reference::project(scene, id, camera, rules)).collect()
    };
    splats.sort_by(|a, b| (a.depth as f32).total_cmp(&(b.depth as f32)));
    let mut lists = vec![Vec::new(); tiling.tiles()];
    for splat in &splats {
        reference::tiles(splat, tiling, rules).into_iter().for_each(|tile| lists[tile as usize].push(splat));
    }
    let (mut evaluations, mut stopped) = (0, 0);
    for y in 0..camera.size_px[1] {
        for x in 0..camera.size_px[0] {
            let mut transmittance = 1.0;
            for splat in &lists[(y / TILE * tiling.counts[0] + x / TILE) as usize] {
                evaluations += 1;
                let distance = splat.distance(glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
                let alpha = (splat.opacity * (-0.5 * distance).exp()).min(alpha_max);
                if alpha < alpha_min {
                    continue;
                }
                if transmittance * (1.0 - alpha) < transmittance_min {
                    stopped += 1;
                    break;
                }
                transmittance *= 1.0 - alpha;
            }
        }
    }
    (evaluations, stopped)
}
