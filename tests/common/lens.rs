//! Cameras with lenses, and random Gaussians all around a camera.

use std::f64::consts::TAU;
use std::sync::Arc;

use glam::{DVec2, DVec3};
use smalto::camera::{Camera, Lens};
use smalto::scene::{Gaussians, Raw};

use super::agree::logit;
use super::{Random, gaussians};

/// A camera with a lens whose picture is `width` wide in plane coordinates.
pub fn through(model: &str, numbers: &[f64], size_px: [u32; 2], width: f64) -> Camera {
    let lens = Lens::named(model, numbers).unwrap().map(Arc::new);
    let plain = Camera::looking_at(DVec3::new(0.1, -0.2, 0.3), DVec3::new(0.5, 0.3, 1.4), size_px, 1.0);
    let focal = f64::from(size_px[0]) / width;
    Camera { focal_px: DVec2::new(focal, 1.02 * focal), lens, ..plain }
}

/// A panorama.
pub fn sphere(size_px: [u32; 2]) -> Camera {
    let [focal_px, centre_px] = Lens::sphere_px(DVec2::from(size_px.map(f64::from)));
    Camera { focal_px, centre_px, ..through("EQUIRECTANGULAR", &[], size_px, TAU) }
}

/// Cameras of central lenses up to a whole sphere, and of a parallel one.
pub fn all(size_px: [u32; 2]) -> Vec<(&'static str, Camera)> {
    let numbers: [(_, &[f64], _); 5] = [
        ("OPENCV", &[-0.1, 0.01, 0.0, 0.0], 2.2),
        ("OPENCV_FISHEYE", &[-0.02, 0.004, -0.001, 0.0001], 3.0),
        ("FISHEYE", &[], 220_f64.to_radians()),
        ("THIN_PRISM_FISHEYE", &[-0.02, 0.004, 0.001, -0.002, -0.001, 0.0001, 0.001, -0.001], 2.6),
        ("ORTHOGRAPHIC", &[], 6.0),
    ];
    let given = numbers.map(|(model, numbers, width)| (model, through(model, numbers, size_px, width)));
    given.into_iter().chain([("EQUIRECTANGULAR", sphere(size_px))]).collect()
}

/// In all directions around a camera, near and far: small, huge, long, flat, and with the camera inside; in turn behind
/// the camera and at the lower pole of a panorama.
pub fn around(random: &mut Random, camera: &Camera, count: usize) -> Gaussians {
    let one = |i: usize| {
        let direction = match i % 8 {
            0 => DVec3::Y + 0.02 * direction(random),
            1 => DVec3::NEG_Z + 0.1 * direction(random),
            _ => direction(random),
        };
        let distance = random.between(0.5_f64.ln(), 20_f64.ln()).exp();
        let mean = camera.position + distance * (camera.rotation.transpose() * direction);
        let largest = distance * random.between(0.01_f64.ln(), 1.5_f64.ln()).exp();
        let part = |random: &mut Random| random.between(0.15, 1.0).powi(3);
        let log_scale = [1.0, part(random), part(random)].map(|part| (largest * part).ln());
        let rotation = std::array::from_fn(|_| random.between(-1.0, 1.0));
        let opacity_logit = logit(random.between(0.02, 0.95));
        let colour = std::array::from_fn(|_| random.between(0.0, 1.0) as f32);
        (Raw { mean: mean.to_array(), log_scale, rotation, opacity_logit }, colour)
    };
    gaussians(&(0..count).map(one).collect::<Vec<_>>())
}

/// Of length 1.
fn direction(random: &mut Random) -> DVec3 {
    let (z, azimuth) = (random.between(-1.0, 1.0), random.between(0.0, TAU));
    (DVec2::from_angle(azimuth) * (1.0 - z * z).sqrt()).extend(z)
}
