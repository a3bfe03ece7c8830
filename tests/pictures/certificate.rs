//! The certificate of a picture: an upper bound of the error at every pixel, against the sum of all contributions.

use crate::common::lens::{all, around, through};
use crate::common::{Gpu, Random, gaussians};
use glam::{DVec2, DVec3};
use smalto::camera::Camera;
use smalto::options::Options;
use smalto::packing::Statistics;
use smalto::pixels::Pixels;
use smalto::procedural::cactus;
use smalto::reference;
use smalto::render::{GpuScene, Path, RayCertifier, Renderer};
use smalto::rules::{Background, Footprint, Response, Rules};
use smalto::scene::{Gaussians, Raw};

/// What is left out in ways that a certificate is for, beside nothing more than the rules do.
fn settings() -> Vec<(&'static str, Options)> {
    let rules = |rules: Rules| Options { rules, ..Options::EXACT };
    let trained = Options::EXACT.rules;
    vec![
        ("exact", Options::EXACT),
        ("stop 1e-3", Options { stop: 1e-3, ..Options::EXACT }),
        ("stop 1/64", Options { stop: 1.0 / 64.0, ..Options::EXACT }),
        ("alpha 1/32", rules(Rules { alpha_min: 1.0 / 32.0, ..trained })),
        ("alpha 1/4096", rules(Rules { alpha_min: 1.0 / 4096.0, transmittance_min: 1e-6, ..trained })),
        ("three sigma", rules(Rules { extent: Footprint::ThreeSigma, ..trained })),
    ]
}

fn certified(gpu: &Gpu, scene: &Gaussians, camera: &Camera, options: &Options, background: Background) -> [Pixels; 2] {
    let statistics = Statistics::of(scene);
    let gpu_scene = GpuScene::certifiable(&gpu.0, scene, &statistics, options).unwrap();
    let mut still = Renderer::certified(&gpu.0, options, &gpu_scene).unwrap();
    still.render(camera, background).unwrap();
    [still.pixels().unwrap(), still.certificate().unwrap().unwrap()]
}

/// Largest and mean of the error and of the bound, over all channels; fails where a bound is passed.
fn holds(name: &str, scene: &Gaussians, camera: &Camera, background: Background) {
    responds(name, scene, camera, background, Response::Screen);
}

/// Likewise for pinholes along rays, too.
fn responds(name: &str, scene: &Gaussians, camera: &Camera, background: Background, response: Response) {
    let gpu = Gpu::new();
    let complete = reference::render(scene, camera, &Rules { response, ..Rules::TRAINED }.complete(), background);
    for (setting, options) in settings() {
        let options = Options { rules: Rules { response, ..options.rules }, ..options };
        let [picture, certificate] = certified(&gpu, scene, camera, &options, background);
        let (mut largest, mut sums) = ([0.0_f64; 2], [0.0; 2]);
        for ((pixel, bound), exact) in picture.rgba.iter().zip(&certificate.rgba).zip(&complete.pixels) {
            let error = (0..3).map(|i| (f64::from(pixel[i]) - exact.colour[i]).abs()).fold(0.0, f64::max);
            let bound = f64::from(bound[0]);
            assert!(error <= bound, "{name}, {setting}: error {error:e} passes its bound {bound:e}");
            for (i, value) in [error, bound].into_iter().enumerate() {
                largest[i] = largest[i].max(value);
                sums[i] += value;
            }
        }
        println!(
            "{name}, {setting}: largest error {:.2e} under {:.2e}, means {:.2}x apart",
            largest[0],
            largest[1],
            sums[1] / sums[0]
        );
        // What the bound is worth: it is no constant that always holds.
        assert!(sums[1] < 60.0 * sums[0] + 1e-3 * picture.rgba.len() as f64, "{name}, {setting}: the bound is loose");
    }
}

#[test]
fn errors_stay_below_the_certificate_on_the_cactus() {
    let scene = cactus(20_000).unwrap().gaussians;
    let camera = Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), [160, 110], 0.9);
    holds("cactus", &scene, &camera, Background::BLACK);
    holds("cactus on white", &scene, &camera, Background::Colour([1.0; 3]));
}

/// A search for a counterexample among scenes made to pass the bound: many faint layers, all of one colour against the
/// background's, so that what is left out adds up.
#[test]
fn errors_stay_below_the_certificate_where_they_add_up() {
    let mut random = Random(17);
    for round in 0..6 {
        let bright = [1.0, 3.0][round % 2];
        let layers: Vec<_> = (0..400)
            .map(|i| {
                let mean = [random.between(-0.5, 0.5), random.between(-0.5, 0.5), 4.0 + 0.01 * f64::from(i)];
                let scale: f64 = random.between(0.05, 2.0);
                let opacity: f64 = random.between(0.5 / 255.0, [0.02, 0.9][round / 3]);
                let raw = Raw {
                    mean,
                    log_scale: [scale.ln(), (scale * random.between(0.01, 1.0)).ln(), -5.0],
                    rotation: [random.between(-1.0, 1.0), random.between(-1.0, 1.0), 0.3, random.between(-1.0, 1.0)],
                    opacity_logit: (opacity / (1.0 - opacity)).ln(),
                };
                (raw, if i % 2 == 0 && round % 3 == 2 { [0.0; 3] } else { [bright, 0.5, 0.0] })
            })
            .collect();
        let camera = Camera::looking_at(DVec3::ZERO, DVec3::Z, [64, 48], 0.7);
        holds(&format!("layers {round}"), &gaussians(&layers), &camera, Background::BLACK);
    }
}

#[test]
fn errors_stay_below_the_certificate_along_rays() {
    for (i, (name, camera)) in all([64, 48]).into_iter().enumerate() {
        let scene = around(&mut Random(30 + i as u64), &camera, 500);
        holds(name, &scene, &camera, Background::Colour([0.2, 0.9, 0.4]));
    }
    let pinhole = Camera { lens: None, ..through("PINHOLE", &[], [64, 48], 2.2) };
    let scene = around(&mut Random(60), &pinhole, 500);
    responds("pinhole along rays", &scene, &pinhole, Background::BLACK, Response::Ray);
}

/// The error of the projection is in the certificate against rays, for pictures of every path, and not in the others.
#[test]
fn errors_of_the_projection_stay_below_the_certificate_against_rays() {
    let gpu = Gpu::new();
    let camera = Camera { lens: None, ..through("PINHOLE", &[], [64, 48], 2.2) };
    let scene = around(&mut Random(61), &camera, 500);
    let background = Background::Colour([0.2, 0.9, 0.4]);
    let rules = Rules { response: Response::Ray, ..Rules::TRAINED };
    let complete = reference::render(&scene, &camera, &rules.complete(), background);
    let statistics = Statistics::of(&scene);
    for (name, options) in settings() {
        let gpu_scene = GpuScene::certifiable(&gpu.0, &scene, &statistics, &options).unwrap();
        let mut still = Renderer::new(&gpu.0, &options, &gpu_scene).unwrap();
        still.render(&camera, background).unwrap();
        let picture = still.pixels().unwrap();
        let mut certifier = RayCertifier::new(&gpu.0, &options, &gpu_scene).unwrap();
        let certificate = certifier.certificate(&picture, &camera, background).unwrap();
        let mut largest: f64 = 0.0;
        for ((pixel, bound), exact) in picture.rgba.iter().zip(&certificate.rgba).zip(&complete.pixels) {
            let error = (0..3).map(|i| (f64::from(pixel[i]) - exact.colour[i]).abs()).fold(0.0, f64::max);
            assert!(error <= bound[0].into(), "{name}: error {error:e}, bound {:e}", bound[0]);
            largest = largest.max(error);
        }
        println!("{name}: {largest} {}", certificate.largest());
        assert!(largest > 0.05 && f64::from(certificate.largest()) < 20.0 * largest, "{name}: {largest}");
        if name == "exact" {
            let [drawn, projected] = certified(&gpu, &scene, &camera, &options, background);
            let is_passed = |((pixel, bound), exact): ((&[f32; 4], &[f32; 4]), &reference::Pixel)| {
                (0..3).any(|i| (f64::from(pixel[i]) - exact.colour[i]).abs() > bound[i].into())
            };
            let passed = drawn.rgba.iter().zip(&projected.rgba).zip(&complete.pixels).filter(|one| is_passed(*one));
            assert!(passed.count() > 100, "the certificate of the projection has no error of the projection");
        }
    }
}

#[test]
fn a_certified_picture_along_rays_is_that_of_the_path_rays() {
    let gpu = Gpu::new();
    for (name, camera) in all([61, 37]) {
        let scene = around(&mut Random(8), &camera, 400);
        for (setting, options) in settings() {
            let [picture, certificate] = certified(&gpu, &scene, &camera, &options, Background::BLACK);
            let portable = Options { portable: true, ..options };
            assert!(picture == gpu.render(&scene, &camera, &portable), "{name}, {setting}");
            let sees = |i: usize| camera.ray(DVec2::new((i % 61) as f64 + 0.5, (i / 61) as f64 + 0.5)).is_some();
            assert!((0..61 * 37).all(|i| sees(i) || certificate.rgba[i] == [0.0, 0.0, 0.0, 1.0]), "{name}, {setting}");
        }
    }
}

#[test]
fn a_certified_picture_is_that_of_the_portable_path() {
    let gpu = Gpu::new();
    let scene = cactus(5000).unwrap().gaussians;
    let camera = Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), [100, 70], 0.9);
    for (name, options) in settings() {
        let [picture, _] = certified(&gpu, &scene, &camera, &options, Background::BLACK);
        let portable = Options { portable: true, ..options };
        assert!(picture == gpu.render(&scene, &camera, &portable), "{name}");
        // Where the fast path would draw, another picture than without a certificate is announced.
        let gpu_scene = GpuScene::new(&gpu.0, &scene, &options).unwrap();
        let mut plain = Renderer::new(&gpu.0, &options, &gpu_scene).unwrap();
        let is_another = plain.render(&camera, Background::BLACK).unwrap().path == Path::Fast;
        let certifying = Renderer::certified(&gpu.0, &options, &gpu_scene).unwrap();
        assert_eq!(certifying.notice().is_some_and(|notice| notice.contains("certificates")), is_another, "{name}");
    }
}

#[test]
fn the_certificate_of_an_empty_picture_is_zero() {
    let gpu = Gpu::new();
    let camera = Camera::looking_at(DVec3::ZERO, DVec3::Z, [40, 30], 1.0);
    let [_, certificate] = certified(&gpu, &gaussians(&[]), &camera, &Options::EXACT, Background::BLACK);
    assert!(certificate.rgba.iter().all(|p| p[0] == 0.0));
}
