//! Pictures of cameras with a lens, held to the definition of the response and to pictures that must be equal.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3};

use super::project::axes;
use super::*;
use crate::camera::Lens;
use crate::rules::LOW_PASS;
use crate::scene::{Builder, Random, Raw};

const SIZE: [u32; 2] = [100, 70];

/// The rules without thresholds, by which pictures change smoothly.
const SMOOTH: Rules = Rules { alpha_min: 1e-12, transmittance_min: 0.0, ..Rules::TRAINED };

/// A camera at the origin with a lens, whose image spans `width` in plane coordinates.
fn camera(model: &str, numbers: &[f64], width: f64) -> Camera {
    let lens = Lens::named(model, numbers).unwrap().map(Arc::new);
    let plain = Camera::looking_at(DVec3::new(0.1, -0.2, 0.3), DVec3::new(0.5, 0.3, 1.4), SIZE, 1.0);
    let focal = f64::from(SIZE[0]) / width;
    Camera { focal_px: DVec2::new(focal, 1.02 * focal), lens, ..plain }
}

fn equirectangular(size_px: [u32; 2]) -> Camera {
    let [focal_px, centre_px] = Lens::sphere_px(DVec2::from(size_px.map(f64::from)));
    Camera { focal_px, centre_px, size_px, ..camera("EQUIRECTANGULAR", &[], TAU) }
}

/// OPENCV (which folds within the image), 180 degrees, 220 degrees, a whole sphere, parallel rays.
fn cameras() -> [Camera; 5] {
    [
        camera("OPENCV", &[-0.25, 0.0, 0.002, -0.001], 1.9),
        camera("OPENCV_FISHEYE", &[-0.02, 0.004, -0.001, 0.0001], 3.0),
        camera("FISHEYE", &[], 220_f64.to_radians()),
        equirectangular([96, 48]),
        camera("ORTHOGRAPHIC", &[], 6.0),
    ]
}

fn gaussian(mean: DVec3, sizes: [f64; 3], random: &mut Random) -> (Raw, [f32; 3]) {
    let rotation = [0; 4].map(|_| random.normal());
    let raw = Raw { mean: mean.to_array(), log_scale: sizes.map(f64::ln), rotation, opacity_logit: random.normal() };
    (raw, [0; 3].map(|_| random.unit() as f32))
}

fn built(raws: &[(Raw, [f32; 3])]) -> Gaussians {
    let mut builder = Builder::new(0, raws.len()).unwrap();
    builder.extend(raws.len(), |i, sh| {
        sh[0] = raws[i].1.map(|c| (c - 0.5) / 0.282_094_8);
        raws[i].0
    });
    builder.finish().0
}

/// Around the camera in all directions: small, huge, long, flat, with the camera inside; at the poles of a sphere and
/// where its first column follows its last.
fn around(camera: &Camera, count: usize) -> Gaussians {
    let one = |i: usize| {
        let mut random = Random::of(i);
        let direction = match i % 8 {
            0 => DVec3::Y + 0.02 * random.direction(),
            1 => DVec3::NEG_Z + 0.1 * random.direction(),
            _ => random.direction(),
        };
        let distance = (2.0 * random.normal()).exp();
        let mean = camera.position + distance * (camera.rotation.transpose() * direction);
        let largest = distance * 0.15 * (1.5 * random.normal()).exp();
        let sizes =
            [1.0, random.unit().powi(3).max(0.003), random.unit().powi(3).max(0.003)].map(|part| largest * part);
        gaussian(mean, sizes, &mut random)
    };
    built(&(0..count).map(one).collect::<Vec<_>>())
}

fn drawn(gaussians: &Gaussians, camera: &Camera, rules: &Rules) -> Vec<Pixel> {
    render(gaussians, camera, rules, Background::Colour([0.3, 0.5, 1.0])).pixels
}

fn error(a: &Pixel, b: &Pixel) -> f64 {
    DVec3::from(a.colour).distance(DVec3::from(b.colour))
}

fn rms_error(a: &[Pixel], b: &[Pixel]) -> f64 {
    assert_eq!(a.len(), b.len());
    (a.iter().zip(b).map(|(a, b)| error(a, b).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
}

/// The place of the least value of a function with one minimum between two places.
fn least(value: impl Fn(f64) -> f64, [mut low, mut high]: [f64; 2]) -> f64 {
    for _ in 0..200 {
        let third = (high - low) / 3.0;
        let (a, b) = (low + third, high - third);
        if value(a) < value(b) { high = b } else { low = a }
    }
    (low + high) / 2.0
}

#[test]
fn the_distance_of_a_ray_is_the_least_of_its_points() {
    for camera in cameras() {
        let footprints = Footprints::of(&camera).unwrap();
        let gaussians = around(&camera, 200);
        let sharp = Rays::new(&gaussians, &(0..200).collect::<Vec<_>>(), &camera);
        let is_parallel = camera.lens.as_ref().unwrap().is_parallel();
        let mut met = 0;
        for id in 0..200 {
            let index = id as usize;
            let mean = camera.view(DVec3::from(gaussians.means()[index].map(f64::from)));
            if is_parallel && mean.z <= 0.0 {
                continue;
            }
            let splat = ray_splat(&gaussians, id, &camera, &footprints, &Rules::TRAINED);
            let unit = if is_parallel { 1.0 } else { mean.length() };
            let m = axes(&gaussians, index, &camera);
            let low_pass = unit * unit * LOW_PASS * footprints.covariance(mean);
            let mut random = Random::of(index);
            let aside = m * DVec3::from([0; 3].map(|_| random.normal()));
            let ray = if is_parallel {
                (mean + aside).truncate().extend(1.0)
            } else {
                ((mean + aside) / unit + 0.01 * random.direction()).normalize()
            };
            let (origin, direction) = if is_parallel { (ray - DVec3::Z, DVec3::Z) } else { (DVec3::ZERO, ray) };
            let beside = |t: f64| origin + t * direction - mean;
            let farthest = 10.0 * (mean.length() + m.x_axis.length() + m.y_axis.length() + m.z_axis.length());
            let nearly = |a: f64, b: f64| (a - b).abs() < 1e-9 * (1.0 + b);

            let conic = (m * m.transpose() + low_pass).inverse();
            let value = |t: f64| beside(t).dot(conic * beside(t));
            let expected = value(least(value, [-farthest, farthest]));
            if is_parallel || least(value, [-farthest, farthest]) > 1e-9 * unit {
                assert!(nearly(splat.distance(ray), expected), "{id} {} {expected}", splat.distance(ray));
                met += 1;
            } else {
                assert!(splat.distance(ray) == f64::INFINITY, "{id}");
            }

            // The depth per pixel is that of the Gaussian without the low-pass.
            let value = |t: f64| (m.inverse() * beside(t)).length_squared();
            let depth = sharp.depth(id, ray);
            assert!(nearly(value(depth), value(least(value, [0.0, farthest]))), "{id} {depth} {}", value(depth));
        }
        assert!(met > 80, "{met}");
    }
}

#[test]
fn a_parallel_lens_is_the_limit_of_far_pinholes() {
    let parallel = camera("ORTHOGRAPHIC", &[], 4.0);
    let one = |i: usize| {
        let mut random = Random::of(i);
        let place = 2.0 * random.direction() + DVec3::new(0.0, 0.0, 3.0);
        let mean = parallel.position + parallel.rotation.transpose() * place;
        let sizes = [0; 3].map(|_| 0.2 * random.unit());
        gaussian(mean, sizes, &mut random)
    };
    let gaussians = built(&(0..60).map(one).collect::<Vec<_>>());
    let expected = drawn(&gaussians, &parallel, &SMOOTH);
    let error = |k: i32| {
        let distance = 2_f64.powi(k);
        let position = parallel.position - distance * parallel.forward();
        let pinhole = Camera { position, focal_px: distance * parallel.focal_px, lens: None, ..parallel.clone() };
        rms_error(&drawn(&gaussians, &pinhole, &SMOOTH), &expected)
    };
    let errors: Vec<f64> = (9..13).map(error).collect();
    assert!(errors[0] < 0.01, "{errors:?}");
    for pair in errors.windows(2) {
        let fall_db = 20.0 * (pair[0] / pair[1]).log10();
        assert!((fall_db - 6.02).abs() < 0.3, "{errors:?}");
    }
}

/// EWA is the first order of the response along rays. The same splats in pixels, seen with a longer focal length, are
/// smaller in directions.
#[test]
fn small_splats_are_those_of_ewa_to_first_order() {
    for (model, numbers) in [("OPENCV", vec![1e-9, 0.0, 0.0, 0.0]), ("PERSPECTIVE", vec![1e-9; 6])] {
        let largest_error = |k: i32| {
            let lens = camera(model, &numbers, 1.5 / 2_f64.powi(k));
            // The image lies off the axis, where splats of EWA are sheared.
            let centre_px = lens.centre_px - DVec2::new(0.6, -0.4) * lens.focal_px;
            let lens = Camera { centre_px, ..lens };
            let pinhole = Camera { lens: None, ..lens.clone() };
            let footprints = Footprints::of(&lens).unwrap();
            let one = |i: usize| {
                let mut random = Random::of(i);
                let place = DVec2::new(random.unit(), random.unit()) * DVec2::from(SIZE.map(f64::from));
                let mean = pinhole.unprojected(place, 5.0);
                let px_world = 5.0 / pinhole.focal_px.x;
                let sizes = [0; 3].map(|_| px_world * (0.1 + 2.0 * random.unit()));
                gaussian(mean, sizes, &mut random)
            };
            let gaussians = built(&(0..100).map(one).collect::<Vec<_>>());
            let error = |id: u32| {
                let exact = ray_splat(&gaussians, id, &lens, &footprints, &Rules::TRAINED);
                let ewa = project(&gaussians, id, &pinhole, &Rules::TRAINED);
                let aside = DVec2::from_angle(f64::from(id)) * 2.0;
                let place = ewa.mean_px + aside;
                (exact.distance(lens.ray(place).unwrap()) / ewa.distance(place) - 1.0).abs()
            };
            (0..100).map(error).fold(0.0, f64::max)
        };
        let errors: Vec<f64> = (2..7).map(largest_error).collect();
        assert!(errors[4] < 0.01, "{errors:?}");
        for pair in errors.windows(2) {
            assert!((pair[0] / pair[1] - 2.0).abs() < 0.3, "{errors:?}");
        }
    }
}

#[test]
fn a_quarter_turn_moves_a_sphere_by_a_quarter_of_its_columns() {
    let camera = equirectangular([96, 48]);
    let gaussians = around(&camera, 400);
    for order in [Order::Distance, Order::PerPixel] {
        let rules = Rules { order, ..SMOOTH };
        let expected = drawn(&gaussians, &camera, &rules);
        let turned = Camera { rotation: DMat3::from_rotation_y(FRAC_PI_2) * camera.rotation, ..camera.clone() };
        let moved = drawn(&gaussians, &turned, &rules);
        // What was ahead is now at the right.
        let pairs = (0..96 * 48).map(|i| (i / 96 * 96 + (i % 96 + 24) % 96, i));
        let largest = pairs.map(|(moved_at, at)| error(&moved[moved_at], &expected[at])).fold(0.0, f64::max);
        assert!(largest < 1e-9, "{largest}");
        assert!(rms_error(&moved, &expected) > 0.05);
    }
}

#[test]
fn lists_of_tiles_change_nothing() {
    for extent in [crate::rules::Footprint::Exact, crate::rules::Footprint::ThreeSigma] {
        for camera in cameras() {
            let rules = Rules { extent, near: 0.0, ..Rules::TRAINED };
            let footprints = Footprints::of(&camera).unwrap();
            let gaussians = around(&camera, 600);
            let listed = RayLists::of(&gaussians, &camera, &footprints, &rules);
            let mut whole = RayLists::of(&gaussians, &camera, &footprints, &rules);
            let mut order: Vec<u32> = (0..whole.splats.len() as u32).collect();
            order.sort_by_key(|id| (whole.splats[*id as usize].depth as f32).to_bits());
            whole.lists.iter_mut().for_each(|list| list.clone_from(&order));
            // A doubt may be that of a splat that ends just before the tile.
            let pixels = |lists: &RayLists| {
                let pixels = blend_rays(lists, None, DVec3::ONE, &rules);
                pixels.into_iter().map(|pixel| Pixel { doubt: 0.0, ..pixel }).collect::<Vec<_>>()
            };
            assert!(pixels(&listed) == pixels(&whole), "{:?}", camera.lens);
            let [few, all] = [&listed, &whole].map(|of| of.lists.iter().map(Vec::len).sum::<usize>());
            assert!(few > 0 && 2 * few < all, "{few} of {all}, {:?}", camera.lens);
        }
    }
}

#[test]
fn near_plane_and_depths_are_distances_of_central_lenses() {
    let central = camera("FISHEYE", &[], 220_f64.to_radians());
    let parallel = camera("ORTHOGRAPHIC", &[], 2.0);
    let behind = DVec3::new(1.0, 0.0, -0.2);
    let beside = DVec3::new(0.6, 0.0, 0.25);
    let rules = |near: f32| Rules { near, ..Rules::TRAINED };
    for (camera, direction, distance, depth) in [
        (&central, behind / behind.length(), 0.5, 0.5),
        (&central, beside / beside.length(), 2.0, 2.0),
        (&parallel, beside, 1.0, 0.25),
    ] {
        let mean = camera.position + distance * (camera.rotation.transpose() * direction);
        let gaussians = built(&[gaussian(mean, [0.05; 3], &mut Random::of(0))]);
        let picture = |near: f32| render(&gaussians, camera, &rules(near), Background::BLACK);
        let nearest = |plane: &Plane| plane.values.iter().copied().fold(f32::INFINITY, f32::min);
        let depths = picture(depth as f32 - 0.01).depths();
        assert!((nearest(&depths.expected) - depth as f32).abs() < 1e-6, "{}", nearest(&depths.expected));
        assert!(picture(depth as f32 + 0.01).pixels.iter().all(|pixel| pixel.blended == 0));
    }
}

#[test]
fn a_pixel_without_a_ray_is_transparent_black() {
    for camera in [camera("OPENCV", &[-0.25, 0.0, 0.0, 0.0], 3.0), camera("FISHEYE", &[], 8.0)] {
        let picture = render(&around(&camera, 300), &camera, &Rules::TRAINED, Background::Colour([1.0; 3]));
        let (mut without, mut with) = (0, 0);
        for (i, rgba) in picture.to_pixels().rgba.iter().enumerate() {
            let place = DVec2::new((i % SIZE[0] as usize) as f64 + 0.5, (i / SIZE[0] as usize) as f64 + 0.5);
            if camera.ray(place).is_some() {
                with += 1;
                assert!(rgba[..3] != [0.0; 3], "{place}");
            } else {
                without += 1;
                assert_eq!(*rgba, [0.0; 4], "{place}");
            }
        }
        assert!(without > 500 && with > 500, "{without} {with}");
    }
}
