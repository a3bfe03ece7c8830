//! Whole frames: the GPU against the f64 reference, and against itself.

use crate::common::{Gpu, captured_cameras, compare, read_captured};
use smalto::camera::Camera;
use smalto::options::Options;
use smalto::procedural::cactus;
use smalto::reference;
use smalto::rules::Background;
use smalto::scene::Gaussians;

const SIZE: [u32; 2] = [480, 270];

fn matches_the_reference(name: &str, gaussians: &Gaussians, cameras: &[Camera]) {
    let gpu = Gpu::new();
    let options = Options::EXACT;
    for (i, camera) in cameras.iter().enumerate() {
        let rendering = reference::render(gaussians, camera, &options.rules, Background::BLACK);
        let comparison = compare(&gpu.render(gaussians, camera, &options), &rendering);
        println!("{name} camera {i}: {comparison:?}");
        assert!(comparison.psnr >= 90.0, "{name} camera {i}: {comparison:?}");
        assert_eq!(comparison.unexplained, 0, "{name} camera {i}: {comparison:?}");
        assert!(
            comparison.different <= rendering.pixels.len() / 1000,
            "{name} camera {i}: at most 0.1 % flip: {comparison:?}"
        );
    }
}

#[test]
fn frame_matches_the_reference_on_the_cactus() {
    let scene = cactus(cactus::DEFAULT_COUNT).unwrap().gaussians;
    let target = glam::DVec3::new(0.0, -1.2, 0.0);
    let cameras = [(3.0, -2.5, -4.0), (-1.2, -1.5, -1.4), (0.2, -5.0, 0.1)]
        .map(|(x, y, z)| Camera::looking_at(glam::DVec3::new(x, y, z), target, SIZE, 1.0));
    matches_the_reference("cactus", &scene, &cameras);
}

#[test]
#[ignore = "needs the captured scenes (SMALTO_TEST_SCENES)"]
fn frame_matches_the_reference_on_captured_biker() {
    let cameras = captured_cameras("biker.orbit.cameras.json", &[0, 35, 70], SIZE);
    matches_the_reference("biker", &read_captured("biker.compressed.ply"), &cameras);
}

#[test]
#[ignore = "needs the captured scenes (SMALTO_TEST_SCENES)"]
fn frame_matches_the_reference_on_captured_plush_215k() {
    let cameras = captured_cameras("plush.cameras.json", &[0, 40, 80], SIZE);
    matches_the_reference("plush-215k", &read_captured("plush-215k.spz"), &cameras);
}

#[test]
#[ignore = "needs the captured scenes (SMALTO_TEST_SCENES)"]
fn frame_matches_the_reference_on_captured_playbot() {
    let cameras = captured_cameras("playbot.orbit.cameras.json", &[10], SIZE);
    matches_the_reference("playbot", &read_captured("playbot.spz"), &cameras);
}

#[test]
#[ignore = "needs the captured scenes (SMALTO_TEST_SCENES)"]
fn frame_matches_the_reference_on_captured_plush_1940k() {
    let cameras = captured_cameras("plush.cameras.json", &[0, 50], SIZE);
    matches_the_reference("plush-1940k", &read_captured("plush-1940k.spz"), &cameras);
}
