//! The input of the self-test of the fast path: some Gaussians of a scene, and a camera that sees them.

use std::sync::{Arc, LazyLock};

use glam::DVec3;

use crate::camera::Camera;
use crate::scene::Gaussians;

/// The most Gaussians that the self-test draws: the first ones of the scene.
pub(crate) const SELF_TEST_GAUSSIANS: usize = 1 << 14;
/// The size of the picture of the self-test, px.
pub(crate) const SELF_TEST_SIZE: [u32; 2] = [256, 144];

/// The input of the self-test of a scene, whose first Gaussians it draws.
#[derive(Debug)]
pub(crate) struct SelfTestInput {
    pub camera: Camera,
    pub hash: blake3::Hash,
}

/// The input of a self-test, computed when a renderer needs it.
pub(crate) type SelfTest = Arc<LazyLock<SelfTestInput, Box<dyn FnOnce() -> SelfTestInput + Send>>>;

/// The input that `make` computes.
pub(crate) fn self_test(make: impl FnOnce() -> SelfTestInput + Send + 'static) -> SelfTest {
    Arc::new(LazyLock::new(Box::new(make)))
}

impl SelfTestInput {
    pub fn of(gaussians: &Gaussians, near: f32) -> Self {
        Self { camera: self_test_camera(gaussians.means(), near), hash: self_test_hash(gaussians, near) }
    }
}

/// A camera that sees most of the Gaussians of the self-test.
pub(crate) fn self_test_camera(means: &[[f32; 3]], near: f32) -> Camera {
    let means: Vec<_> = means.iter().take(SELF_TEST_GAUSSIANS).map(|mean| DVec3::from(mean.map(f64::from))).collect();
    let median = |mut values: Vec<f64>| {
        let middle = values.len() / 2;
        if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
    };
    let centre = DVec3::from([0, 1, 2].map(|axis| median(means.iter().map(|mean| mean[axis]).collect())));
    let radius = median(means.iter().map(|mean| mean.distance(centre)).collect());
    let position = centre - DVec3::new(0.3, -0.2, 1.0) * (2.0 * radius).max(4.0 * f64::from(near));
    Camera::looking_at(position, centre, SELF_TEST_SIZE, 0.9)
}

/// BLAKE3 of the Gaussians of the self-test and of the near plane, on which its camera depends.
fn self_test_hash(gaussians: &Gaussians, near: f32) -> blake3::Hash {
    let count = gaussians.len().min(SELF_TEST_GAUSSIANS);
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
