//! Positions far from the origin: they are moved before they are rounded to 32-bit floats, and roundings are counted.

use glam::{DQuat, DVec3};
use smalto::formats::{Loss, Reading};
use smalto::procedural::Procedural;
use smalto::scene::{Gaussians, Scene, Transform, Watch};

use crate::common::table::fixture;

/// The first Gaussian of the fixture, in UTM coordinates.
const ORIGIN: [f64; 3] = [500_123.37, 5_301_234.61, 412.125];
/// The others, relative to it.
const LOCAL: [[f64; 3]; 5] = [[0.0; 3], [0.3, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.3], [0.21, 0.21, 0.06]];

fn reading(transform: Transform, flip: [bool; 3]) -> Reading {
    Reading { transform, flip, ..Reading::default() }
}

fn read(reading: &Reading) -> Scene {
    reading.read(&fixture("far/utm.ply")).unwrap()
}

/// The transform that moves the first Gaussian to the origin, then turns and scales.
fn moved(turn: DQuat, scale: f64) -> Transform {
    let back = Transform::new(DQuat::IDENTITY, -DVec3::from(ORIGIN), 1.0).unwrap();
    back.then(&Transform::new(turn, DVec3::ZERO, scale).unwrap()).unwrap()
}

fn assert_means(found: &Gaussians, expected: impl Fn(DVec3) -> DVec3) {
    for (found, local) in found.means().iter().zip(LOCAL) {
        let error = (DVec3::from(found.map(f64::from)) - expected(local.into())).abs().max_element();
        // Half a step of 32-bit floats at 0.6 m; one of doubles at 5301 km is 1e-9.
        assert!(error < 4e-8, "{found:?}: {error}");
    }
}

#[test]
fn positions_are_rounded_after_the_transform() {
    let scene = read(&reading(moved(DQuat::IDENTITY, 1.0), [false; 3]));
    assert_means(&scene.gaussians, |local| local);
    assert!(scene.report.is_clean() && scene.report.displacement < 4e-8, "{:?}", scene.report);
    let turn = DQuat::from_rotation_z(0.7) * DQuat::from_rotation_x(-0.2);
    assert_means(&read(&reading(moved(turn, 2.0), [false; 3])).gaussians, |local| 2.0 * (turn * local));
    // Axes are reversed first.
    let flipped = Transform::new(DQuat::IDENTITY, DVec3::new(-ORIGIN[0], ORIGIN[1], -ORIGIN[2]), 1.0).unwrap();
    let scene = read(&reading(flipped, [false, true, false]));
    assert_means(&scene.gaussians, |local| local * DVec3::new(1.0, -1.0, 1.0));
}

#[test]
fn blocks_are_moved_as_whole_scenes_are() {
    let reading = reading(moved(DQuat::from_rotation_y(1.0), 3.0), [true, false, false]);
    let mut blocks = Vec::new();
    let mut take = |block, _| {
        blocks.push(block);
        Ok(())
    };
    reading.read_blocks(&fixture("far/utm.ply"), &Watch::NONE, &mut take).unwrap().unwrap();
    assert_eq!(Gaussians::joined(blocks.iter()).unwrap(), read(&reading).gaussians);
}

#[test]
fn roundings_are_counted_and_belong_to_the_loss() {
    let scene = read(&Reading::default());
    let report = scene.report;
    assert!(!report.is_clean());
    assert!(report.displaced >= 4, "{report:?}");
    // A step of 32-bit floats at 5301 km is 0.5.
    assert!(report.displacement > 0.1 && report.displacement < 0.26, "{report:?}");
    let said = report.to_string();
    assert!(said.contains("moved by over a tenth of their size") && said.contains("32-bit floats"), "{said}");
    let loss = Loss::with_reading(Loss::between(&scene.gaussians, &scene.gaussians), &report);
    assert_eq!((loss[0].attribute, loss[0].largest), ("position", report.displacement));
    assert!(loss[0].rms > 0.05 && loss[0].rms <= loss[0].largest);
    assert!(loss[1..].iter().all(|loss| loss.largest == 0.0));
    // Files of floats lose nothing.
    let plain = Reading::default().read(&fixture("plush.ply")).unwrap().report;
    assert_eq!((plain.displaced, plain.displacement), (0, 0.0));
}

#[test]
fn a_scene_that_vanishes_or_leaves_the_floats_is_reported() {
    let tiny = Transform::new(DQuat::IDENTITY, DVec3::ZERO, 1e-300).unwrap();
    for name in ["far/utm.ply", "plush.ply", "plush.v4.spz", "plush.glb"] {
        let scene = reading(tiny, [false; 3]).read(&fixture(name)).unwrap();
        let all = scene.gaussians.len();
        assert!(scene.gaussians.scales().iter().all(|scale| *scale == [0.0; 3]), "{name}");
        assert_eq!((scene.report.vanished, scene.report.is_clean()), (all, false), "{name}");
        assert!(scene.report.displacement > 0.0 && scene.report.displaced > 0, "{name}");
        let far = Transform::new(DQuat::IDENTITY, DVec3::X * 1e300, 1.0).unwrap();
        let error = reading(far, [false; 3]).read(&fixture(name)).unwrap_err().to_string();
        assert!(error.contains("Gaussians can be drawn") && error.contains("too large for 32-bit floats"), "{error}");
    }
}

/// What was in memory in 32-bit floats is transformed as a file is.
#[test]
fn generated_scenes_are_placed_as_files_are() {
    let cactus = || Procedural::parse("cactus:200").unwrap().unwrap();
    let made = Reading::default().make(cactus()).unwrap();
    let transform = Transform::new(DQuat::from_rotation_x(0.5), DVec3::new(1.0, 2.0, 3.0), 2.0).unwrap();
    let placed = reading(transform, [false, true, false]).make(cactus()).unwrap();
    let expected = made.gaussians.flipped([false, true, false]).transformed(&transform).unwrap();
    let losses = Loss::between(&expected, &placed.gaussians);
    assert!(losses.iter().all(|loss| loss.largest < 2e-6 || loss.attribute == "rotation"), "{losses:?}");
    assert!(losses.iter().all(|loss| loss.largest < 2e-5), "{losses:?}");
    assert_eq!(placed.gaussians.opacities(), expected.opacities(), "opacities keep their bits");
}
