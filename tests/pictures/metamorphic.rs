//! Changes to the world and the camera whose effect on the picture is known.

use crate::common::agree::{ahead, logit, reference_of};
use crate::common::free::{Free, SIZE, build, camera, moved, render, render_from, scene};
use crate::common::{Gpu, ROUNDING, Random, again_in_subgroups_of_four, difference, gaussians};
use glam::{DMat3, DQuat, DVec3, Vec3, dvec2};
use smalto::camera::Camera;
use smalto::measure::metrics::{max_error, psnr};
use smalto::options::Options;
use smalto::pixels::Pixels;
use smalto::rules::{Order, Rules};
use smalto::scene::Raw;

/// PSNR of all pixels but the one in a thousand that differs most. There an alpha may have fallen on the other side of
/// 1/255, or a transmittance of its threshold: no farther than 0.0101 of the brightest colour, which is below 2.
fn psnr_but_for_flips(a: &Pixels, b: &Pixels) -> f64 {
    assert!(max_error(a, b) < 0.0202, "{} is more than a flip", max_error(a, b));
    let error = |(a, b): &([f32; 4], [f32; 4])| (0..3).map(|i| (a[i] - b[i]).abs()).fold(0.0, f32::max);
    let mut pairs: Vec<_> = a.rgba.iter().copied().zip(b.rgba.iter().copied()).collect();
    pairs.sort_by(|a, b| error(a).total_cmp(&error(b)));
    pairs.truncate(pairs.len() - pairs.len() / 1000);
    let (a, b): (Vec<_>, Vec<_>) = pairs.into_iter().unzip();
    let row = |rgba: Vec<[f32; 4]>| Pixels { size: [rgba.len() as u32, 1], rgba };
    psnr(&row(a), &row(b))
}

/// The scene without what depends on the direction that it is seen from.
fn matt() -> Vec<Free> {
    let mut matt = scene();
    matt.iter_mut().for_each(|gaussian| gaussian.sh[1..].fill([0.0; 3]));
    matt
}

fn moved_camera(turn: DQuat, shift: DVec3) -> Camera {
    let camera = camera();
    let rotation = camera.rotation * DMat3::from_quat(turn).transpose();
    Camera { position: turn * camera.position + shift, rotation, ..camera }
}

/// World, camera and near plane `factor` times as large.
fn scaled(scene: &[Free], factor: f64, order: Order) -> Pixels {
    let mut scaled = scene.to_vec();
    for gaussian in &mut scaled {
        gaussian.raw.mean = gaussian.raw.mean.map(|v| v * factor);
        gaussian.raw.log_scale = gaussian.raw.log_scale.map(|v| v + factor.ln());
    }
    let there = Camera { position: camera().position * factor, ..camera() };
    let options = Options {
        rules: Rules { near: (f64::from(Options::EXACT.rules.near) * factor) as f32, order, ..Options::EXACT.rules },
        ..Options::EXACT
    };
    Gpu::new().render(&build(&scaled, 3), &there, &options)
}

#[test]
fn exchanging_the_axes_of_a_gaussian_changes_nothing() {
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
    assert!(psnr_but_for_flips(&render(&exchanged), &expected) > 90.0);
}

#[test]
fn turning_world_and_camera_changes_nothing() {
    let matt = matt();
    let expected = render(&matt);
    for (axis, angle) in [(DVec3::Y, 1.0), (DVec3::new(1.0, 2.0, -1.0), 2.5), (DVec3::new(-3.0, 0.2, 1.0), -0.4)] {
        let turn = DQuat::from_axis_angle(axis.normalize(), angle);
        let pixels = render_from(&moved(&matt, turn, DVec3::ZERO), &moved_camera(turn, DVec3::ZERO));
        assert!(psnr_but_for_flips(&pixels, &expected) > 90.0);
    }
}

/// By millions, where a float is an eighth: of means that are whole eighths, nothing is lost.
#[test]
fn moving_world_and_camera_far_changes_nothing() {
    let mut eighths = matt();
    for gaussian in &mut eighths {
        gaussian.raw.mean = gaussian.raw.mean.map(|v| (v * 8.0).round() / 8.0);
    }
    let expected = render(&eighths);
    let shift = DVec3::new(1_500_000.0, -1_048_576.0, 2_000_000.0);
    let pixels = render_from(&moved(&eighths, DQuat::IDENTITY, shift), &moved_camera(DQuat::IDENTITY, shift));
    assert!(psnr_but_for_flips(&pixels, &expected) > 90.0);
}

/// Up to worlds in which squares of lengths are no floats.
#[test]
fn scaling_world_and_camera_changes_nothing() {
    let scene = scene();
    for order in [Order::Depth, Order::Distance] {
        let expected = scaled(&scene, 1.0, order);
        for power in [-45, -2, 2, 45] {
            // All roundings are the same, but those of a device's square roots.
            let pixels = scaled(&scene, 4_f64.powi(power), order);
            assert!(psnr_but_for_flips(&pixels, &expected) > 100.0, "4^{power}: {} dB", psnr(&pixels, &expected));
        }
        assert!(psnr_but_for_flips(&scaled(&scene, 3.7, order), &expected) > 90.0);
    }
}

#[test]
fn mirroring_the_scene_mirrors_the_picture() {
    let camera = Camera::looking_at(DVec3::new(0.0, -1.2, -5.0), DVec3::new(0.0, -1.2, 0.0), SIZE, 0.9);
    let mut mirrored = matt();
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
    assert!(psnr_but_for_flips(&pixels, &expected) > 100.0);
}

#[test]
fn turning_the_camera_upside_down_turns_the_picture() {
    let (scene, camera) = (scene(), camera());
    let rolled = DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0)) * camera.rotation;
    let mut pixels = render_from(&scene, &Camera { rotation: rolled, ..camera });
    pixels.rgba.reverse();
    assert!(psnr_but_for_flips(&pixels, &render(&scene)) > 100.0);
}

/// Strips that begin anywhere in a tile, each a picture of its own: together they are the whole. The splats are flat
/// and face the camera: so the clamp of the Jacobian, which depends on the size of the image, has no say.
#[test]
fn strips_join_to_the_whole_picture() {
    let mut random = Random(21);
    let raws: Vec<_> = (0..500)
        .map(|i| {
            let z = 3.0 + 0.01 * f64::from(i);
            let mean = [z * random.between(-0.8, 0.8), z * random.between(-0.6, 0.6), z];
            let turn = random.between(0.0, 3.0);
            let log_scale = [random.between(-5.0, 0.5), random.between(-5.0, 0.5), f64::NEG_INFINITY];
            let raw = Raw {
                mean,
                log_scale,
                rotation: [turn.cos(), 0.0, 0.0, turn.sin()],
                opacity_logit: logit(random.between(0.01, 0.99)),
            };
            (raw, std::array::from_fn(|_| random.between(0.0, 1.0) as f32))
        })
        .collect();
    let scene = gaussians(&raws);
    let camera = ahead([120, 90], 80.0);
    let whole = reference_of(&scene, &camera);
    let gpu = Gpu::new();
    let window = |corner: [u32; 2], size_px: [u32; 2]| {
        let centre_px = camera.centre_px - dvec2(corner[0].into(), corner[1].into());
        let pixels = gpu.render(&scene, &Camera { centre_px, size_px, ..camera.clone() }, &Options::EXACT);
        for (i, pixel) in pixels.rgba.iter().enumerate() {
            let [x, y] = [corner[0] + i as u32 % size_px[0], corner[1] + i as u32 / size_px[0]];
            let exact = &whole.pixels[(y * camera.size_px[0] + x) as usize];
            let error = difference((pixel, exact));
            assert!(error <= ROUNDING + exact.doubt, "pixel {x}, {y}: {pixel:?} for {exact:?}");
        }
    };
    let mut begin = 0;
    for length in [1, 7, 21, 16, 5, 23, 17, 30] {
        if begin + length <= 90 {
            window([0, begin], [120, length]);
        }
        window([begin, 0], [length, 90]);
        begin += length;
    }
}

/// Pixels cut out of a picture are those of a camera with a shifted principal point.
#[test]
fn a_crop_of_the_camera_is_a_crop_of_the_picture() {
    // Without the backdrop: the clamp of the Jacobian follows the window, and moves large splats that lie outside of
    // it.
    let near: Vec<Free> = scene().into_iter().filter(|g| DVec3::from(g.raw.mean).length() < 4.0).collect();
    let whole = render(&near);
    let (left, top) = (21, 13);
    let mut window = camera();
    window.size_px = [64, 48];
    window.centre_px -= dvec2(f64::from(left), f64::from(top));
    let pixels = render_from(&near, &window);
    let inside = |x: u32, y: u32| Vec3::from_slice(&whole.at(left + x, top + y)) - Vec3::from_slice(&pixels.at(x, y));
    let errors = (0..48).flat_map(|y| (0..64).map(move |x| (x, y))).map(|(x, y)| inside(x, y).abs().max_element());
    let mut errors: Vec<f32> = errors.collect();
    errors.sort_unstable_by(f32::total_cmp);
    assert!(errors[errors.len() * 99 / 100] < 1e-3, "{}", errors[errors.len() * 99 / 100]);
}

#[test]
fn pictures_follow_the_world_in_subgroups_of_four() {
    again_in_subgroups_of_four(&["metamorphic::", "--skip", "subgroups_of_four"]);
}
