//! The part of a scene that the trial of the fast path draws.

use glam::DVec3;

use crate::camera::Camera;
use crate::scene::Gaussians;

/// Number of Gaussians that a trial draws: the first ones of the scene.
pub(crate) const TRIAL: usize = 1 << 14;
/// Size of the trial's picture, px.
pub(crate) const TRIAL_SIZE: [u32; 2] = [256, 144];

/// A camera that sees most of the trial's Gaussians.
pub(crate) fn trial_view(means: &[[f32; 3]], near: f32) -> Camera {
    let means: Vec<_> = means.iter().take(TRIAL).map(|mean| DVec3::from(mean.map(f64::from))).collect();
    let median = |mut values: Vec<f64>| {
        let middle = values.len() / 2;
        if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
    };
    let centre = DVec3::from([0, 1, 2].map(|axis| median(means.iter().map(|mean| mean[axis]).collect())));
    let radius = median(means.iter().map(|mean| mean.distance(centre)).collect());
    let position = centre - DVec3::new(0.3, -0.2, 1.0) * (2.0 * radius).max(4.0 * f64::from(near));
    Camera::looking_at(position, centre, TRIAL_SIZE, 0.9)
}

/// BLAKE3 of the Gaussians of the trial and of the near plane, on which its camera depends.
pub(crate) fn trial_hash(gaussians: &Gaussians, near: f32) -> blake3::Hash {
    let count = gaussians.len().min(TRIAL);
    let mut hasher = blake3::Hasher::new();
    hasher.update(&near.to_le_bytes()).update(&(count as u64).to_le_bytes());
    hasher.update(bytemuck::cast_slice(&gaussians.means()[..count]));
    hasher.update(bytemuck::cast_slice(&gaussians.scales()[..count]));
    hasher.update(bytemuck::cast_slice(&gaussians.rotations()[..count]));
    hasher.update(bytemuck::cast_slice(&gaussians.opacities()[..count]));
    for index in 0..count {
        hasher.update(bytemuck::cast_slice(gaussians.sh(index)));
    }
    hasher.finalize()
}
