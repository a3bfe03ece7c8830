//! Cameras, image sizes and depths with extreme values.

use crate::common::agree::{GREEN, RED, agrees, agrees_by, ahead, ball, logit, reference_of};
use crate::common::free::{self, Free, build, moved};
use crate::common::{Gpu, Random, again_in_subgroups_of_four, gaussians};
use glam::{DQuat, DVec2, DVec3, dvec2};
use smalto::camera::Camera;
use smalto::options::Options;
use smalto::procedural::cactus;
use smalto::reference;
use smalto::render::{GpuScene, Renderer, Splat};
use smalto::rules::{Background, Rules};
use smalto::scene::{Focus, Raw};

#[test]
fn images_of_any_shape_agree() {
    let scene = cactus(3000).unwrap().gaussians;
    let camera = |size| Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), size, 0.9);
    for size in [[1, 1], [2, 1], [1, 3], [15, 16], [16, 16], [17, 13], [31, 33], [100, 1], [1, 100], [257, 129]] {
        agrees(&format!("{size:?}"), &scene, &camera(size));
    }
}

#[test]
fn images_of_the_largest_width_or_height_agree() {
    let mut random = Random(5);
    let raws: Vec<_> = (0..200)
        .map(|_| {
            let mean = [random.between(-8.0, 8.0), random.between(-8.0, 8.0), random.between(5.0, 15.0)];
            (ball(mean, random.between(0.01, 3.0), random.between(0.1, 0.9)), RED)
        })
        .collect();
    let scene = gaussians(&raws);
    agrees("wide", &scene, &ahead([16384, 3], 10_000.0));
    agrees("high", &scene, &ahead([3, 16384], 10_000.0));
}

#[test]
fn images_larger_than_the_device_allows_are_refused() {
    let gpu = Gpu::new();
    let scene = GpuScene::new(&gpu.0, &gaussians(&[(ball([0.0, 0.0, 5.0], 1.0, 0.9), RED)]), &Options::EXACT).unwrap();
    let mut still = Renderer::new(&gpu.0, &Options::EXACT, &scene).unwrap();
    let limit = gpu.0.capabilities().limits.image;
    for size in [[limit + 1, 1], [1, limit + 1]] {
        let error = still.render(&ahead(size, 30.0), Background::BLACK).unwrap_err();
        assert!(error.to_string().contains(&format!("at most {limit} pixels a side")), "{error:#}");
    }
    still.render(&ahead([5, 4], 30.0), Background::BLACK).unwrap();
    assert!(still.pixels().unwrap().at(2, 2)[0] > 0.8, "the next picture is as if nothing had been");
}

#[test]
#[ignore = "long: a picture of more than 65,535 tiles"]
fn long_more_than_65535_tiles_agree() {
    let raws = [
        (ball([0.0, 0.0, 5.0], 0.4, 0.9), RED),
        (ball([-4.0, -4.0, 6.0], 0.01, 0.9), GREEN),
        (ball([5.9, 5.9, 6.0], 0.1, 0.99), GREEN),
        (ball([0.0, 0.0, 9.0], 50.0, 0.1), RED),
    ];
    // 257 x 257 tiles: their numbers need 17 bits, the blend more than 65,535 workgroups.
    let pixels = agrees("tiles", &gaussians(&raws), &ahead([4097, 4097], 2048.0));
    assert!(pixels.at(4062, 4062)[1] > 0.5, "the last rows of tiles are drawn");
}

#[test]
fn the_near_plane_is_exact() {
    let near = Options::EXACT.rules.near;
    let (below, above) = (near.next_down(), near.next_up());
    for (z, is_drawn) in [(below, false), (near, false), (above, true), (-near, false), (0.0, false)] {
        // A million from the origin, too: the camera's position, in f64, says how far it is to the mean.
        for far in [0.0, f64::from(1 << 20)] {
            let scene = gaussians(&[(ball([far, 0.0, far], 0.001, 0.9), RED)]);
            let camera = Camera { position: DVec3::new(far, 0.0, far - f64::from(z)), ..ahead([33, 33], 30.0) };
            let pixels = agrees("near", &scene, &camera);
            assert_eq!(pixels.at(16, 16)[0] > 0.5, is_drawn, "at depth {z:e}, {far} from the origin");
        }
    }
}

/// Ahead of the near plane by their means, and behind the camera by their tails; green ones the other way around.
#[test]
fn splats_across_the_near_plane_agree() {
    let turned = DQuat::from_euler(glam::EulerRot::XYZ, 0.7, 0.4, -0.2);
    let long = |mean: [f64; 3], axes: [f64; 3], q: DQuat| Raw {
        mean,
        log_scale: axes.map(f64::ln),
        rotation: [q.w, q.x, q.y, q.z],
        opacity_logit: logit(0.5),
    };
    let scene = gaussians(&[
        (ball([0.0, 0.0, 0.2001], 0.05, 0.3), RED),
        (ball([0.05, 0.02, 0.21], 3.0, 0.3), RED),
        (long([0.3, -0.2, 1.0], [0.01, 0.01, 3.0], DQuat::IDENTITY), RED),
        (long([-0.3, 0.1, 0.7], [2.0, 0.05, 0.0], turned), RED),
        (long([0.1, 0.3, 2.0], [50.0, 30.0, 1e-3], turned), RED),
        (ball([0.0, 0.0, 0.2], 5.0, 0.9), GREEN),
        (ball([0.0, 0.0, 0.0], 5.0, 0.9), GREEN),
        (ball([0.1, 0.0, -1.0], 10.0, 0.9), GREEN),
        (long([0.0, 0.1, -0.5], [0.1, 0.1, 20.0], DQuat::IDENTITY), GREEN),
    ]);
    let pixels = agrees("near", &scene, &ahead([90, 70], 60.0));
    assert!(pixels.rgba.iter().all(|p| p[1] < 1e-6), "what has its mean behind the near plane is not drawn");
    assert!(pixels.at(45, 35)[0] > 0.3);
}

#[test]
fn a_camera_inside_large_splats_agrees() {
    let scene = gaussians(&[
        (ball([0.1, 0.0, 0.3], 5.0, 0.5), RED),
        (ball([0.0, 0.0, 1.0], 1e4, 0.3), GREEN),
        (ball([0.0, 0.1, 4.0], 0.5, 0.9), RED),
    ]);
    agrees("inside", &scene, &ahead([120, 90], 100.0));
}

#[test]
fn wide_fields_of_view_agree() {
    let scene = cactus(2000).unwrap().gaussians;
    for degrees in [120.0_f64, 170.0, 179.0, 179.9] {
        let target = DVec3::new(0.0, -1.2, 0.0);
        let camera = Camera::looking_at(DVec3::new(0.5, -1.5, -1.0), target, [96, 64], degrees.to_radians());
        agrees(&format!("{degrees} degrees"), &scene, &camera);
    }
}

/// f32 places a mean within five roundings, 3e-7 of the focal length: a tenth of a pixel at 0.01 degrees.
#[test]
fn narrow_fields_of_view_agree() {
    let gpu = Gpu::new();
    let mut random = Random(6);
    for degrees in [30.0_f64, 1.0, 0.1, 0.01] {
        let position = DVec3::new(3.0, -2.0, 1.0);
        let target = DVec3::new(-40.0, 7.0, 60.0);
        let camera = Camera::looking_at(position, target, [65, 65], degrees.to_radians());
        let width = (target - position).length() * degrees.to_radians();
        let raws: Vec<_> = (0..30)
            .map(|i| {
                let aside = DVec3::from_array(std::array::from_fn(|_| random.between(-0.3, 0.3))) * width;
                let mean = position + (target - position) * (1.0 + 0.01 * f64::from(i)) + aside;
                let scale = width * random.between(0.02, 0.1);
                (ball(mean.to_array(), scale, random.between(0.2, 0.9)), if i % 2 == 0 { RED } else { GREEN })
            })
            .collect();
        let scene = gaussians(&raws);
        let shift_px = 3e-7 * camera.focal_px.x;
        let captured = gpu.capture(&scene, &camera, &Options { portable: true, ..Options::EXACT });
        let splats: Vec<Splat> = captured.buffer("splats");
        let ids: Vec<u32> = captured.buffer("gaussian from splat");
        let visible = captured.frame.totals.visible_kept as usize;
        for (splat, id) in splats.iter().zip(ids).take(visible) {
            let exact = reference::project(&scene, id, &camera, &Options::EXACT.rules).mean_px;
            let error = (DVec2::from(splat.mean_px.map(f64::from)) - exact).length();
            assert!(error <= shift_px + 1e-4, "{degrees} degrees: {error} px off");
        }
        // A shift of s px changes an alpha by 0.6 s over the standard deviation, which is a pixel at least.
        let psnr = smalto::measure::metrics::psnr(&captured.pixels, &reference_of(&scene, &camera).to_pixels());
        let expected = (-20.0 * (0.6 * shift_px).log10()).min(90.0);
        assert!(psnr >= expected, "{degrees} degrees: {psnr} dB, {expected} expected");
    }
}

#[test]
fn pixels_that_are_not_square_agree() {
    let scene = cactus(2000).unwrap().gaussians;
    for focal in [dvec2(20.0, 2000.0), dvec2(3000.0, 60.0)] {
        let target = DVec3::new(0.0, -1.2, 0.0);
        let camera = Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), target, [80, 60], 1.0);
        agrees(&format!("{focal}"), &scene, &Camera { focal_px: focal, ..camera });
    }
}

#[test]
fn a_scene_far_from_the_origin_looks_the_same() {
    for offset in [1e2, 1e4, 1e6] {
        // Means as 32-bit floats hold them there: that loss is the file's, not the renderer's.
        let shift = DVec3::new(offset, -offset / 3.0, offset / 7.0);
        let scene = build(&moved(&free::scene(), DQuat::IDENTITY, shift), 3);
        let camera = Camera { position: free::camera().position + shift, ..free::camera() };
        agrees(&format!("offset {offset}"), &scene, &camera);
    }
}

/// A camera that moves by less than the means can, a hundredth of the distance between two floats there: the picture
/// moves as it does for the same scene at the origin.
#[test]
fn far_from_the_origin_a_slow_camera_does_not_jitter() {
    let mut random = Random(12);
    let offset = DVec3::new(f64::from(1 << 20), -f64::from(1 << 19), f64::from(1 << 20));
    let mut eighth = |low: f64, high: f64| (random.between(low, high) * 8.0).round() / 8.0;
    let local: Vec<Free> = (0..300)
        .map(|i| {
            let mean = [eighth(-3.0, 3.0), eighth(-2.0, 2.0), eighth(4.0, 9.0)];
            let raw = ball(mean, 0.05 + 0.001 * f64::from(i % 70), 0.2 + 0.01 * f64::from(i % 60));
            Free { raw, sh: (0..16).map(|k| [0.3, 0.2, -0.1].map(|c| c / (1 + (i + k) % 7) as f32)).collect() }
        })
        .collect();
    let far = moved(&local, DQuat::IDENTITY, offset);
    let (local, far) = (build(&local, 3), build(&far, 3));
    let gpu = Gpu::new();
    let mut before = None;
    for step in 0..6 {
        // Exact in f64 both here and there.
        let position = DVec3::new(1.0, 0.5, -0.25) / 512.0 * f64::from(step);
        let here = Camera::looking_at(position, position + DVec3::new(0.3, 0.1, 1.0), [96, 72], 1.0);
        let there = Camera { position: position + offset, ..here.clone() };
        let near_pixels = gpu.render(&local, &here, &Options::EXACT);
        assert!(gpu.render(&far, &there, &Options::EXACT) == near_pixels, "step {step} is the same there and here");
        agrees(&format!("step {step}"), &far, &there);
        if let Some(before) = before.replace(near_pixels.clone()) {
            let change = smalto::measure::metrics::max_error(&before, &near_pixels);
            assert!((1e-3..0.1).contains(&change), "a small step is a small change, and one: {change}");
        }
    }
}

#[test]
fn depths_over_nine_orders_of_magnitude_are_in_order() {
    let mut raws = vec![(ball([0.0, 0.0, 1e6], 3e4, 0.9), GREEN)];
    for power in -2..6 {
        let z = 0.3 * 10_f64.powi(power) + 0.2;
        raws.push((ball([0.0, 0.0, z * (1.0 + 1e-6)], 0.05 * z, 0.3), [0.0, 0.0, 1.0]));
        raws.push((ball([0.0, 0.0, z], 0.05 * z, 0.3), RED));
    }
    agrees("depths", &gaussians(&raws), &ahead([64, 64], 100.0));
}

#[test]
fn means_on_tile_borders_and_pixel_centres_agree() {
    let mut raws = Vec::new();
    for px in [-16.0, -0.5, 0.0, 0.5, 15.5, 16.0, 16.5, 31.5, 32.0, 47.5, 48.0, 48.5] {
        for py in [0.0, 15.5, 16.0, 24.5, 32.0, 48.0] {
            let at = |p: f64| (p - 24.0) / 100.0 * 5.0;
            raws.push((ball([at(px), at(py), 5.0 + 0.01 * raws.len() as f64], 0.02, 0.8), RED));
        }
    }
    agrees("borders", &gaussians(&raws), &ahead([48, 48], 100.0));
}

#[test]
fn depths_from_a_thousandth_to_a_million_agree() {
    let options = Options { rules: Rules { near: 5e-4, ..Options::EXACT.rules }, ..Options::EXACT };
    let raws: Vec<_> = (0..400)
        .map(|i| {
            let z = 1e-3 * 1e9_f64.powf(f64::from(i * 7 % 400) / 399.0);
            let [x, y] = [i % 20, i / 20].map(|k| (f64::from(k) / 10.0 - 0.95) * 0.4 * z);
            (ball([x, y, z], 0.05 * z, 0.4), if i % 3 == 0 { RED } else { GREEN })
        })
        .collect();
    let pixels = agrees_by(&options, "depths", &gaussians(&raws), &ahead([96, 96], 100.0));
    assert!(pixels.rgba.iter().filter(|p| p[3] > 0.3).count() > 4000, "the square is there");
}

/// As large as their means are far beside the image, up to 3e11 px: layers across all of it.
#[test]
fn large_splats_far_outside_the_image_agree() {
    for power in 2..9 {
        let far = 10_f64.powi(power);
        let raws: Vec<_> = (0..8)
            .map(|i| {
                let angle = f64::from(i) * 0.8;
                let z = [0.3, 5.0][i as usize % 2];
                let mean = [far * angle.cos(), far * angle.sin(), z];
                let raw = Raw {
                    mean,
                    log_scale: [far, far * [1.0, 0.7, 0.1, 1.5][i as usize % 4], far * 0.8].map(f64::ln),
                    rotation: [0.9, 0.1, -0.2, 0.3],
                    opacity_logit: logit(0.4),
                };
                (raw, if i % 3 == 0 { RED } else { GREEN })
            })
            .collect();
        agrees(&format!("1e{power}"), &gaussians(&raws), &ahead([64, 48], 1000.0));
    }
}

#[test]
fn views_agree_in_subgroups_of_four() {
    again_in_subgroups_of_four(&[
        "extreme_views::",
        "--skip",
        "subgroups_of_four",
        "--skip",
        "more_than_65535_tiles",
        "--skip",
        "largest_width",
    ]);
}

/// The whole range of coordinates that are drawn, seen by the camera that frames the scene.
#[test]
fn scenes_of_any_size_agree() {
    for size in [1e3, 1e9, 1e18, 1e19, 1e25, 1e30, 9e33] {
        let mut random = Random(5);
        let mut one = || {
            let mean = std::array::from_fn(|_| random.between(-size, size));
            (ball(mean, size * random.between(0.02, 0.2), random.between(0.2, 0.9)), RED)
        };
        let scene = gaussians(&(0..60).map(|_| one()).collect::<Vec<_>>());
        assert_eq!(scene.len(), 60);
        let focus = Focus::of(&scene);
        let camera = Camera::framing(DVec3::from(focus.centre), focus.radius, [64, 48]);
        let picture = agrees(&format!("size {size:e}"), &scene, &camera);
        assert!(picture.rgba.iter().any(|pixel| pixel[3] > 0.5), "size {size:e}: the scene is in view");
    }
}
