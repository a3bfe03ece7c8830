//! Statistics of repeated measurements of one quantity.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Minimum, median, mean, and the 95th and 99th percentiles (nearest rank).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Statistics {
    pub min: f64,
    pub median: f64,
    pub mean: f64,
    pub p95: f64,
    pub p99: f64,
}

impl Statistics {
    /// Column names of tables.
    pub const COLUMNS: [&str; 5] = ["min", "median", "mean", "p95", "p99"];

    /// The numbers in the order of [`Statistics::COLUMNS`].
    pub fn columns(&self) -> [f64; 5] {
        [self.min, self.median, self.mean, self.p95, self.p99]
    }

    /// The statistics of at least one sample.
    ///
    /// # Panics
    /// If there are no samples.
    pub fn of(samples: impl IntoIterator<Item = f64>) -> Self {
        let mut samples: Vec<f64> = samples.into_iter().collect();
        assert!(!samples.is_empty(), "statistics need at least one sample");
        samples.sort_unstable_by(f64::total_cmp);
        let at = |fraction: f64| samples[((samples.len() as f64 * fraction).ceil() as usize).max(1) - 1];
        Self {
            min: samples[0],
            median: f64::midpoint(at(0.5), samples[samples.len() / 2]),
            mean: samples.iter().sum::<f64>() / samples.len() as f64,
            p95: at(0.95),
            p99: at(0.99),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_are_of_the_sorted_samples() {
        let of = |samples: &[f64]| Statistics::of(samples.iter().copied());
        let hundred: Vec<f64> = (1..=100).rev().map(f64::from).collect();
        let expected = Statistics { min: 1.0, median: 50.5, mean: 50.5, p95: 95.0, p99: 99.0 };
        assert_eq!(of(&hundred), expected);
        let expected = Statistics { min: 1.0, median: 2.0, mean: 2.0, p95: 3.0, p99: 3.0 };
        assert_eq!(of(&[3.0, 1.0, 2.0]), expected);
        assert_eq!(of(&[7.0]).p99, 7.0);
    }
}
