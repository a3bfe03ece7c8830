//! The size of a scene, and where most of it lies.

use glam::Vec3;
use rayon::prelude::*;

use super::Gaussians;

/// The bounding box of all means in world units; the origin for an empty scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest coordinates.
    pub low: [f32; 3],
    /// Largest coordinates.
    pub high: [f32; 3],
}

impl Bounds {
    /// The bounding box of the means of `gaussians`.
    pub fn of(gaussians: &Gaussians) -> Self {
        let means = gaussians.means().par_iter().with_min_len(1 << 14).map(|m| Vec3::from(*m));
        let first = gaussians.means().first().copied().map_or(Vec3::ZERO, Vec3::from);
        let (low, high) = means
            .fold(|| (first, first), |(low, high), mean| (low.min(mean), high.max(mean)))
            .reduce(|| (first, first), |a, b| (a.0.min(b.0), a.1.max(b.1)));
        Self { low: low.to_array(), high: high.to_array() }
    }
}

/// The sphere that contains most of the visible scene, robust against floaters; the unit sphere for an empty scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Focus {
    /// Median of the means per axis, weighted by opacity, world units.
    pub centre: [f64; 3],
    /// Distance from `centre` that contains 90 % of the opacity, world units; 1 if that is 0.
    pub radius: f64,
}

impl Focus {
    /// The focus of `gaussians`.
    pub fn of(gaussians: &Gaussians) -> Self {
        let (means, opacities) = (gaussians.means(), gaussians.opacities());
        if means.is_empty() {
            return Self { centre: [0.0; 3], radius: 1.0 };
        }
        let weighted = |value: &(dyn Fn(&[f32; 3]) -> f64 + Sync), fraction| {
            let mut values: Vec<_> = means.par_iter().zip(opacities).map(|(m, o)| (value(m), f64::from(*o))).collect();
            weighted_quantile(&mut values, fraction)
        };
        let centre = std::array::from_fn(|axis| weighted(&|m| f64::from(m[axis]), 0.5));
        let distance = |m: &[f32; 3]| (0..3).map(|i| (f64::from(m[i]) - centre[i]).powi(2)).sum::<f64>().sqrt();
        let radius = weighted(&distance, 0.9);
        Self { centre, radius: if radius > 0.0 { radius } else { 1.0 } }
    }
}

/// The smallest value with at least `fraction` of the weight at or below it. `values` are (value, weight), at least
/// one.
fn weighted_quantile(values: &mut [(f64, f64)], fraction: f64) -> f64 {
    // By weight, too: the sums below are then the same with any number of threads.
    values.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let wanted = fraction * values.iter().map(|v| v.1).sum::<f64>();
    let mut sum = 0.0;
    let reached = values.iter().find(|(_, weight)| {
        sum += weight;
        sum >= wanted
    });
    reached.unwrap_or(&values[values.len() - 1]).0
}

/// The values at these fractions (0 to 1) of the sorted `values` (nearest rank); 0 if `values` is empty.
pub fn percentiles<const N: usize>(mut values: Vec<f32>, fractions: [f64; N]) -> [f32; N] {
    values.sort_unstable_by(f32::total_cmp);
    fractions.map(|f| values.get((values.len().saturating_sub(1) as f64 * f).round() as usize).copied().unwrap_or(0.0))
}
