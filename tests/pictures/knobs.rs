//! The knobs that trade accuracy for speed, and the bound of what each changes. Knobs of storage are in storage.rs.

use crate::common::agree::{GREEN, RED, ahead, ball, logit};
use crate::common::cloud::{camera, cloud};
use crate::common::free::{Free, build};
use crate::common::program::ok;
use crate::common::{Gpu, Random, compare, gaussians};
use glam::DVec3;
use smalto::camera::Camera;
use smalto::measure::metrics::{max_error, psnr};
use smalto::options::Options;
use smalto::pixels::Pixels;
use smalto::procedural;
use smalto::reference::{self, Lists, Rendering, Tiling};
use smalto::render::{GpuScene, Renderer, Totals};
use smalto::rules::{Background, Rules};
use smalto::scene::{Gaussians, Raw};

const WHITE: Background = Background::Colour([1.0; 3]);
/// What f32 rounding makes of the sum of a pixel whose colours go up to 3.
const ROUNDING: f64 = 1e-5;
/// What shows: a hundred times that.
const SHOWS: f32 = 1e-3;

fn cactus() -> Gaussians {
    procedural::cactus(4000).unwrap().gaussians
}

fn front(size: [u32; 2]) -> Camera {
    Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), size, 0.9)
}

/// The picture, and what it took.
fn counted(gpu: &Gpu, scene: &Gaussians, camera: &Camera, options: &Options, behind: Background) -> (Pixels, Totals) {
    let gpu_scene = GpuScene::new(&gpu.0, scene, options).unwrap();
    let mut still = Renderer::new(&gpu.0, options, &gpu_scene).unwrap();
    still.count_work(true).unwrap();
    let totals = still.render(camera, behind).unwrap().totals;
    (still.pixels().unwrap(), totals)
}

/// Layers across the whole image, each darker or brighter than what lies behind it, so that a pixel that stops early
/// misses as much as can be.
fn layers(random: &mut Random, opacity: [f64; 2], bright: f32) -> Gaussians {
    let one = |random: &mut Random, i: u32| {
        let mean = [random.between(-1.0, 1.0), random.between(-0.7, 0.7), 3.0 + 0.01 * f64::from(i)];
        let opacity = random.between(opacity[0], opacity[1]);
        let raw = Raw { opacity_logit: logit(opacity), ..ball(mean, random.between(0.3, 9.0), 0.5) };
        let is_behind = i > random.below(40);
        (raw, if is_behind { [bright, bright * random.between(0.0, 1.0) as f32, 0.0] } else { [0.0; 3] })
    };
    gaussians(&(0..80).map(|i| one(random, i)).collect::<Vec<_>>())
}

/// A search for a pixel that a stop moves by more than its part of the brightest colour.
#[test]
fn an_early_stop_moves_no_pixel_by_more_than_its_bound() {
    let gpu = Gpu::new();
    let mut random = Random(1);
    let mut closest = 0.0_f64;
    for round in 0..8 {
        let bright = [1.0_f32, 3.0][round % 2];
        let scene = match round / 2 {
            0 => layers(&mut random, [0.02, 0.3], bright),
            1 => layers(&mut random, [0.5, 0.99], bright),
            2 => layers(&mut random, [0.9, 0.999], bright),
            _ => build(&cloud(&mut random, 500, 0, 0.0), 0),
        };
        let behind = if round % 4 < 2 { WHITE } else { Background::BLACK };
        // A cloud has coefficients up to 1.7: 0.98 at most.
        let brightest = f64::from(if round < 6 { bright.max(1.0) } else { 1.0 });
        let picture = |stop: f32| counted(&gpu, &scene, &camera(), &Options { stop, ..Options::EXACT }, behind);
        let (exact, all) = picture(0.0);
        for stop in [1e-3, 1.0 / 255.0, 1.0 / 32.0, 0.3] {
            let (stopped, totals) = picture(stop);
            let error = f64::from(max_error(&stopped, &exact));
            let bound = f64::from(stop) * brightest;
            assert!(error <= bound + ROUNDING, "round {round}, stop {stop}: {error:e} passes {bound:e}");
            assert!(totals.evaluations() <= all.evaluations(), "round {round}, stop {stop}");
            closest = closest.max(error / bound);
        }
    }
    println!("the closest is {closest} of the bound");
    assert!(closest > 0.5, "the bound is not loose: {closest}");
}

#[test]
fn an_early_stop_saves_work() {
    let gpu = Gpu::new();
    let scene = cactus();
    let work = |stop: f32| {
        let options = Options { stop, ..Options::EXACT };
        let (_, totals) = counted(&gpu, &scene, &front([100, 70]), &options, Background::BLACK);
        totals.evaluations()
    };
    let all = [0.0, 1e-3, 1e-2, 0.1].map(work);
    println!("evaluations by stop: {all:?}");
    assert!(all.is_sorted_by(|a, b| a > b), "{all:?}");
}

/// The picture when splats are sorted by their depth keys without the lowest `shift` bits, equal ones as in the file.
fn sorted_by_upper_bits(scene: &Gaussians, camera: &Camera, shift: u32) -> Rendering {
    let (rules, tiling) = (Rules::TRAINED, Tiling::of(camera.size_px));
    let visible = reference::cull(scene, camera, &rules);
    let splats: Vec<_> = visible.iter().map(|id| reference::project(scene, *id, camera, &rules)).collect();
    let key = |splat: &reference::Splat| ((splat.depth as f32).to_bits() - rules.near.to_bits()) >> shift;
    let keys: Vec<u32> = splats.iter().map(key).collect();
    let (_, order) = reference::sort(&keys, &(0..splats.len() as u32).collect::<Vec<_>>(), 0..32);
    let (tile_keys, splat_ids) = reference::duplicate(&splats, &order, tiling, &rules);
    let (tile_keys, splat_ids) = reference::sort(&tile_keys, &splat_ids, 0..tiling.key_bits());
    let ranges = reference::ranges(&tile_keys, tiling.tiles());
    let lists = Lists { splats: &splats, ranges: &ranges, splat_ids: &splat_ids, rays: None };
    Rendering { size_px: camera.size_px, pixels: reference::blend(&lists, tiling, DVec3::ZERO, &rules) }
}

#[test]
fn short_depth_keys_sort_by_their_upper_bits() {
    let gpu = Gpu::new();
    // From depth 0.7 to 12, and one Gaussian whose depth is the far end of the scene.
    let mut free = cloud(&mut Random(2), 500, 0, 0.0);
    let raw = Raw { mean: [0.0, 0.0, 12.5], ..free[0].raw };
    free.push(Free { raw, sh: free[0].sh.clone() });
    let scene = build(&free, 0);
    // Floats from 0.2 to 12.5, whose number takes 26 bits.
    let needed = u32::BITS - (12.5_f32.to_bits() - Rules::TRAINED.near.to_bits()).leading_zeros();
    let exact = reference::render(&scene, &camera(), &Rules::TRAINED, Background::BLACK).to_pixels();
    for key_bits in [8, 9, 10, 12, 16, 24, 32] {
        let shift = needed.saturating_sub(key_bits);
        let expected = sorted_by_upper_bits(&scene, &camera(), shift);
        let pixels = gpu.render(&scene, &camera(), &Options { key_bits, ..Options::EXACT });
        let found = compare(&pixels, &expected);
        println!("{key_bits} bits: {:.1} dB to exact; {found:?}", psnr(&pixels, &exact));
        assert_eq!(found.unexplained, 0, "{key_bits} bits: {found:?}");
        assert_eq!(max_error(&pixels, &exact) > SHOWS, key_bits <= 12, "{key_bits} bits show");
    }
}

#[test]
fn equal_short_depth_keys_keep_the_order_of_the_file() {
    let gpu = Gpu::new();
    // 2.0005 and 2 differ in the 13th bit after the leading one.
    let balls = [(ball([0.0, 0.0, 2.0005], 0.5, 0.95), RED), (ball([0.0, 0.0, 2.0], 0.5, 0.95), GREEN)];
    let scene = gaussians(&balls);
    let red = |key_bits: u32| {
        let pixels = gpu.render(&scene, &ahead([32, 32], 40.0), &Options { key_bits, ..Options::EXACT });
        pixels.rgba[16 * 32 + 16][0] > 0.5
    };
    assert_eq!([32, 24, 20, 12, 8].map(red), [false, false, false, true, true]);
}

#[test]
fn a_constant_picture_stays_constant_at_every_scale() {
    let gpu = Gpu::new();
    // So wide that its alpha is the cap everywhere.
    let scene = gaussians(&[(ball([0.0, 0.0, 2.0], 1e5, 0.9999), [0.25, 0.5, 0.75])]);
    for size in [[101, 67], [16, 16], [1, 1], [2, 300]] {
        for scale in [0.75, 0.5, 0.37, 0.01] {
            let pixels = gpu.render(&scene, &ahead(size, 40.0), &Options { scale, ..Options::EXACT });
            assert_eq!(pixels.size, size, "a picture is of the full size");
            let expected = [0.25, 0.5, 0.75, 1.0].map(|v| 0.99 * v);
            let apart = |p: &[f32; 4]| p.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            let worst = pixels.rgba.iter().map(apart).fold(0.0, f32::max);
            assert!(worst < 1e-6, "{size:?} at {scale}: {worst:e}");
        }
    }
}

/// Nothing moves when it is enlarged: what is alike from both sides stays so.
#[test]
fn an_enlarged_picture_is_not_shifted() {
    let gpu = Gpu::new();
    let scene = gaussians(&[(ball([0.0, 0.0, 2.0], 0.3, 0.9), [1.0, 0.5, 0.2])]);
    for (size, scale) in [([80, 60], 0.5), ([81, 61], 0.5), ([80, 60], 0.3), ([64, 50], 0.75)] {
        let camera = ahead(size, 60.0);
        let exact = gpu.render(&scene, &camera, &Options::EXACT);
        let pixels = gpu.render(&scene, &camera, &Options { scale, ..Options::EXACT });
        let turned = Pixels { size, rgba: pixels.rgba.iter().rev().copied().collect() };
        let asymmetry = max_error(&pixels, &turned);
        assert!(asymmetry < 1e-4, "{size:?} at {scale}: {asymmetry}");
        let db = psnr(&pixels, &exact);
        println!("{size:?} at {scale}: {db:.1} dB");
        assert!(db > 35.0, "{size:?} at {scale}: a soft ball is nearly what it was, {db} dB");
    }
}

#[test]
fn the_drawn_size_is_rounded_and_at_least_1() {
    let drawn = |size: [u32; 2], scale: f32| Options { scale, ..Options::EXACT }.drawn_size(size);
    assert_eq!(drawn([1, 1], 0.01), [1, 1]);
    assert_eq!(drawn([1, 1], 1.0), [1, 1]);
    assert_eq!(drawn([3, 5], 0.5), [2, 3]);
    assert_eq!(drawn([1000, 10], 0.001), [1, 1]);
    assert_eq!(drawn([1920, 1080], 0.75), [1440, 810]);
    assert_eq!(drawn([65536, 7], 0.999_999_94), [65536, 7]);
    assert_eq!(drawn([5, 5], f32::MIN_POSITIVE), [1, 1]);
}

#[test]
fn a_scale_of_1_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let picture = |name: &str, more: &[&str]| {
        let out = crate::common::program::path(&folder, name);
        ok(&[&["render", "cactus:500", "--size", "50x40", "-o", &out], more].concat());
        Pixels::read(std::path::Path::new(&out)).unwrap()
    };
    let plain = picture("a.npy", &[]);
    assert!(picture("b.npy", &["--scale", "1"]) == plain);
    assert!(picture("c.npy", &["--scale", "0.5"]) != plain);
}

#[test]
fn a_bench_counts_the_tiles_that_are_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let out = crate::common::program::path(&folder, "a.json");
    ok(&["bench", "cactus:500", "--size", "96x80", "--scale", "0.5", "--frames", "2", "--warmup", "0", "--json", &out]);
    let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(out).unwrap()).unwrap();
    let run = &report["runs"][0];
    assert_eq!(run["counts"]["tiles"], 3 * 3);
    let stages: Vec<_> = run["stages"].as_array().unwrap().iter().map(|s| s["name"].as_str().unwrap()).collect();
    assert!(stages.ends_with(&["blend", "upscale", "gaps"]), "{stages:?}");
    assert!(run["memory"].as_array().unwrap().iter().any(|m| m["buffer"] == "drawn image"));
}
