//! The limit of the change of a view, and the change itself.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::measure::metrics::{max_error, mse};
use crate::pixels::Pixels;

/// The largest change of a view.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Limit {
    /// Largest change of a colour value of a pixel. White is 1.
    MaxError(f64),
    /// Least PSNR in dB.
    Psnr(f64),
}

/// The change of a view.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Change {
    /// Largest change of a colour value.
    pub largest: f64,
    /// Mean squared change over all colour values.
    pub mean_square: f64,
}

impl Change {
    /// Measures the change from one picture to another.
    pub fn between(a: &Pixels, b: &Pixels) -> Self {
        Self { largest: max_error(a, b).into(), mean_square: mse(a, b) }
    }

    /// The larger value of each measure.
    pub fn max(self, other: Self) -> Self {
        Self { largest: self.largest.max(other.largest), mean_square: self.mean_square.max(other.mean_square) }
    }

    /// The PSNR in dB for a peak of 1; `None` if nothing changed.
    pub fn psnr_db(self) -> Option<f64> {
        (self.mean_square > 0.0).then(|| -10.0 * self.mean_square.log10())
    }
}

impl Limit {
    /// True if a change is within the limit. NaN is within no limit.
    pub fn allows(self, change: Change) -> bool {
        match self {
            Self::MaxError(most) => change.largest <= most,
            Self::Psnr(least) => change.psnr_db().map_or(change.mean_square == 0.0, |db| db >= least),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_allows_what_is_within_it() {
        let change = Change { largest: 0.02, mean_square: 1e-5 };
        assert!(Limit::MaxError(0.02).allows(change) && !Limit::MaxError(0.019).allows(change));
        assert!(Limit::Psnr(50.0).allows(change) && !Limit::Psnr(50.1).allows(change));
        assert!(Limit::Psnr(500.0).allows(Change::default()) && Limit::MaxError(0.0).allows(Change::default()));
        let broken = Change { largest: f64::NAN, mean_square: f64::NAN };
        assert!(!Limit::Psnr(1.0).allows(broken) && !Limit::MaxError(1.0).allows(broken));
    }
}
