//! Properties of every scene: changes of the input that leave the picture, or change it in a known way.

use crate::common::agree::{agrees, ahead};
use crate::common::free::{Free, SIZE, build, camera, of_degree_4, render, render_from, scene};
use crate::common::{Gpu, Random, again_in_subgroups_of_four, compare, gaussians};
use glam::{DMat3, DQuat, DVec3};
use smalto::camera::Camera;
use smalto::options::Options;
use smalto::procedural::cactus;
use smalto::reference;
use smalto::render::{GpuScene, Renderer};
use smalto::rules::Background;
use smalto::scene::{MAX_SH_DEGREE, Raw, sh_coefficients};

#[test]
fn a_hundred_renders_are_the_same_bits() {
    let gaussians = cactus(20_000).unwrap().gaussians;
    let first = Gpu::new().render(&gaussians, &camera(), &Options::EXACT);
    let gpu = Gpu::new();
    let scene = GpuScene::new(&gpu.0, &gaussians, &Options::EXACT).unwrap();
    let mut still = Renderer::new(&gpu.0, &Options::EXACT, &scene).unwrap();
    for run in 1..100 {
        still.render(&camera(), Background::BLACK).unwrap();
        assert!(still.pixels().unwrap() == first, "run {run}");
    }
}

#[test]
fn both_paths_agree_and_draw_the_same_bits_in_every_run() {
    let gpu = Gpu::new();
    let scene = cactus(50_000).unwrap().gaussians;
    for camera in [camera(), camera().resized([301, 203])] {
        let draw = |portable| gpu.render(&scene, &camera, &Options { portable, ..Options::EXACT });
        let [fast, portable] = [false, true].map(draw);
        let psnr = smalto::measure::metrics::psnr(&fast, &portable);
        assert!(psnr >= 110.0, "{psnr} dB");
        assert!(draw(false) == fast && draw(true) == portable);
    }
}

#[test]
fn the_order_of_the_gaussians_does_not_matter() {
    let mut shuffled = scene();
    let expected = render(&shuffled);
    let mut random = Random(9);
    for i in (1..shuffled.len()).rev() {
        shuffled.swap(i, random.below(i as u32 + 1) as usize);
    }
    assert!(render(&shuffled) == expected);
}

#[test]
fn invisible_gaussians_do_not_matter() {
    let mut more = scene();
    let expected = render(&more);
    let unseen = [
        Raw { opacity_logit: -8.0, ..more[0].raw },
        Raw { opacity_logit: f64::NEG_INFINITY, ..more[1].raw },
        Raw { mean: [f64::NAN, 0.0, 0.0], ..more[2].raw },
        Raw { mean: [3.0, -4.0, -9.0], ..more[3].raw }, // behind the camera
        Raw { mean: [90.0, 0.0, 0.0], ..more[4].raw },
        Raw { rotation: [0.0; 4], ..more[5].raw },
    ];
    for (i, raw) in unseen.into_iter().cycle().take(600).enumerate() {
        let sh = more[i].sh.clone();
        more.insert(5 * i, Free { raw, sh });
    }
    assert!(render(&more) == expected);
}

#[test]
fn the_sign_of_a_quaternion_does_not_matter() {
    let mut negated = scene();
    let expected = render(&negated);
    for gaussian in &mut negated {
        gaussian.raw.rotation = gaussian.raw.rotation.map(|v| -v);
    }
    assert!(render(&negated) == expected);
}

#[test]
fn three_opaque_layers_hide_what_is_behind() {
    let layer = |z: f64| Free {
        raw: Raw {
            mean: [0.0, 0.0, z],
            log_scale: [6.0; 3],
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: f64::INFINITY,
        },
        sh: vec![[0.5; 3]; 16],
    };
    let camera = Camera::looking_at(DVec3::ZERO, DVec3::Z, SIZE, 0.9);
    let front: Vec<Free> = [3.0, 3.1, 3.2].map(layer).to_vec();
    let mut all = front.clone();
    all.extend(scene().into_iter().map(|mut g| {
        g.raw.mean[2] += 20.0;
        g
    }));
    assert!(render_from(&all, &camera) == render_from(&front, &camera));
}

#[test]
fn the_background_is_weighted_by_the_transmittance() {
    let gpu = Gpu::new();
    let gaussians = build(&scene()[..800], 3);
    let scene = GpuScene::new(&gpu.0, &gaussians, &Options::EXACT).unwrap();
    let mut still = Renderer::new(&gpu.0, &Options::EXACT, &scene).unwrap();
    let mut over = |background| {
        still.render(&camera(), background).unwrap();
        still.pixels().unwrap()
    };
    let (black, white) = (over(Background::BLACK), over(Background::Colour([1.0, 0.5, 0.25])));
    assert!(over(Background::Transparent) == black, "nothing behind adds nothing");
    for (a, b) in black.rgba.iter().zip(&white.rgba) {
        for (channel, background) in [1.0, 0.5, 0.25].into_iter().enumerate() {
            assert!((b[channel] - a[channel] - (1.0 - a[3]) * background).abs() < 1e-6);
        }
    }
}

#[test]
fn zero_harmonics_of_a_higher_degree_change_nothing() {
    for degree in 0..MAX_SH_DEGREE {
        let mut low = of_degree_4(3000);
        for gaussian in &mut low {
            gaussian.sh[sh_coefficients(degree)..].fill([0.0; 3]);
        }
        let gpu = Gpu::new();
        let padded = gpu.render(&build(&low, MAX_SH_DEGREE), &camera(), &Options::EXACT);
        let alone = gpu.render(&build(&low, degree), &camera(), &Options::EXACT);
        assert!(padded == alone, "degree {degree}");
    }
}

#[test]
fn every_degree_matches_the_reference() {
    let gpu = Gpu::new();
    for degree in 0..=MAX_SH_DEGREE {
        let scene = build(&of_degree_4(3000), degree);
        let rendering = reference::render(&scene, &camera(), &Options::EXACT.rules, Background::BLACK);
        let comparison = compare(&gpu.render(&scene, &camera(), &Options::EXACT), &rendering);
        assert!(comparison.unexplained == 0 && comparison.psnr > 90.0, "degree {degree}: {comparison:?}");
    }
}

#[test]
fn random_splats_agree_and_are_convex_combinations() {
    let mut random = Random(17);
    let near = Options::EXACT.rules.near;
    for round in 0..20 {
        let mut raws = Vec::new();
        for _ in 0..300 {
            let z = match random.below(8) {
                0 => f64::from([near.next_down(), near, near.next_up()][random.below(3) as usize]),
                1 => f64::from(near) * random.between(-3.0, 1.1),
                _ => 10_f64.powf(random.between(-0.7, 6.0)),
            };
            let mean = [z * random.between(-2.0, 2.0), z * random.between(-2.0, 2.0), z];
            let log_scale = std::array::from_fn(|_| random.between(1e-8_f64.ln(), 1e8_f64.ln()));
            let length = 10_f64.powf(random.between(-40.0, 38.0));
            let mut rotation = std::array::from_fn(|_| length * random.between(-1.0, 1.0));
            // Some have fewer components than four; those with none are dropped.
            for component in rotation.iter_mut().take(random.below(20).saturating_sub(15) as usize) {
                *component = 0.0;
            }
            let opacity_logit = random.between(-10.0, 10.0) * if random.below(10) == 0 { 10.0 } else { 1.0 };
            let colour = std::array::from_fn(|_| random.between(0.1, 0.9) as f32);
            raws.push((Raw { mean, log_scale, rotation, opacity_logit }, colour));
        }
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, random.between(-3.0, 3.0), random.between(-3.0, 3.0), 1.0);
        for (raw, _) in &mut raws {
            raw.mean = (turn.inverse() * DVec3::from(raw.mean)).to_array();
        }
        let mut camera = ahead([80, 60], 10_f64.powf(random.between(0.0, 4.0)));
        camera.rotation *= DMat3::from_quat(turn);
        let pixels = agrees(&format!("round {round}"), &gaussians(&raws), &camera);
        for pixel in &pixels.rgba {
            // Colours between 0.1 and 0.9, over black.
            let [low, high] = [0.1, 0.9].map(|c| c * pixel[3]);
            assert!(pixel[..3].iter().all(|c| (low - 1e-5..=high + 1e-5).contains(c)), "round {round}: {pixel:?}");
        }
    }
}

#[test]
fn random_splats_agree_in_subgroups_of_four() {
    again_in_subgroups_of_four(&["random_splats_agree_and_are_convex_combinations"]);
}

/// Every pixel is a mean of the colours and the background, so what is done to all of them is done to it.
#[test]
fn brightening_the_colours_brightens_the_picture() {
    const DC: f32 = 0.282_094_8;
    let mut mild = scene();
    for gaussian in &mut mild {
        // No colour is so dark that it is clamped at 0.
        gaussian.sh[0] = gaussian.sh[0].map(|k| k.clamp(-0.4 / DC, 3.0));
        gaussian.sh[1..].iter_mut().flatten().for_each(|k| *k = k.clamp(-0.01, 0.01));
    }
    let (factor, term) = (1.75, 0.125);
    let mut changed = mild.clone();
    for gaussian in &mut changed {
        gaussian.sh.iter_mut().flatten().for_each(|k| *k *= factor);
        gaussian.sh[0] = gaussian.sh[0].map(|k| k + (factor * 0.5 + term - 0.5) / DC);
    }
    let gpu = Gpu::new();
    let over = |all: &[Free], background: [f32; 3]| {
        let scene = GpuScene::new(&gpu.0, &build(all, 3), &Options::EXACT).unwrap();
        let mut still = Renderer::new(&gpu.0, &Options::EXACT, &scene).unwrap();
        still.render(&camera(), Background::Colour(background)).unwrap();
        still.pixels().unwrap()
    };
    let background = [0.5, 0.25, 1.0];
    let (expected, pixels) = (over(&mild, background), over(&changed, background.map(|c| factor * c + term)));
    for (before, after) in expected.rgba.iter().zip(&pixels.rgba) {
        assert_eq!(before[3], after[3], "coverage knows no colour");
        assert!((0..3).all(|i| (factor * before[i] + term - after[i]).abs() < 1e-5), "{before:?} became {after:?}");
    }
}
