//! The rules of the picture: what is drawn in exact arithmetic, whatever the speed.

use std::fmt;
use std::str::FromStr;

use anyhow::Context;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A contribution below this is skipped: one 8-bit step, part of the trained model. The 32-bit value, like every
/// threshold here: what an f32 renderer compares with.
pub const ALPHA_MIN: f32 = 1.0 / 255.0;
/// No splat covers more.
pub const ALPHA_MAX: f32 = 0.99;
/// The splat that would take the transmittance below this is not added, and ends the pixel.
pub const TRANSMITTANCE_MIN: f32 = 1e-4;
/// px^2, added to both diagonal entries of a projected covariance.
pub const LOW_PASS: f64 = 0.3_f32 as f64;
/// The least factor on an opacity that makes up for the low-pass, so that small splats do not vanish (gsplat since
/// commit 421f7698).
pub const COMPENSATION_MIN: f64 = 0.005;
/// px, width and height of a tile.
pub const TILE: u32 = 16;

/// What the picture is, in exact arithmetic. A trained scene looks as it was trained under the rules of its trainer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rules {
    /// World units: a Gaussian whose mean is not farther ahead of the camera than this is not drawn.
    pub near: f32,
    pub order: Order,
    pub extent: Footprint,
    /// Contributions below this alpha are skipped.
    pub alpha_min: f32,
    /// No splat covers more.
    pub alpha_max: f32,
    /// The splat that would take the transmittance below this is not added, and ends the pixel.
    pub transmittance_min: f32,
    /// The opacity of a splat is lowered as the low-pass widens it (Mip-Splatting, Yu et al. 2024): for scenes that were
    /// trained so.
    pub antialiased: bool,
}

/// What splats are sorted by, front to back. Equal ones stay in the order of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Order {
    /// The view depth of the mean as a 32-bit float: how scenes are trained.
    Depth,
    /// The distance of the mean from the camera as a 32-bit float: KHR_gaussian_splatting.
    Distance,
    /// In every pixel anew, the depth at which the Gaussian is densest along the ray (StopThePop, Radl et al. 2024). The
    /// reference alone can do it.
    PerPixel,
}

/// How far from its mean a splat is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Footprint {
    /// Until its alpha falls below the threshold: nothing is cut.
    Exact,
    /// The same, but nowhere beyond three standard deviations: KHR_gaussian_splatting.
    ThreeSigma,
    /// In the tiles of the square that three standard deviations along its longest axis reach: the original 3DGS.
    ThreeSigmaSquares,
}

impl Order {
    /// Every value with its name on the command line and in reports.
    pub const NAMES: [(&'static str, Self); 3] =
        [("depth", Self::Depth), ("distance", Self::Distance), ("per-pixel", Self::PerPixel)];
}

impl fmt::Display for Order {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let named = Self::NAMES.iter().find(|(_, named)| named == self);
        f.pad(named.expect("every value of the enum has a name").0)
    }
}

impl FromStr for Order {
    type Err = anyhow::Error;

    fn from_str(name: &str) -> anyhow::Result<Self> {
        let named = Self::NAMES.iter().find(|(known, _)| *known == name);
        let expected = || format!("expected {}", Self::NAMES.map(|(name, _)| name).join(", "));
        named.map(|(_, named)| *named).with_context(expected)
    }
}

impl Footprint {
    /// Every value with its name on the command line and in reports.
    pub const NAMES: [(&'static str, Self); 3] =
        [("exact", Self::Exact), ("three-sigma", Self::ThreeSigma), ("three-sigma-squares", Self::ThreeSigmaSquares)];
}

impl fmt::Display for Footprint {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let named = Self::NAMES.iter().find(|(_, named)| named == self);
        f.pad(named.expect("every value of the enum has a name").0)
    }
}

impl FromStr for Footprint {
    type Err = anyhow::Error;

    fn from_str(name: &str) -> anyhow::Result<Self> {
        let named = Self::NAMES.iter().find(|(known, _)| *known == name);
        let expected = || format!("expected {}", Self::NAMES.map(|(name, _)| name).join(", "));
        named.map(|(_, named)| *named).with_context(expected)
    }
}

impl Rules {
    /// Those of the original 3DGS (Kerbl et al. 2023), with footprints that are not cut.
    pub const TRAINED: Self = Self {
        near: 0.2,
        order: Order::Depth,
        extent: Footprint::Exact,
        alpha_min: ALPHA_MIN,
        alpha_max: ALPHA_MAX,
        transmittance_min: TRANSMITTANCE_MIN,
        antialiased: false,
    };
    /// The original program (diff-gaussian-rasterization), tiles cut at three standard deviations included.
    pub const INRIA: Self = Self { extent: Footprint::ThreeSigmaSquares, ..Self::TRAINED };
    /// gsplat 1.5.3, which also draws a mean that lies at the near plane.
    pub const GSPLAT: Self = Self { near: 0.01_f32.next_down(), alpha_max: 0.999, ..Self::TRAINED };
    /// KHR_gaussian_splatting (glTF), which has no threshold, no cap and no stop; alphas below 1e-5 are skipped all the
    /// same.
    pub const KHR: Self = Self {
        order: Order::Distance,
        extent: Footprint::ThreeSigma,
        alpha_min: 1e-5,
        alpha_max: 1.0,
        transmittance_min: 0.0,
        ..Self::TRAINED
    };

    /// The same with hardly a contribution left out: what alpha thresholds and stops approximate.
    pub fn complete(self) -> Self {
        Self { alpha_min: 1e-9, transmittance_min: 0.0, extent: Footprint::Exact, ..self }
    }
}

/// What lies behind the scene: a colour, or nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Background {
    /// Red, green, blue as displayed; 1 is white.
    Colour([f32; 3]),
    Transparent,
}

impl Background {
    pub const BLACK: Self = Self::Colour([0.0; 3]);

    /// What is blended behind the last splat.
    pub fn colour(self) -> [f32; 3] {
        match self {
            Self::Colour(colour) => colour,
            Self::Transparent => [0.0; 3],
        }
    }
}
