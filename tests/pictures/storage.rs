//! How the GPU keeps numbers: what storage changes of a picture is as little as it says, for every degree and every
//! length.

use crate::common::agree::{ahead, ball, logit};
use crate::common::cloud::{SIZE, camera, cloud};
use crate::common::free::{Free, build, free};
use crate::common::{Gpu, ROUNDING, Random, difference};
use glam::{DQuat, DVec3};
use smalto::camera::Camera;
use smalto::measure::metrics::psnr;
use smalto::options::{Options, Storage};
use smalto::packing::{Layout, Statistics};
use smalto::pixels::Pixels;
use smalto::procedural::cactus;
use smalto::reference;
use smalto::rules::{Background, Rules};
use smalto::scene::{Gaussians, MAX_SH_DEGREE, Raw, decode_rotation, encode_rotation};

/// dB of a scene that lies on 8-bit grids, kept in 8 bits, to the same in 32-bit floats: a grid gives back what
/// arithmetic in f32 makes of it.
const LOSSLESS_PSNR: f64 = 110.0;

fn layout(scene: &Gaussians, options: &Options) -> Layout {
    Layout::of(&Statistics::of(scene), options)
}

/// Fails where a pixel is farther from the reference than storage may change it, besides rounding and doubt; returns
/// the largest difference.
fn keeps_its_bound(name: &str, pixels: &Pixels, scene: &Gaussians, camera: &Camera, bound: f64) -> f64 {
    let exact = reference::render(scene, camera, &Rules::TRAINED, Background::BLACK);
    let mut largest = 0.0_f64;
    for (index, pair) in pixels.rgba.iter().zip(&exact.pixels).enumerate() {
        let error = difference(pair);
        assert!(error <= bound + ROUNDING + pair.1.doubt, "{name}: pixel {index}: {error:e} passes {bound:e}");
        largest = largest.max(error - pair.1.doubt);
    }
    largest
}

#[test]
fn harmonics_in_fewer_bits_and_degrees_stay_within_their_bound() {
    let gpu = Gpu::new();
    for degree in 0..=MAX_SH_DEGREE {
        // Opaque and bright enough that no colour is cut at 0, which would hide an error.
        let mut cloud = cloud(&mut Random(u64::from(degree) + 1), 250, degree, 0.15);
        for one in &mut cloud {
            one.raw.opacity_logit = 4.0;
            one.sh[0] = one.sh[0].map(|v| v.abs() + 2.0);
        }
        let scene = build(&cloud, degree);
        for storage in [Storage::Lossless, Storage::F32, Storage::F16, Storage::U8] {
            for cap in 0..=degree {
                let options = Options { sh_storage: storage, sh_degree: cap, ..Options::EXACT };
                let name = format!("degree {degree} as {cap} in {storage:?}");
                let bound = layout(&scene, &options).colour_error(&scene);
                let pixels = gpu.render(&scene, &camera(), &options);
                let largest = keeps_its_bound(&name, &pixels, &scene, &camera(), bound);
                println!("{name}: {largest:.1e} of {bound:.1e}");
                let loses = cap < degree || matches!(storage, Storage::F16 | Storage::U8);
                assert_eq!(bound > 0.0, loses, "{name}");
                assert!(!loses || largest > 0.1 * bound, "{name}: the bound is ten times the error {largest:e}");
            }
        }
    }
}

/// As an .spz file decodes to: scales, opacities, rotations and harmonics on grids.
fn on_grids(random: &mut Random, count: usize, degree: u32) -> Vec<Free> {
    let mut all = cloud(random, count, degree, 0.5);
    for one in &mut all {
        let steps = |value: f64, low: f64, step: f64| ((value - low) / step).round().clamp(0.0, 255.0);
        let opacity = steps(1.0 / (1.0 + (-one.raw.opacity_logit).exp()), 0.0, 1.0 / 255.0).clamp(1.0, 254.0) / 255.0;
        let rotation = DVec3::from_slice(&one.raw.rotation[1..]).extend(one.raw.rotation[0]).normalize();
        let rotation = [rotation.w, rotation.x, rotation.y, rotation.z].map(|v| v as f32);
        one.raw = Raw {
            log_scale: one.raw.log_scale.map(|s| steps(s, -10.0, 1.0 / 16.0) / 16.0 - 10.0),
            opacity_logit: logit(opacity),
            rotation: decode_rotation(encode_rotation(rotation)),
            ..one.raw
        };
        for (i, coefficient) in one.sh.iter_mut().enumerate() {
            *coefficient = coefficient.map(|v| match i {
                0 => ((random.below(256) as f32 / 255.0) - 0.5) / 0.15,
                _ => ((f64::from(v) * 128.0).round() / 128.0) as f32,
            });
        }
    }
    all
}

#[test]
fn values_on_a_grid_are_stored_in_8_bits_without_loss() {
    let gpu = Gpu::new();
    for degree in 0..=MAX_SH_DEGREE {
        let scene = build(&on_grids(&mut Random(9), 500, degree), degree);
        let floats = Options { sh_storage: Storage::F32, shape_storage: Storage::F32, ..Options::EXACT };
        let in_floats = gpu.render(&scene, &camera(), &floats);
        for storage in [Storage::Lossless, Storage::F16] {
            let options = Options { sh_storage: storage, shape_storage: storage, ..Options::EXACT };
            let layout = layout(&scene, &options);
            for packing in [layout.sh, layout.shape] {
                assert_eq!((packing.storage, packing.is_lossless), (Storage::U8, true), "degree {degree}, {storage:?}");
            }
            assert_eq!(layout.colour_error(&scene), 0.0);
            // 16 of bounds, 8 of shape, a byte for each number in words, of which three or seven have the room of one
            // more.
            assert_eq!(layout.bytes_each(), 16 + 8 + [4, 16, 32, 48, 80][degree as usize]);
            let db = psnr(&gpu.render(&scene, &camera(), &options), &in_floats);
            println!("degree {degree}, {storage:?}: {db:.1} dB");
            assert!(db > LOSSLESS_PSNR, "degree {degree}, {storage:?}: {db} dB");
        }
    }
}

/// Bytes on the GPU: 16 of bounds, 32 of shape, and the numbers of the harmonics in words, of which three have the room
/// of four.
#[test]
fn floats_of_every_degree_take_the_fewest_planes() {
    for (degree, expected) in [(0, [16, 8]), (1, [48, 24]), (2, [112, 56]), (3, [192, 96]), (4, [304, 152])] {
        let scene = build(&cloud(&mut Random(3), 9, degree, 0.5), degree);
        for (storage, bytes) in [Storage::F32, Storage::F16].into_iter().zip(expected) {
            let options = Options { sh_storage: storage, ..Options::EXACT };
            assert_eq!(layout(&scene, &options).bytes_each(), 16 + 32 + bytes, "degree {degree} in {storage:?}");
        }
    }
}

#[test]
fn values_off_the_grid_are_stored_as_floats() {
    let mut all = on_grids(&mut Random(9), 500, 1);
    all[321].sh[2][1] += 0.003;
    all[123].raw.log_scale[0] += 0.01;
    let layout = layout(&build(&all, 1), &Options::EXACT);
    assert_eq!([layout.sh.storage, layout.shape.storage], [Storage::F32; 2]);
}

/// Every Gaussian in a tile of its own: where words of several share an element, each gets its own.
#[test]
fn attributes_stay_with_their_gaussians_at_every_count() {
    let gpu = Gpu::new();
    let camera = ahead([48, 48], 48.0);
    let mut random = Random(11);
    for degree in 0..=MAX_SH_DEGREE {
        for count in 1..=9 {
            let mut all = on_grids(&mut random, count, degree);
            for (i, one) in all.iter_mut().enumerate() {
                let mean = [i % 3, i / 3].map(|place| 2.0 * (place as f64 - 1.0));
                // Neighbouring steps, since a step is found as the least difference.
                let log_scale = std::array::from_fn(|axis| -2.0 + 0.5 * ((i + axis) % 3) as f64);
                one.raw = Raw { mean: [mean[0], mean[1], 6.0], log_scale, opacity_logit: logit(0.8), ..one.raw };
                for coefficient in &mut one.sh {
                    *coefficient = std::array::from_fn(|_| random.between(-0.3, 0.6) as f32);
                }
            }
            let scene = build(&all, degree);
            for storage in [Storage::F32, Storage::F16, Storage::U8] {
                let options = Options { sh_storage: storage, ..Options::EXACT };
                let layout = layout(&scene, &options);
                let name = format!("{count} of degree {degree} in {storage:?}");
                assert_eq!(layout.shape.storage, Storage::U8, "{name}: two shapes share an element");
                let bound = layout.colour_error(&scene);
                assert!(bound < 0.01, "{name}: another's words would show");
                keeps_its_bound(&name, &gpu.render(&scene, &camera, &options), &scene, &camera, bound);
            }
        }
    }
}

/// Scenes are uploaded in parts of 32768.
#[test]
fn attributes_stay_with_their_gaussians_across_uploads() {
    let gpu = Gpu::new();
    let scene = build(&free(&cactus(32_771).unwrap().gaussians), 0);
    let camera = Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), [80, 60], 0.9);
    for storage in [Storage::F16, Storage::U8] {
        let options = Options { sh_storage: storage, ..Options::EXACT };
        let bound = layout(&scene, &options).colour_error(&scene);
        let pixels = gpu.render(&scene, &camera, &options);
        keeps_its_bound(&format!("{storage:?}"), &pixels, &scene, &camera, bound);
    }
}

/// The farther, the larger: from 2^-20 to 2^16 world units away, all of one size on the screen.
fn over_octaves(octaves: i32) -> Gaussians {
    let mut random = Random(13);
    let all: Vec<Free> = (0..400)
        .map(|i| {
            let z = f64::from(-20 + octaves * i / 400).exp2();
            let mean = [random.between(-0.8, 0.8) * z, random.between(-0.5, 0.5) * z, z];
            let log_scale = std::array::from_fn(|_| (z * random.between(0.005, 0.05)).ln());
            let rotation = std::array::from_fn(|_| random.between(-1.0, 1.0));
            let raw = Raw { log_scale, rotation, ..ball(mean, 1.0, random.between(0.05, 0.9)) };
            Free { raw, sh: vec![std::array::from_fn(|_| random.between(-1.7, 1.7) as f32)] }
        })
        .collect();
    build(&all, 0)
}

/// dB to the reference of `scene` with shapes in this storage, and whether every value is finite.
fn shapes_psnr(gpu: &Gpu, scene: &Gaussians, camera: &Camera, storage: Storage, rules: Rules) -> f64 {
    let options = Options { shape_storage: storage, rules, ..Options::EXACT };
    let pixels = gpu.render(scene, camera, &options);
    assert!(pixels.rgba.iter().flatten().all(|v| v.is_finite()));
    let db = psnr(&pixels, &reference::render(scene, camera, &rules, Background::BLACK).to_pixels());
    println!("{} Gaussians with shapes in {storage:?}: {db:.1} dB", scene.len());
    db
}

#[test]
fn shapes_in_16_bits_span_36_octaves_of_scale() {
    let gpu = Gpu::new();
    let rules = Rules { near: 1e-7, ..Rules::TRAINED };
    let scene = over_octaves(36);
    let scales = scene.scales().as_flattened();
    let range = scales.iter().fold(0.0, |m: f32, s| m.max(*s)) / scales.iter().fold(f32::MAX, |m: f32, s| m.min(*s));
    assert!(range.log2() > 36.0, "{}", range.log2());
    let psnr = |scene: &Gaussians, storage| shapes_psnr(&gpu, scene, &camera(), storage, rules);
    assert!(psnr(&scene, Storage::F32) > 100.0);
    assert!(psnr(&scene, Storage::F16) > 52.0, "the smallest keep a few bits");
    assert!(psnr(&over_octaves(24), Storage::F16) > 75.0, "all keep eleven");
}

#[test]
fn shapes_in_8_bits_draw_nearly_the_cactus() {
    let gpu = Gpu::new();
    let scene = cactus(4000).unwrap().gaussians;
    let camera = Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), SIZE, 0.9);
    assert_eq!(layout(&scene, &Options { shape_storage: Storage::U8, ..Options::EXACT }).bytes_each(), 16 + 8 + 192);
    let psnr = |storage| shapes_psnr(&gpu, &scene, &camera, storage, Rules::TRAINED);
    assert!(psnr(Storage::F16) > 70.0);
    assert!(psnr(Storage::U8) > 48.0);
}

/// Opacities down to a quarter of a step of 8 bits.
#[test]
fn opacities_in_8_bits_are_never_zero() {
    let gpu = Gpu::new();
    let camera = ahead([64, 64], 64.0);
    let rules = Rules { alpha_min: 1.0 / 1024.0, ..Rules::TRAINED };
    let balls: Vec<_> = (0..16)
        .map(|i| {
            let mean = [i % 4, i / 4].map(|place| 0.25 * (f64::from(place) - 1.5));
            (ball([mean[0], mean[1], 1.0], 0.05, f64::from(i + 2) / 8.0 / 255.0), [1.0; 3])
        })
        .collect();
    let scene = crate::common::gaussians(&balls);
    let options = Options { rules, shape_storage: Storage::U8, ..Options::EXACT };
    let pixels = gpu.render(&scene, &camera, &options);
    for i in 0..16 {
        let [x, y] = [i % 4, i / 4].map(|place| 8 + 16 * place);
        let alpha = pixels.rgba[y * 64 + x][3];
        assert!(alpha > 0.9 / 255.0, "ball {i}: {alpha}");
    }
}

/// A rotation is that of its quaternion and of the opposite one; which component is the largest does not matter.
#[test]
fn rotations_in_32_bits_agree() {
    let gpu = Gpu::new();
    let mut random = Random(15);
    let camera = ahead([64, 48], 60.0);
    let mut worst = f64::INFINITY;
    for axis in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::new(1.0, -1.0, 0.5).normalize()] {
        for turn in [0.3, 2.0, -2.8] {
            let q = DQuat::from_axis_angle(axis, turn + random.between(-0.1, 0.1));
            let raw = Raw {
                log_scale: [-0.5, -1.5, -2.5],
                rotation: [q.w, q.x, q.y, q.z],
                ..ball([0.0, 0.0, 3.0], 1.0, 0.9)
            };
            let scene = crate::common::gaussians(&[(raw, [1.0; 3])]);
            worst = worst.min(shapes_psnr(&gpu, &scene, &camera, Storage::U8, Rules::TRAINED));
        }
    }
    assert!(worst > 50.0, "{worst} dB");
}
