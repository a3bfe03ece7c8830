//! The thresholds of a comparison.

use anyhow::Result;

use super::{Args, Compared};
use crate::cli::OverThreshold;
use crate::measure::metrics::{Difference, NumberDifference, Pair};

/// The value of a measure for a pair.
enum Measured {
    /// The measure does not apply to this kind of pair.
    No,
    /// Not measurable, which is over every threshold.
    Impossible(String),
    Value(f64),
}

/// A threshold on a measure.
struct Limit {
    option: &'static str,
    measure: &'static str,
    bound: f64,
    /// Larger values are better, so the bound is the least allowed.
    is_least: bool,
    measured: fn(&Pair) -> Measured,
}

impl Limit {
    /// The thresholds on the command line.
    fn all(args: &Args) -> Vec<Self> {
        let limit = |option, measure, bound: Option<f64>, is_least, measured| {
            bound.map(|bound| Self { option, measure, bound, is_least, measured })
        };
        // The largest difference is an f32, so the bound is rounded in the same way.
        let max_error = args.max_error.map(|bound| f64::from(bound as f32));
        let all = [
            limit("--max-error", "largest error", max_error, false, |pair| {
                of_colours(pair, |d| Some(f64::from(d.max_error)))
            }),
            limit("--min-psnr", "PSNR", args.min_psnr, true, |pair| {
                of_colours(pair, |d| Some(d.psnr_db.unwrap_or(f64::INFINITY)))
            }),
            limit("--min-ssim", "SSIM", args.min_ssim, true, |pair| of_colours(pair, |d| d.ssim)),
            limit("--max-flip", "FLIP", args.max_flip, false, |pair| of_colours(pair, |d| Some(d.flip))),
            limit("--max-alpha-error", "largest error of alpha", args.max_alpha_error, false, |pair| {
                pair.alpha.map_or(Measured::No, |alpha| Measured::Value(alpha.max_error))
            }),
            limit("--max-depth-error", "largest error of depth", args.max_depth_error, false, largest_of_numbers),
            limit("--max-depth-outliers", "fraction of outliers", args.max_depth_outliers, false, |pair| {
                pair.numbers.as_ref().map_or(Measured::No, |numbers| Measured::Value(numbers.over.percent_1))
            }),
        ];
        all.into_iter().flatten().collect()
    }

    /// The amount by which a pair is over the threshold; infinite if its measure is impossible.
    fn excess(&self, pair: &Pair) -> f64 {
        match (self.measured)(pair) {
            Measured::No => f64::NEG_INFINITY,
            Measured::Impossible(_) => f64::INFINITY,
            Measured::Value(value) if value.is_nan() => f64::INFINITY,
            Measured::Value(value) if self.is_least => self.bound - value,
            Measured::Value(value) => value - self.bound,
        }
    }

    /// Describes the pair that is farthest over the threshold, if any is over it.
    fn complaint(&self, compared: &[Compared]) -> Option<String> {
        let excess = |one: &&Compared| self.excess(&one.pair);
        let worst = compared.iter().filter(|one| excess(one) > 0.0).max_by(|x, y| excess(x).total_cmp(&excess(y)))?;
        let (title, Self { option, measure, bound, .. }) = (&worst.title, self);
        let (bound, than) = (*bound as f32, if self.is_least { "under" } else { "over" });
        Some(match (self.measured)(&worst.pair) {
            Measured::Impossible(why) => format!("{title}: {option} {bound}: {why}"),
            Measured::Value(value) => format!("{title}: {measure} {} is {than} {option} {bound}", value as f32),
            Measured::No => return None,
        })
    }
}

fn of_colours(pair: &Pair, value: fn(&Difference) -> Option<f64>) -> Measured {
    match &pair.difference {
        None => Measured::No,
        Some(Difference { non_finite: pixels @ 1.., .. }) => {
            Measured::Impossible(format!("pixels with infinities or NaN: {pixels}; none is allowed"))
        }
        Some(difference) => value(difference).map_or_else(
            || Measured::Impossible("the pictures are too small: SSIM needs at least 11x11 pixels".to_owned()),
            Measured::Value,
        ),
    }
}

fn largest_of_numbers(pair: &Pair) -> Measured {
    match &pair.numbers {
        None => Measured::No,
        Some(NumberDifference { unmatched: pixels @ 1.., .. }) => {
            Measured::Impossible(format!("pixels with a number in only one picture: {pixels}; none is allowed"))
        }
        Some(numbers) => Measured::Value(numbers.max_error),
    }
}

/// Fails if a pair is over a threshold, or if thresholds are given and none judges the pair.
pub(super) fn judge(args: &Args, compared: &[Compared]) -> Result<()> {
    let limits = Limit::all(args);
    let mut complaints: Vec<_> = limits.iter().filter_map(|limit| limit.complaint(compared)).collect();
    let is_judged = |one: &&Compared| limits.iter().any(|limit| !matches!((limit.measured)(&one.pair), Measured::No));
    if let Some(one) = compared.iter().find(|one| !limits.is_empty() && !is_judged(one)) {
        let (kind, needs) = match one.pair.numbers {
            Some(_) => ("numbers such as depths", "--max-depth-error or --max-depth-outliers"),
            None => ("colours", "--max-error, --min-psnr, --min-ssim or --max-flip"),
        };
        complaints.push(format!("{}: no threshold judges {kind}: {needs} would", one.title));
    }
    if complaints.is_empty() { Ok(()) } else { Err(OverThreshold(complaints.join("; ")).into()) }
}
