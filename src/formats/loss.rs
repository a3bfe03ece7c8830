//! The loss of writing a scene to a file: the difference of every attribute.

use std::ops::{Range, RangeInclusive};

use rayon::prelude::*;
use schemars::JsonSchema;
use serde::Serialize;

use crate::scene::harmonics::C0;
use crate::scene::{Gaussians, LoadReport, MAX_SH_DEGREE, sh_coefficients};

/// The difference of one attribute between two scenes, over all Gaussians.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Loss {
    /// Name of the attribute.
    pub attribute: &'static str,
    /// Unit of the differences.
    pub unit: &'static str,
    /// Largest difference.
    pub largest: f64,
    /// Root mean square of the differences.
    pub rms: f64,
}

/// Largest difference, sum of squares, and number of differences.
#[derive(Clone, Copy, Default)]
struct Sum(f64, f64, usize);

impl Sum {
    fn with(self, difference: f64) -> Self {
        Self(self.0.max(difference), self.1 + difference * difference, self.2 + 1)
    }

    fn and(self, other: Self) -> Self {
        Self(self.0.max(other.0), self.1 + other.1, self.2 + other.2)
    }
}

/// The attributes of SH degrees 1 and up.
const HARMONICS: [&str; MAX_SH_DEGREE as usize] = ["SH degree 1", "SH degree 2", "SH degree 3", "SH degree 4"];

/// Gaussians per partial sum. The size is fixed so that sums are equal on any number of cores.
const CHUNK: usize = 1 << 14;

impl Loss {
    /// Compares two scenes with the same Gaussians in the same order, attribute by attribute. Coefficients above the
    /// lower of the two SH degrees are compared with 0.
    ///
    /// # Panics
    /// If the scenes differ in their number of Gaussians.
    pub fn between(before: &Gaussians, after: &Gaussians) -> Vec<Self> {
        assert_eq!(before.len(), after.len(), "a loss is between two versions of the same Gaussians");
        let row = |attribute, unit, difference: &(dyn Fn(usize) -> f64 + Sync)| {
            Self::over(before.len(), attribute, unit, difference)
        };
        let mut rows = vec![
            row("position", "world units", &|i| distance(before.means()[i], after.means()[i])),
            row("scale", "relative to the larger of both", &|i| {
                let pairs = before.scales()[i].into_iter().zip(after.scales()[i]);
                pairs.map(|(a, b)| relative(a, b)).fold(0.0, f64::max)
            }),
            row("rotation", "degrees", &|i| angle(before.rotations()[i], after.rotations()[i])),
            row("opacity", "of 1", &|i| f64::from((before.opacities()[i] - after.opacities()[i]).abs())),
            row("colour", "of 1", &|i| C0 * largest(before.sh(i)[0], after.sh(i)[0])),
        ];
        let at = |sh: &[[f32; 3]], index: usize| sh.get(index).copied().unwrap_or([0.0; 3]);
        rows.extend(Self::of_harmonics(before.len(), 1..=before.sh_degree().max(after.sh_degree()), |i, k| {
            largest(at(before.sh(i), k), at(after.sh(i), k))
        }));
        rows
    }

    /// The loss of a file with that of reading its scene, which rounds positions to 32-bit floats. The sum of both is
    /// an upper bound.
    pub fn with_reading(mut all: Vec<Self>, report: &LoadReport) -> Vec<Self> {
        let kept = report.read.saturating_sub(report.dropped()).max(1);
        if let Some(position) = all.iter_mut().find(|loss| loss.attribute == "position") {
            position.largest += report.displacement;
            position.rms += (report.displacement_squares / kept as f64).sqrt();
        }
        all
    }

    /// The loss of the SH degrees above `kept`, which a format leaves out.
    pub fn left_out(gaussians: &Gaussians, kept: u32) -> Vec<Self> {
        let degrees = kept + 1..=gaussians.sh_degree();
        Self::of_harmonics(gaussians.len(), degrees, |i, k| largest(gaussians.sh(i)[k], [0.0; 3]))
    }

    /// The loss of these SH degrees of `count` Gaussians, from the difference of each coefficient of each Gaussian.
    fn of_harmonics(
        count: usize,
        degrees: RangeInclusive<u32>,
        difference: impl Fn(usize, usize) -> f64 + Sync,
    ) -> Vec<Self> {
        let of_degree = |degree: u32| {
            let indices = sh_coefficients(degree - 1)..sh_coefficients(degree);
            Self::over(count, HARMONICS[degree as usize - 1], "coefficient", &|i| {
                indices.clone().map(|k| difference(i, k)).fold(0.0, f64::max)
            })
        };
        degrees.map(of_degree).collect()
    }

    /// The loss of an attribute of `count` Gaussians, from the difference of each.
    fn over(
        count: usize,
        attribute: &'static str,
        unit: &'static str,
        difference: &(dyn Fn(usize) -> f64 + Sync),
    ) -> Self {
        let firsts: Vec<usize> = (0..count).step_by(CHUNK).collect();
        let sums = firsts.par_iter().map(|first| {
            let all: Range<usize> = *first..count.min(first + CHUNK);
            all.fold(Sum::default(), |sum, i| sum.with(difference(i)))
        });
        let Sum(largest, squares, count) = sums.collect::<Vec<_>>().into_iter().fold(Sum::default(), Sum::and);
        Self { attribute, unit, largest, rms: (squares / count.max(1) as f64).sqrt() }
    }

    /// The loss of a scene of several parts, from the number of Gaussians and the loss of each. All have the same SH
    /// degree.
    pub fn joined(parts: &[(usize, Vec<Self>)]) -> Vec<Self> {
        let all: usize = parts.iter().map(|(count, _)| count).sum();
        let mut rows = parts.first().map_or_else(Vec::new, |(_, rows)| rows.clone());
        for (row, joined) in rows.iter_mut().enumerate() {
            let of_parts = || parts.iter().map(|(count, rows)| (*count as f64, &rows[row]));
            joined.largest = of_parts().map(|(_, loss)| loss.largest).fold(0.0, f64::max);
            let squares: f64 = of_parts().map(|(count, loss)| count * loss.rms.powi(2)).sum();
            joined.rms = (squares / all.max(1) as f64).sqrt();
        }
        rows
    }
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(b)).powi(2)).sum::<f64>().sqrt()
}

fn largest(a: [f32; 3], b: [f32; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(b)).abs()).fold(0.0, f64::max)
}

fn relative(a: f32, b: f32) -> f64 {
    let [a, b] = [a, b].map(f64::from);
    if a == b { 0.0 } else { (a - b).abs() / a.max(b) }
}

/// Angle between two rotations in degrees. It is computed from the sine of a quarter of it: near 0 the cosine has no
/// precision left.
fn angle(a: [f32; 4], b: [f32; 4]) -> f64 {
    let [a, b] = [a, b].map(|q| q.map(f64::from));
    let chord = |sign: f64| a.iter().zip(b).map(|(a, b)| (a - sign * b).powi(2)).sum::<f64>().sqrt();
    4.0 * (chord(1.0).min(chord(-1.0)) / 2.0).min(1.0).asin().to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Builder, Raw};

    fn one(raw: Raw, sh: &[[f32; 3]]) -> Gaussians {
        let mut builder = Builder::new((sh.len() as f64).sqrt() as u32 - 1, 1).unwrap();
        builder.extend(1, |_, out| {
            out.copy_from_slice(sh);
            raw
        });
        builder.finish().0
    }

    #[test]
    fn every_attribute_has_its_own_difference() {
        let raw =
            Raw { mean: [1.0, 2.0, 3.0], log_scale: [0.0; 3], rotation: [1.0, 0.0, 0.0, 0.0], opacity_logit: 0.0 };
        let half = 5_f64.to_radians();
        let other = Raw {
            mean: [1.0, 2.5, 3.0],
            log_scale: [0.0, 0.0, 2_f64.ln()],
            rotation: [-half.cos(), -half.sin(), 0.0, 0.0],
            opacity_logit: 3_f64.ln(),
        };
        let losses = Loss::between(&one(raw, &[[0.5; 3]; 4]), &one(other, &[[0.5, 0.5, 0.25]]));
        let found: Vec<_> = losses.iter().map(|loss| (loss.attribute, loss.largest)).collect();
        let expected = [
            ("position", 0.5),
            ("scale", 0.5),
            ("rotation", 10.0),
            ("opacity", 0.25),
            ("colour", 0.25 * C0),
            ("SH degree 1", 0.5),
        ];
        assert_eq!(found.len(), expected.len());
        for ((name, value), (expected_name, expected)) in found.into_iter().zip(expected) {
            assert_eq!(name, expected_name);
            assert!((value - expected).abs() < 1e-5, "{name}: {value}");
        }
    }

    #[test]
    fn a_scene_has_lost_nothing_of_itself() {
        let raw = Raw {
            mean: [1.0; 3],
            log_scale: [f64::NEG_INFINITY; 3],
            rotation: [0.1, 0.2, 0.3, 0.4],
            opacity_logit: 2.0,
        };
        let scene = one(raw, &[[0.1; 3]]);
        assert!(Loss::between(&scene, &scene).iter().all(|loss| loss.largest == 0.0 && loss.rms == 0.0));
    }

    #[test]
    fn degrees_that_are_left_out_are_lost_whole() {
        let raw = Raw { mean: [1.0; 3], log_scale: [0.0; 3], rotation: [1.0, 0.0, 0.0, 0.0], opacity_logit: 2.0 };
        let mut sh = [[0.25; 3]; 25];
        sh[24] = [0.0, -0.75, 0.5];
        let losses = Loss::left_out(&one(raw, &sh), 2);
        let found: Vec<_> = losses.iter().map(|loss| (loss.attribute, loss.largest, loss.rms)).collect();
        assert_eq!(found, [("SH degree 3", 0.25, 0.25), ("SH degree 4", 0.75, 0.75)]);
        assert!(Loss::left_out(&one(raw, &sh), 4).is_empty());
    }

    #[test]
    fn parts_are_joined_by_their_numbers_of_gaussians() {
        let loss = |largest, rms| vec![Loss { attribute: "opacity", unit: "of 1", largest, rms }];
        let joined = Loss::joined(&[(1, loss(3.0, 2.0)), (3, loss(5.0, 4.0))]);
        assert_eq!(joined, loss(5.0, (52.0_f64 / 4.0).sqrt()));
        assert!(Loss::joined(&[]).is_empty());
    }
}
