//! Changes to the world that the camera follows: the picture must follow too.

mod common;

use common::free::{Free, SIZE, build, camera, render, render_from, scene};
use common::{Gpu, exact};
use glam::{DMat3, DQuat, DVec3, Vec3};
use smalto::camera::Camera;
use smalto::metrics::psnr;
use smalto::options::Options;

#[test]
fn the_axes_of_a_gaussian_can_be_exchanged() {
    let mut exchanged = scene();
    let expected = render(&exchanged);
    // A quarter turn about the local z axis swaps the first two scales.
    let quarter = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
    for gaussian in &mut exchanged {
        let [w, x, y, z] = gaussian.raw.rotation;
        let q = DQuat::from_xyzw(x, y, z, w) * quarter;
        gaussian.raw.rotation = [q.w, q.x, q.y, q.z];
        gaussian.raw.log_scale.swap(0, 1);
    }
    assert!(psnr(&render(&exchanged), &expected) > 90.0);
}

/// Without view-dependent colour, turning and moving everything changes nothing.
#[test]
fn world_and_camera_can_move_together() {
    let mut moved = scene();
    for gaussian in &mut moved {
        gaussian.sh[1..].fill([0.0; 3]);
    }
    let expected = render(&moved);
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 2.0);
    let shift = DVec3::new(12.0, -7.0, 30.0);
    for gaussian in &mut moved {
        gaussian.raw.mean = (turn * DVec3::from(gaussian.raw.mean) + shift).to_array();
        let [w, x, y, z] = gaussian.raw.rotation;
        let q = turn * DQuat::from_xyzw(x, y, z, w);
        gaussian.raw.rotation = [q.w, q.x, q.y, q.z];
    }
    let camera = camera();
    let there = Camera {
        position: turn * camera.position + shift,
        rotation: camera.rotation * DMat3::from_quat(turn).transpose(),
        ..camera
    };
    // The means are rounded to f32 anew, at thirty times their size.
    assert!(psnr(&render_from(&moved, &there), &expected) > 75.0);
}

#[test]
fn a_scene_scaled_by_a_power_of_two_is_the_same() {
    let mut scaled = scene();
    let expected = render(&scaled);
    for gaussian in &mut scaled {
        gaussian.raw.mean = gaussian.raw.mean.map(|v| v * 16.0);
        gaussian.raw.log_scale = gaussian.raw.log_scale.map(|v| v + 16.0_f64.ln());
    }
    let there = Camera { position: camera().position * 16.0, ..camera() };
    let options = Options { near: exact().near * 16.0, ..exact() };
    let pixels = Gpu::new().render(&build(&scaled, 3), &there, &options);
    assert!(psnr(&pixels, &expected) > 90.0);
}

#[test]
fn a_mirrored_scene_makes_a_mirrored_picture() {
    let camera = Camera::looking_at(DVec3::new(0.0, -1.2, -5.0), DVec3::new(0.0, -1.2, 0.0), SIZE, 0.9);
    let mut mirrored = scene();
    for gaussian in &mut mirrored {
        gaussian.sh[1..].fill([0.0; 3]);
    }
    let expected = render_from(&mirrored, &camera);
    for gaussian in &mut mirrored {
        gaussian.raw.mean[0] = -gaussian.raw.mean[0];
        gaussian.raw.rotation[2] = -gaussian.raw.rotation[2];
        gaussian.raw.rotation[3] = -gaussian.raw.rotation[3];
    }
    let mut pixels = render_from(&mirrored, &camera);
    for row in pixels.rgba.chunks_mut(SIZE[0] as usize) {
        row.reverse();
    }
    assert!(psnr(&pixels, &expected) > 90.0);
}

/// Pixels cut out of a picture are those of a camera with a shifted principal point.
#[test]
fn a_window_of_the_picture_is_the_picture() {
    // Without the backdrop: the clamp of the Jacobian follows the window, and moves large splats that lie outside of it.
    let near: Vec<Free> = scene().into_iter().filter(|g| DVec3::from(g.raw.mean).length() < 4.0).collect();
    let whole = render(&near);
    let (left, top) = (21, 13);
    let mut window = camera();
    window.size_px = [64, 48];
    window.centre_px -= glam::dvec2(f64::from(left), f64::from(top));
    let pixels = render_from(&near, &window);
    let inside = |x: u32, y: u32| Vec3::from_slice(&whole.at(left + x, top + y)) - Vec3::from_slice(&pixels.at(x, y));
    let errors = (0..48).flat_map(|y| (0..64).map(move |x| (x, y))).map(|(x, y)| inside(x, y).abs().max_element());
    let mut errors: Vec<f32> = errors.collect();
    errors.sort_unstable_by(f32::total_cmp);
    assert!(errors[errors.len() * 99 / 100] < 1e-3, "{}", errors[errors.len() * 99 / 100]);
}
