//! The size of a scene, and where most of it lies.

use glam::{DVec3, Vec3};
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
        // Threads meet zeros of both signs in any order: 0 is +0.
        Self { low: (low + Vec3::ZERO).to_array(), high: (high + Vec3::ZERO).to_array() }
    }

    /// The box around two boxes.
    pub fn around(self, other: Self) -> Self {
        let corner = |pick: fn(f32, f32) -> f32, a: [f32; 3], b: [f32; 3]| std::array::from_fn(|i| pick(a[i], b[i]));
        Self { low: corner(f32::min, self.low, other.low), high: corner(f32::max, self.high, other.high) }
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

/// Most Gaussians that a focus is computed from.
pub const FOCUSED: usize = 1 << 18;

impl Focus {
    /// The focus of `gaussians`, of more than [`FOCUSED`] that of a sample.
    pub fn of(gaussians: &Gaussians) -> Self {
        let (means, opacities, count) = (gaussians.means(), gaussians.opacities(), gaussians.len());
        if count <= FOCUSED {
            return Self::of_weighted(means, opacities);
        }
        let places = || (0..FOCUSED).map(|k| Self::sampled(k, count));
        let means: Vec<_> = places().map(|k| means[k]).collect();
        let opacities: Vec<_> = places().map(|k| opacities[k]).collect();
        Self::of_weighted(&means, &opacities)
    }

    /// The index of the `k`-th Gaussian that the focus of `count` Gaussians is computed from. They are evenly spread.
    pub fn sampled(k: usize, count: usize) -> usize {
        if count <= FOCUSED { k } else { (k as u128 * count as u128 / FOCUSED as u128) as usize }
    }

    /// The focus of Gaussians with these means and opacities.
    ///
    /// # Panics
    /// If there are fewer opacities than means.
    pub fn of_weighted(means: &[[f32; 3]], opacities: &[f32]) -> Self {
        if means.is_empty() {
            return Self { centre: [0.0; 3], radius: 1.0 };
        }
        let all = Weighted { means, opacities: &opacities[..means.len()] };
        let centre = std::array::from_fn(|axis| weighted_quantile(&all, |m| f64::from(m[axis]), 0.5));
        let distance = |m: &[f32; 3]| (0..3).map(|i| (f64::from(m[i]) - centre[i]).powi(2)).sum::<f64>().sqrt();
        let radius = weighted_quantile(&all, distance, 0.9);
        Self { centre, radius: if radius > 0.0 { radius } else { 1.0 } }
    }

    /// The smallest sphere around both.
    pub fn joined(self, other: Self) -> Self {
        let [from, to] = [self, other].map(|focus| DVec3::from(focus.centre));
        let distance = from.distance(to);
        if distance + other.radius <= self.radius {
            return self;
        }
        if distance + self.radius <= other.radius {
            return other;
        }
        let radius = (distance + self.radius + other.radius) / 2.0;
        let centre = from + (to - from) * ((radius - self.radius) / distance);
        Self { centre: centre.to_array(), radius }
    }
}

/// Means, and opacities as their weights.
struct Weighted<'g> {
    means: &'g [[f32; 3]],
    opacities: &'g [f32],
}

/// Bits of a value that one pass of [`weighted_quantile`] selects by.
const DIGIT_BITS: u32 = 16;

/// Gaussians whose weights a thread adds up at a time.
const WEIGHED: usize = 1 << 18;

/// The smallest value of a mean with at least `fraction` of the opacity at or below it, by radix selection. There
/// is a mean.
fn weighted_quantile(all: &Weighted, value: impl Fn(&[f32; 3]) -> f64 + Sync, fraction: f64) -> f64 {
    let (mut prefix, mut below, mut wanted) = (0_u64, 0_u64, None);
    for shift in (0..u64::BITS).step_by(DIGIT_BITS as usize).rev() {
        let is_selected = |key: u64| key.checked_shr(shift + DIGIT_BITS).unwrap_or(0) == prefix;
        let digit =
            |mean: &[f32; 3]| Some(ordered(value(mean))).filter(|key| is_selected(*key)).map(|key| key >> shift);
        let weights = weights(all, |mean| digit(mean).map(|key| key as usize % (1 << DIGIT_BITS)));
        let wanted = *wanted.get_or_insert_with(|| fraction * weights.iter().sum::<u64>() as f64);
        let reaches = |(_, weight): &(usize, &u64)| {
            let is_reached = (below + **weight) as f64 >= wanted;
            below += if is_reached { 0 } else { **weight };
            is_reached
        };
        let (digit, _) =
            weights.iter().enumerate().find(reaches).expect("all weights together reach a fraction of them");
        prefix = prefix << DIGIT_BITS | digit as u64;
    }
    f64::from_bits(if prefix >> 63 == 1 { prefix ^ 1 << 63 } else { !prefix })
}

/// The sum of the opacities by digit, in steps of 2^-32: sums of whole numbers do not depend on the order.
fn weights(all: &Weighted, digit: impl Fn(&[f32; 3]) -> Option<usize> + Sync) -> Vec<u64> {
    let none = || vec![0; 1 << DIGIT_BITS];
    let parts = all.means.par_chunks(WEIGHED).zip(all.opacities.par_chunks(WEIGHED));
    let sums = parts.map(|(means, opacities)| {
        let mut sums: Vec<u64> = none();
        for (mean, opacity) in means.iter().zip(opacities) {
            if let Some(digit) = digit(mean) {
                sums[digit] += ((f64::from(*opacity) * 2.0_f64.powi(32)) as u64).max(1);
            }
        }
        sums
    });
    sums.reduce(none, |a, b| a.iter().zip(b).map(|(a, b)| a + b).collect())
}

/// Bits that are in the order of the values.
fn ordered(value: f64) -> u64 {
    let bits = value.to_bits();
    if value.is_sign_negative() { !bits } else { bits | 1 << 63 }
}

/// The values at these fractions (0 to 1) of the sorted `values` (nearest rank); 0 if `values` is empty.
pub fn percentiles<const N: usize>(mut values: Vec<f32>, fractions: [f64; N]) -> [f32; N] {
    values.sort_unstable_by(f32::total_cmp);
    fractions.map(|f| values.get((values.len().saturating_sub(1) as f64 * f).round() as usize).copied().unwrap_or(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Builder, Raw};

    #[test]
    fn joined_spheres_touch_the_smallest_sphere_around_them() {
        let sphere = |x: f64, radius: f64| Focus { centre: [x, 2.0, 0.0], radius };
        assert_eq!(sphere(-1.0, 1.0).joined(sphere(5.0, 3.0)), sphere(3.0, 5.0));
        assert_eq!(sphere(5.0, 3.0).joined(sphere(-1.0, 1.0)), sphere(3.0, 5.0));
        // One inside the other, and the same twice.
        assert_eq!(sphere(0.0, 5.0).joined(sphere(2.0, 3.0)), sphere(0.0, 5.0));
        assert_eq!(sphere(2.0, 3.0).joined(sphere(0.0, 5.0)), sphere(0.0, 5.0));
        assert_eq!(sphere(2.0, 3.0).joined(sphere(2.0, 3.0)), sphere(2.0, 3.0));
    }

    fn line(count: usize, x: impl Fn(usize) -> f64 + Sync, opacity_logit: impl Fn(usize) -> f64 + Sync) -> Gaussians {
        let mut builder = Builder::new(0, count).unwrap();
        builder.extend(count, |i, _| Raw {
            mean: [x(i), 0.0, 0.0],
            log_scale: [0.0; 3],
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: opacity_logit(i),
        });
        builder.finish().0
    }

    #[test]
    fn a_quantile_is_the_value_at_which_the_sorted_weights_reach_it() {
        let scene = line(1001, |i| ((i * 611 % 1001) as f64 - 300.0) / 7.0, |i| (i % 9) as f64 - 4.0);
        let mut sorted: Vec<_> = scene.means().iter().zip(scene.opacities()).map(|(m, o)| (m[0], *o)).collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let all = Weighted { means: scene.means(), opacities: scene.opacities() };
        let total: f64 = sorted.iter().map(|(_, o)| f64::from(*o)).sum();
        for fraction in [0.01, 0.25, 0.5, 0.9, 1.0 - 1e-9] {
            let mut sum = 0.0;
            let reached = sorted.iter().find(|(_, o)| {
                sum += f64::from(*o);
                sum >= fraction * total
            });
            assert_eq!(weighted_quantile(&all, |m| m[0].into(), fraction), f64::from(reached.unwrap().0), "{fraction}");
        }
    }

    #[test]
    fn equal_weights_reach_a_half_in_the_middle() {
        for (count, middle) in [(1, 0.0), (2, 0.0), (3, 1.0), (4, 1.0), (10, 4.0)] {
            assert_eq!(Focus::of(&line(count, |i| i as f64, |_| 1.0)).centre[0], middle, "{count} Gaussians");
        }
        assert_eq!(Focus::of(&line(5, |i| -(i as f64), |_| -40.0)).centre[0], -2.0, "faint and negative");
    }
}
