//! What a comparison says, as it is written to JSON.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Difference;

/// What `smalto compare` found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Report {
    /// "smalto compare 1".
    pub format: String,
    /// At which FLIP takes the images to be seen.
    pub pixels_per_degree: f64,
    /// In the order of the names.
    pub pairs: Vec<Pair>,
    /// The worst value of each measure over the pairs.
    pub worst: Difference,
}

/// Two images.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Pair {
    /// Files, as the command was given them.
    pub a: String,
    pub b: String,
    /// Width and height in pixels.
    pub size: [u32; 2],
    pub difference: Difference,
}

impl Report {
    /// The first member of every report: what it is, and by which rules.
    pub const FORMAT: &str = "smalto compare 1";
}
