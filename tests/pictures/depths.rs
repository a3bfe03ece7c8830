//! Layers of depths and counts, against the f64 reference.

use crate::common::agree::{GREEN, RED, ahead, ball};
use crate::common::cloud::{camera, cloud};
use crate::common::free::build;
use crate::common::listed::Listed;
use crate::common::{Gpu, Random, captured_cameras, gaussians, read_captured};
use glam::DVec3;
use smalto::camera::Camera;
use smalto::options::Options;
use smalto::pixels::{Depths, Plane};
use smalto::procedural::cactus;
use smalto::reference;
use smalto::render::{GpuScene, Inspection, Look, Renderer, Work, depths};
use smalto::rules::{Background, Rules};
use smalto::scene::Gaussians;

/// What f32 arithmetic may change of an expected depth, as a part of it: 3e-6 measured; and of a median, one splat's
/// depth.
pub(super) const ROUNDING: f64 = 1e-5;

const ROUNDING_OF_ONE: f64 = 1e-6;

const DEPTHS: Look = Look::Work(Work::Depths);

fn drawn(gpu: &Gpu, scene: &Gaussians, camera: &Camera, options: &Options) -> Depths {
    let scene = GpuScene::new(&gpu.0, scene, options).unwrap();
    let mut still = Renderer::new(&gpu.0, options, &scene).unwrap();
    still.set_inspection(Inspection { look: DEPTHS, ..Inspection::default() }).unwrap();
    // The background lies nowhere.
    still.render(camera, Background::Colour([0.3; 3])).unwrap();
    depths(&still.pixels().unwrap())
}

fn exact(scene: &Gaussians, camera: &Camera, rules: &Rules) -> reference::Rendering {
    reference::render(scene, camera, rules, Background::BLACK)
}

/// A random scene and a procedural one, each with a view.
fn cases() -> Vec<(Gaussians, Camera)> {
    let from = DVec3::new(1.5, -2.5, -4.0);
    let cactus = cactus(8000).unwrap().gaussians;
    vec![
        (build(&cloud(&mut Random(5), 400, 2, 0.3), 2), camera()),
        (cactus, Camera::looking_at(from, DVec3::new(0.0, -1.2, 0.0), [100, 70], 0.9)),
    ]
}

fn captured_case() -> Vec<(Gaussians, Camera)> {
    let camera = captured_cameras("biker.orbit.cameras.json", &[10], [120, 80]).remove(0);
    vec![(read_captured("biker.spz"), camera)]
}

/// One behind the other, in the middle of the middle pixel, with nothing around them.
fn two_balls() -> (Gaussians, Camera) {
    let scene = gaussians(&[(ball([0.0, 0.0, 4.0], 0.2, 0.5), GREEN), (ball([0.0, 0.0, 2.0], 0.1, 0.4), RED)]);
    (scene, ahead([41, 31], 40.0))
}

/// As a part of what is expected; 0 if there is none of either.
pub(super) fn apart(value: f32, expected: f32) -> f64 {
    if value.is_nan() && expected.is_nan() { 0.0 } else { f64::from((value - expected).abs() / expected) }
}

#[test]
fn depths_and_counts_are_those_of_the_reference() {
    check_depths(cases());
}

#[test]
#[ignore = "needs the captured scenes (SMALTO_TEST_SCENES)"]
fn depths_and_counts_of_a_captured_scene_are_those_of_the_reference() {
    check_depths(captured_case());
}

fn check_depths(cases: Vec<(Gaussians, Camera)>) {
    let gpu = Gpu::new();
    let by = |rules: Rules| Options { rules, ..Options::EXACT };
    for (scene, camera) in cases {
        for options in [Options::EXACT, by(Rules::GSPLAT), by(Rules::KHR), by(Rules::INRIA)] {
            let depths = drawn(&gpu, &scene, &camera, &options);
            let rendering = exact(&scene, &camera, &options.rules);
            let expected = rendering.depths();
            let (mut compared, mut medians, mut apart_most) = (0, 0, 0.0_f64);
            for (i, _) in rendering.pixels.iter().enumerate().filter(|(_, exact)| exact.doubt == 0.0) {
                let own = [&depths.expected, &depths.median, &depths.counts].map(|plane| plane.values[i]);
                let of = [&expected.expected, &expected.median, &expected.counts].map(|plane| plane.values[i]);
                // Where hardly any light is left, rounding decides how many splats it takes until none is.
                let counted = rendering.pixels[i].transmittance > 1e-9;
                assert!(!counted || own[2] == of[2], "{own:?} for {of:?} in pixel {i}");
                assert!(apart(own[0], of[0]) <= ROUNDING, "{own:?} for {of:?} in pixel {i}");
                // A transmittance of a half to the last digits passes it a splat earlier or later.
                medians += usize::from(apart(own[1], of[1]) <= ROUNDING_OF_ONE);
                apart_most = apart_most.max(apart(own[0], of[0]));
                compared += 1;
            }
            println!("{:?}: {compared} pixels, {apart_most:.1e}, {} medians", options.rules, compared - medians);
            assert!(compared > rendering.pixels.len() * 9 / 10, "{compared} compared");
            assert!(compared - medians <= compared / 2000, "{} of {compared} medians differ", compared - medians);
        }
    }
}

/// The reference itself, against every pixel's list taken apart.
#[test]
fn depths_of_the_reference_come_from_the_blended_splats() {
    check_depths_of_the_reference(cases());
}

#[test]
#[ignore = "needs the captured scenes (SMALTO_TEST_SCENES)"]
fn depths_of_the_reference_come_from_the_blended_splats_in_a_captured_scene() {
    check_depths_of_the_reference(captured_case());
}

fn check_depths_of_the_reference(cases: Vec<(Gaussians, Camera)>) {
    let mut kinds = [0; 3];
    for (scene, camera) in cases.into_iter().chain([two_balls()]) {
        let lists = Listed::of(&scene, &camera);
        let depths = exact(&scene, &camera, &Rules::TRAINED).depths();
        for pixel in 0..depths.counts.values.len() {
            let (blended, (_, centre)) = (lists.walk(pixel).blended, lists.list(pixel));
            let (mut left, mut sum, mut median) = (1.0, 0.0, f64::NAN);
            for splat in blended.iter().map(|id| &lists.splats[*id as usize]) {
                let alpha =
                    (splat.opacity * (-0.5 * splat.distance(centre)).exp()).min(Rules::TRAINED.alpha_max.into());
                sum += alpha * left * splat.depth;
                left *= 1.0 - alpha;
                median = if median.is_nan() && left <= 0.5 { splat.depth } else { median };
            }
            let own = [&depths.expected, &depths.median, &depths.counts].map(|plane| plane.values[pixel]);
            let mean = if blended.is_empty() { f64::NAN } else { sum / (1.0 - left) };
            assert!(apart(own[0], mean as f32) < 1e-6, "{own:?} for {mean} in pixel {pixel}");
            assert_eq!((own[1].to_bits(), own[2]), ((median as f32).to_bits(), blended.len() as f32), "pixel {pixel}");
            kinds[if mean.is_nan() { 0 } else { 1 + usize::from(!median.is_nan()) }] += 1;
        }
    }
    assert!(kinds.iter().all(|pixels| *pixels > 10), "without anything, without a median, with one: {kinds:?}");
}

#[test]
fn depths_of_two_balls_match_a_calculation_by_hand() {
    let gpu = Gpu::new();
    let (scene, camera) = two_balls();
    let of_reference = exact(&scene, &camera, &Rules::TRAINED).depths();
    for depths in [drawn(&gpu, &scene, &camera, &Options::EXACT), of_reference] {
        let at = |plane: &Plane, x: usize, y: usize| plane.values[y * 41 + x];
        let middle = [&depths.expected, &depths.median, &depths.counts].map(|plane| at(plane, 20, 15));
        // 0.4 of the light stays at 2, half of the rest at 4: less than a half is left there.
        assert!((middle[0] - (0.4 * 2.0 + 0.3 * 4.0) / 0.7).abs() < 1e-5, "{middle:?}");
        assert_eq!(middle[1..], [4.0, 2.0]);
        let corner = [&depths.expected, &depths.median, &depths.counts].map(|plane| at(plane, 0, 0));
        assert!(corner[0].is_nan() && corner[1].is_nan() && corner[2] == 0.0, "{corner:?}");
        assert_eq!(depths.median.size, [41, 31]);
        let faint = depths.median.values.iter().zip(&depths.expected.values).filter(|(m, e)| m.is_nan() && !e.is_nan());
        assert!(faint.count() > 10, "around the balls more than half of the light is left");
    }
}

/// More entries in one tile than llvmpipe lets a loop run, so that it is walked in several passes.
#[test]
fn depths_of_a_list_longer_than_65535_are_complete() {
    let entry = |i: u32| {
        let z = 5.0 + 1e-4 * f64::from(i);
        // The second kind alone is seen in most pixels, little by little.
        if i % 100 == 99 { (ball([0.1, 0.1, z], 0.4, 0.02), GREEN) } else { (ball([-0.35, -0.35, z], 0.002, 0.5), RED) }
    };
    let scene = gaussians(&(0..70_000).map(entry).collect::<Vec<_>>());
    let camera = ahead([16, 16], 100.0);
    let gpu = Gpu::new();
    let depths = drawn(&gpu, &scene, &camera, &Options::EXACT);
    let rendering = exact(&scene, &camera, &Rules::TRAINED);
    let expected = rendering.depths();
    let certain = (0..256).filter(|i| rendering.pixels[*i].doubt == 0.0);
    for i in certain.clone() {
        assert_eq!(depths.counts.values[i], expected.counts.values[i]);
        assert!(apart(depths.expected.values[i], expected.expected.values[i]) < ROUNDING);
        assert!(apart(depths.median.values[i], expected.median.values[i]) < ROUNDING_OF_ONE);
    }
    assert!(certain.count() > 100 && expected.counts.values.iter().any(|count| *count > 200.0));
}

#[test]
fn depths_are_refused_for_scaled_pictures() {
    let gpu = Gpu::new();
    let options = Options { scale: 0.5, ..Options::EXACT };
    let scene = GpuScene::new(&gpu.0, &gaussians(&[(ball([0.0, 0.0, 4.0], 0.2, 0.5), RED)]), &options).unwrap();
    let mut still = Renderer::new(&gpu.0, &options, &scene).unwrap();
    let inspection = Inspection { look: DEPTHS, ..Inspection::default() };
    let error = still.set_inspection(inspection).unwrap_err().to_string();
    assert_eq!(error, "depths need --scale 1: they cannot be enlarged");
}
