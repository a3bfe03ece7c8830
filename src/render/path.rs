//! The path that drew a frame, and the limits that it was recorded with.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::capacity::Capacity;

/// The path that drew a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Path {
    /// Runs on every device. Splats are listed in tiles.
    Portable,
    /// Needs subgroups of one known size. Splats are listed in bins.
    Fast,
    /// Draws along the ray of every pixel: cameras with lenses, and by the response `ray` all cameras. Splats are
    /// listed in tiles.
    Rays,
    /// Draws along rays likewise. Needs subgroups of one known size. Splats are listed in bins.
    FastRays,
}

impl fmt::Display for Path {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Self::Portable => "portable",
            Self::Fast => "fast",
            Self::Rays => "rays",
            Self::FastRays => "fast-rays",
        })
    }
}

/// The path and the limits that a frame was recorded with.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Limits {
    pub path: Path,
    /// The frame is drawn in slabs.
    pub in_slabs: bool,
    pub capacity: Capacity,
    pub longest_list: u32,
}

/// The two pairs of paths that draw the same pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PathPair {
    /// Those of pinholes.
    Projected,
    /// Those along rays.
    Rays,
}

impl PathPair {
    /// The path that a self-test tests, and the one that it is compared with.
    pub fn paths(self) -> [Path; 2] {
        match self {
            Self::Projected => [Path::Fast, Path::Portable],
            Self::Rays => [Path::FastRays, Path::Rays],
        }
    }
}
