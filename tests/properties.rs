//! What must hold whatever the scene: changes to the input that change nothing, or change the picture in a known way.

mod common;

use common::{Gpu, Random, compare};
use glam::{DMat3, DQuat, DVec3, Vec3};
use smalto::camera::Camera;
use smalto::metrics::psnr;
use smalto::options::{Background, Options, Rules};
use smalto::pixels::Pixels;
use smalto::reference;
use smalto::render::{Demand, GpuScene, Still};
use smalto::scene::{Builder, Gaussians, Raw, sh_coefficients, synthetic};

const SIZE: [u32; 2] = [112, 80];

fn camera() -> Camera {
    Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), SIZE, 0.9)
}

/// A Gaussian as it can be changed: raw values and coefficients.
#[derive(Clone)]
struct Free {
    raw: Raw,
    sh: Vec<[f32; 3]>,
}

fn free(gaussians: &Gaussians) -> Vec<Free> {
    let one = |i: usize| {
        let opacity = f64::from(gaussians.opacities()[i]);
        let raw = Raw {
            mean: gaussians.means()[i].map(f64::from),
            log_scale: gaussians.scales()[i].map(|s| f64::from(s).ln()),
            rotation: gaussians.rotations()[i].map(f64::from),
            opacity_logit: (opacity / (1.0 - opacity)).ln(),
        };
        Free { raw, sh: gaussians.sh(i).to_vec() }
    };
    (0..gaussians.len()).map(one).collect()
}

fn build(free: &[Free], degree: u32) -> Gaussians {
    let mut builder = Builder::new(degree, free.len()).unwrap();
    builder.extend(free.len(), |i, sh| {
        sh.copy_from_slice(&free[i].sh[..sh_coefficients(degree)]);
        free[i].raw
    });
    builder.finish().0
}

fn scene() -> Vec<Free> {
    free(&synthetic::cactus(3000).unwrap().gaussians)
}

fn render(scene: &[Free]) -> Pixels {
    render_from(scene, &camera())
}

fn render_from(scene: &[Free], camera: &Camera) -> Pixels {
    Gpu::new().render(&build(scene, 3), camera, &Options::EXACT)
}

#[test]
fn two_renders_are_the_same_bits() {
    let gpu = Gpu::new();
    let scene = synthetic::cactus(20_000).unwrap().gaussians;
    let first = gpu.render(&scene, &camera(), &Options::EXACT);
    assert!(Gpu::new().render(&scene, &camera(), &Options::EXACT) == first);
}

#[test]
fn the_portable_path_draws_the_same_bits() {
    let gpu = Gpu::new();
    let scene = synthetic::cactus(50_000).unwrap().gaussians;
    for camera in [camera(), camera().resized([301, 203])] {
        let default = gpu.render(&scene, &camera, &Options::EXACT);
        assert!(gpu.render(&scene, &camera, &Options { portable: true, ..Options::EXACT }) == default);
    }
}

#[test]
fn the_order_of_the_input_does_not_matter() {
    let mut shuffled = scene();
    let expected = render(&shuffled);
    let mut random = Random(9);
    for i in (1..shuffled.len()).rev() {
        shuffled.swap(i, random.below(i as u32 + 1) as usize);
    }
    assert!(render(&shuffled) == expected);
}

#[test]
fn what_cannot_be_seen_does_not_matter() {
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
fn a_background_shows_through_by_the_transmittance() {
    let gpu = Gpu::new();
    let gaussians = build(&scene()[..800], 3);
    let scene = GpuScene::new(&gpu.0, &gaussians, &Options::EXACT).unwrap();
    let mut still = Still::new(&gpu.0, &Options::EXACT, &scene).unwrap();
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
fn zero_bands_of_harmonics_cost_nothing_of_the_picture() {
    for degree in 0..3 {
        let mut low = scene();
        for gaussian in &mut low {
            gaussian.sh[sh_coefficients(degree)..].fill([0.0; 3]);
        }
        let gpu = Gpu::new();
        let padded = gpu.render(&build(&low, 3), &camera(), &Options::EXACT);
        let exact = gpu.render(&build(&low, degree), &camera(), &Options::EXACT);
        assert!(smalto::metrics::max_error(&padded, &exact) < 1e-6, "degree {degree}");
    }
}

#[test]
fn every_degree_matches_the_reference() {
    let gpu = Gpu::new();
    for degree in 0..=3 {
        let scene = build(&scene(), degree);
        let rendering = reference::render(&scene, &camera(), &Options::EXACT.rules, Background::BLACK);
        let comparison = compare(&gpu.render(&scene, &camera(), &Options::EXACT), &rendering);
        assert!(comparison.unexplained == 0 && comparison.psnr > 90.0, "degree {degree}: {comparison:?}");
    }
}

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
    let options = Options {
        rules: Rules { near: Options::EXACT.rules.near * 16.0, ..Options::EXACT.rules },
        ..Options::EXACT
    };
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

#[test]
fn a_frame_that_did_not_fit_stays_incomplete_when_the_room_has_grown_since() {
    let gpu = Gpu::new();
    let gaussians = synthetic::cactus(2000).unwrap().gaussians;
    let scene = GpuScene::new(&gpu.0, &gaussians, &Options::EXACT).unwrap();
    let camera = camera();
    let room = Demand { gaussians: 2000, visible: 2000, spans: 9000, instances: 10, tiles: 35 };
    let mut still = Still::new(&gpu.0, &Options::EXACT, &scene).unwrap().with_room(room).unwrap();
    let [first, second] = [(); 2].map(|()| still.start(&camera, Background::BLACK).unwrap());
    assert!(!still.finish(first).unwrap());
    assert!(!still.finish(second).unwrap(), "it was begun in the room of the first");
    let third = still.start(&camera, Background::BLACK).unwrap();
    assert!(still.finish(third).unwrap());
    assert!(still.pixels().unwrap() == gpu.render(&gaussians, &camera, &Options::EXACT));
}
