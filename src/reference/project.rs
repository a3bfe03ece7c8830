//! Projects Gaussians to the screen: EWA splatting with the rules of the original 3DGS, written with plain matrices.

use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};

use crate::camera::Camera;
use crate::rules::{COMPENSATION_MIN, Footprint, LOW_PASS, Rules};
use crate::scene::{Gaussians, harmonics};

/// A projected Gaussian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Splat {
    /// Position of the mean on the screen.
    pub mean_px: DVec2,
    /// px^2, with the low-pass added.
    pub covariance: DMat2,
    /// The inverse of `covariance`.
    pub conic: DMat2,
    /// After the compensation for the low-pass, if the rules ask for it.
    pub opacity: f64,
    /// Red, green, blue from this direction, at least 0; features of any sign if the rules say so.
    pub colour: DVec3,
    /// View z, world units.
    pub depth: f64,
    /// Distance of the mean from the camera, world units.
    pub distance_world: f64,
}

impl Splat {
    /// Squared Mahalanobis distance of a point on the screen.
    pub fn distance(&self, point_px: DVec2) -> f64 {
        let d = point_px - self.mean_px;
        d.dot(self.conic * d)
    }

    /// Squared Mahalanobis distance at which alpha falls to the threshold, or at which the rules cut the splat.
    pub fn level(&self, rules: &Rules) -> f64 {
        level(self.opacity, rules, rules.extent == Footprint::ThreeSigma)
    }
}

/// Squared Mahalanobis distance at which the alpha of a splat of this opacity falls to the threshold; at most that of
/// three standard deviations if the splat is cut there.
pub(super) fn level(opacity: f64, rules: &Rules, is_cut: bool) -> f64 {
    let level = 2.0 * (opacity / f64::from(rules.alpha_min)).ln();
    if is_cut { level.min(9.0) } else { level }
}

/// W R S of Gaussian `index`: its axes in view axes, in columns, each as long as the standard deviation along it.
pub(super) fn axes(gaussians: &Gaussians, index: usize, camera: &Camera) -> DMat3 {
    let [w, x, y, z] = gaussians.rotations()[index].map(f64::from);
    let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
    let scale = DMat3::from_diagonal(DVec3::from(gaussians.scales()[index].map(f64::from)));
    camera.rotation * rotation * scale
}

/// The colour of Gaussian `index` in a direction of any length, in world axes, from the camera to its mean.
pub(super) fn colour(gaussians: &Gaussians, index: usize, direction: DVec3, rules: &Rules) -> DVec3 {
    let basis = harmonics::basis(direction.normalize_or(DVec3::Z).to_array());
    let sum = gaussians
        .sh(index)
        .iter()
        .zip(basis)
        .fold(DVec3::splat(if rules.features { 0.0 } else { 0.5 }), |sum, (coefficient, value)| {
            sum + value * DVec3::from(coefficient.map(f64::from))
        });
    if rules.features { sum } else { sum.max(DVec3::ZERO) }
}

/// The factor on an opacity by the determinants of a covariance before and after the low-pass.
pub(super) fn compensation(sharp: f64, determinant: f64, rules: &Rules) -> f64 {
    if rules.antialiased { (sharp / determinant).max(COMPENSATION_MIN.powi(2)).sqrt() } else { 1.0 }
}

/// Projects Gaussian `id`, whose mean must have a positive view depth.
pub fn project(gaussians: &Gaussians, id: u32, camera: &Camera, rules: &Rules) -> Splat {
    let index = id as usize;
    let mean_world = DVec3::from(gaussians.means()[index].map(f64::from));
    let mean_view = camera.view(mean_world);
    let slope = mean_view.truncate() / mean_view.z;
    let mean_px = camera.focal_px * slope + camera.centre_px;

    // V = J W R S, so the covariance is V V^T. The slope in J is clamped to 15 % of the image beyond each edge.
    let size = DVec2::from(camera.size_px.map(f64::from));
    let low = (-camera.centre_px - 0.15 * size) / camera.focal_px;
    let high = (size - camera.centre_px + 0.15 * size) / camera.focal_px;
    let clamped = slope.clamp(low, high);
    let m = axes(gaussians, index, camera);
    let per_unit = camera.focal_px / mean_view.z;
    let v0 = per_unit.x * (m.row(0) - clamped.x * m.row(2));
    let v1 = per_unit.y * (m.row(1) - clamped.y * m.row(2));

    let (a, b, c) = (v0.dot(v0) + LOW_PASS, v0.dot(v1), v1.dot(v1) + LOW_PASS);
    // a c - b^2, computed without cancellation (Cauchy-Binet).
    let sharp = v0.cross(v1).length_squared();
    let determinant = sharp + LOW_PASS * (v0.dot(v0) + v1.dot(v1)) + LOW_PASS * LOW_PASS;
    let covariance = DMat2::from_cols_array(&[a, b, b, c]);
    let conic = DMat2::from_cols_array(&[c, -b, -b, a]) * determinant.recip();

    let opacity = f64::from(gaussians.opacities()[index]) * compensation(sharp, determinant, rules);
    let towards_mean = mean_world - camera.position;
    let colour = colour(gaussians, index, towards_mean, rules);
    let distance_world = towards_mean.length();
    Splat { mean_px, covariance, conic, opacity, colour, depth: mean_view.z, distance_world }
}
