//! The report of a comparison, as it is written to JSON.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{AlphaDifference, Difference, NumberDifference};

/// The differences that `smalto compare` measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Report {
    /// "smalto compare 2".
    pub format: String,
    /// Viewing condition of FLIP.
    pub pixels_per_degree: f64,
    /// The pairs in the order of their names.
    pub pairs: Vec<Pair>,
    /// The worst value of each measure over the pairs of colours; null if there are none.
    pub worst: Option<Difference>,
    /// The same over the pairs that both have alpha.
    pub worst_alpha: Option<AlphaDifference>,
    /// The same over the pairs of numbers.
    pub worst_numbers: Option<NumberDifference>,
}

/// Two images and their difference.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Pair {
    /// First file, as in the arguments.
    pub a: String,
    /// Second file, as in the arguments.
    pub b: String,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// The difference of the colours, as seen over black; null for numbers.
    pub difference: Option<Difference>,
    /// The difference of alpha; null unless both files have it.
    pub alpha: Option<AlphaDifference>,
    /// The difference of the numbers, if one file has a single channel of floats (depths, counts) and the other has a
    /// single channel; null for colours.
    pub numbers: Option<NumberDifference>,
}

impl Report {
    /// Name and version of the format, the first member of every report.
    pub const FORMAT: &str = "smalto compare 2";
}
