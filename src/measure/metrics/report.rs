//! The report of a comparison, as it is written to JSON.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Difference;

/// The differences that `smalto compare` measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Report {
    /// "smalto compare 1".
    pub format: String,
    /// Viewing condition of FLIP.
    pub pixels_per_degree: f64,
    /// The pairs in the order of their names.
    pub pairs: Vec<Pair>,
    /// The worst value of each measure over the pairs.
    pub worst: Difference,
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
    pub difference: Difference,
}

impl Report {
    /// Name and version of the format, the first member of every report.
    pub const FORMAT: &str = "smalto compare 1";
}
