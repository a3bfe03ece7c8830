//! Scenes turned, moved, scaled and joined: what a camera sees of them.

use crate::common::cloud::{self, cloud};
use crate::common::free::build;
use crate::common::{ROUNDING, Random, compare};
use glam::{DMat3, DQuat, DVec3};
use smalto::camera::Camera;
use smalto::options::Options;
use smalto::procedural::cactus;
use smalto::reference::{Rendering, render};
use smalto::rules::{Background, Rules};
use smalto::scene::harmonics::basis;
use smalto::scene::{Gaussians, MAX_SH_DEGREE, Transform, sh_coefficients};

fn some_scene(seed: u64, count: usize, degree: u32) -> Gaussians {
    build(&cloud(&mut Random(seed), count, degree, 0.4), degree)
}

fn some_transform() -> Transform {
    let turn = DQuat::from_xyzw(0.3, -0.6, 0.2, 0.7).normalize();
    Transform::new(turn, DVec3::new(-3.0, 2.5, 11.0), 1.75).unwrap()
}

/// The colour of the first Gaussian seen along `direction`, before it is clamped.
fn colour(gaussians: &Gaussians, direction: DVec3) -> DVec3 {
    let basis = basis(direction.to_array());
    let parts = gaussians.sh(0).iter().zip(basis).map(|(k, value)| value * DVec3::from(k.map(f64::from)));
    parts.sum()
}

fn picture(gaussians: &Gaussians, camera: &Camera, rules: &Rules) -> Rendering {
    render(gaussians, camera, rules, Background::BLACK)
}

#[test]
fn spherical_harmonics_turn_with_the_scene() {
    let mut random = Random(7);
    for degree in 0..=MAX_SH_DEGREE {
        for seed in 0..20 {
            let scene = some_scene(seed, 1, degree);
            let turn = DQuat::from_xyzw(
                random.between(-1.0, 1.0),
                random.between(-1.0, 1.0),
                random.between(-1.0, 1.0),
                random.between(-1.0, 1.0),
            );
            let transform = Transform::new(turn, DVec3::ONE, 2.0).unwrap();
            let turned = scene.transformed(&transform).unwrap();
            for _ in 0..50 {
                let d = DVec3::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0), random.between(-1.0, 1.0));
                let (d, back) = (d.normalize(), transform.rotation().conjugate() * d.normalize());
                let error = (colour(&turned, d) - colour(&scene, back)).abs().max_element();
                assert!(error < 1e-5, "degree {degree}: {error}");
            }
        }
    }
}

#[test]
fn the_identity_transform_changes_no_bit() {
    let scene = cactus(5000).unwrap().gaussians;
    let same = scene.transformed(&Transform::IDENTITY).unwrap();
    assert_eq!(same, scene);
    let bits = |g: &Gaussians| g.rotations().iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&same), bits(&scene));
}

#[test]
fn a_transformed_scene_looks_the_same_from_a_transformed_camera() {
    let scene = some_scene(3, 300, MAX_SH_DEGREE);
    let transform = some_transform();
    let camera = cloud::camera();
    let there = Camera {
        position: transform.point(camera.position),
        rotation: camera.rotation * DMat3::from_quat(transform.rotation()).transpose(),
        ..camera.clone()
    };
    let rules = Options::EXACT.rules;
    let far = Rules { near: (f64::from(rules.near) * transform.scale()) as f32, ..rules };
    let expected = picture(&scene, &camera, &rules);
    let moved = picture(&scene.transformed(&transform).unwrap(), &there, &far);
    let found = compare(&moved.to_pixels(), &expected);
    assert_eq!(found.unexplained, 0, "{found:?}");
    assert!(found.psnr > 90.0, "{found:?}");
    // The same picture from the camera that stayed would be a test of nothing.
    let stayed = picture(&scene.transformed(&transform).unwrap(), &camera, &rules);
    assert!(compare(&stayed.to_pixels(), &expected).max_error > 100.0 * ROUNDING as f32);
}

#[test]
fn transforms_compose_and_invert() {
    let (a, b) = (some_transform(), Transform::new(DQuat::from_rotation_x(2.0), DVec3::Y, 0.1).unwrap());
    let point = DVec3::new(0.3, -7.0, 2.0);
    assert!(a.then(&b).unwrap().point(point).distance(b.point(a.point(point))) < 1e-12);
    assert!(a.inverse().unwrap().point(a.point(point)).distance(point) < 1e-12);
    let scene = some_scene(9, 100, 2);
    let back = scene.transformed(&a).unwrap().transformed(&a.inverse().unwrap()).unwrap();
    for (i, (ours, expected)) in back.means().iter().zip(scene.means()).enumerate() {
        for axis in 0..3 {
            assert!((ours[axis] - expected[axis]).abs() < 1e-5, "{i}");
        }
        for (ours, expected) in back.sh(i).iter().flatten().zip(scene.sh(i).iter().flatten()) {
            assert!((ours - expected).abs() < 1e-6, "{i}");
        }
    }
}

#[test]
fn transforms_that_are_no_similarities_are_refused() {
    for (turn, shift, scale) in [
        (DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), DVec3::ZERO, 1.0),
        (DQuat::IDENTITY, DVec3::NAN, 1.0),
        (DQuat::IDENTITY, DVec3::ZERO, 0.0),
        (DQuat::IDENTITY, DVec3::ZERO, -1.0),
        (DQuat::IDENTITY, DVec3::ZERO, f64::INFINITY),
    ] {
        assert!(Transform::new(turn, shift, scale).is_err());
    }
}

#[test]
fn a_transform_beyond_floats_is_refused() {
    let scene = some_scene(1, 10, 0);
    let far = Transform::new(DQuat::IDENTITY, DVec3::X * 1e39, 1.0).unwrap();
    assert!(scene.transformed(&far).unwrap_err().to_string().contains("Gaussian 0 would lie at"));
}

#[test]
fn joined_scenes_draw_as_their_union() {
    let parts = [some_scene(1, 60, 4), some_scene(2, 40, 0), some_scene(3, 80, 2)];
    let all = Gaussians::joined(parts.iter()).unwrap();
    assert_eq!((all.len(), all.sh_degree()), (180, 4));
    // The same Gaussians read as one scene.
    let degrees = [4, 0, 2];
    let mut union = Vec::new();
    for (part, degree) in degrees.iter().enumerate() {
        let mut free = cloud(&mut Random(part as u64 + 1), parts[part].len(), *degree, 0.4);
        free.iter_mut().for_each(|one| one.sh.resize(sh_coefficients(4), [0.0; 3]));
        union.extend(free);
    }
    let union = build(&union, 4);
    assert_eq!(all, union);
    let rules = Options::EXACT.rules;
    let draw = |scene: &Gaussians| picture(scene, &cloud::camera(), &rules).to_pixels();
    assert_eq!(draw(&all), draw(&union));
    assert_ne!(draw(&all), draw(&parts[0]));
    assert_eq!(Gaussians::joined(std::iter::empty()).unwrap(), Gaussians::default());
}
