//! Random Gaussians before a camera at the origin that looks along z.

use glam::DVec3;
use smalto::camera::Camera;
use smalto::scene::{Raw, sh_coefficients};

use super::Random;
use super::agree::logit;
use super::free::Free;

pub const SIZE: [u32; 2] = [96, 64];

/// A camera with a wide field of view, in which the orders by distance and by depth differ.
pub fn camera() -> Camera {
    Camera::looking_at(DVec3::ZERO, DVec3::Z, SIZE, 1.6)
}

/// Of any shape, from well below a pixel to a third of the image, near and far, faint and opaque; of SH degree
/// `degree`, where the coefficients beyond the first go up to `sh`.
pub fn cloud(random: &mut Random, count: usize, degree: u32, sh: f64) -> Vec<Free> {
    (0..count).map(|_| one(random, degree, sh)).collect()
}

fn one(random: &mut Random, degree: u32, sh: f64) -> Free {
    let z: f64 = random.between(0.7_f64.ln(), 12_f64.ln()).exp();
    let across = |random: &mut Random, part: f64| z * random.between(-part, part);
    let scale = z * random.between(0.003_f64.ln(), 0.3_f64.ln()).exp();
    let log_scale = std::array::from_fn(|_| (scale * random.between(0.1, 1.0)).ln());
    let raw = Raw {
        mean: [across(random, 1.1), across(random, 0.7), z],
        log_scale,
        rotation: std::array::from_fn(|_| random.between(-1.0, 1.0)),
        opacity_logit: logit(random.between(0.01, 0.999)),
    };
    let coefficient = |random: &mut Random, i: usize| {
        let largest = if i == 0 { 1.7 } else { sh };
        std::array::from_fn(|_| random.between(-largest, largest) as f32)
    };
    Free { raw, sh: (0..sh_coefficients(degree)).map(|i| coefficient(random, i)).collect() }
}
