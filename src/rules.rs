//! The rules of a picture. They define its colours in exact arithmetic; speed plays no part.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Contributions with a lower alpha are skipped: one 8-bit step, part of the trained model. Thresholds are 32-bit
/// floats because f32 renderers compare with them.
pub const ALPHA_MIN: f32 = 1.0 / 255.0;
/// Largest alpha of a splat at a pixel.
pub const ALPHA_MAX: f32 = 0.99;
/// A pixel ends before the splat that would take its transmittance below this.
pub const TRANSMITTANCE_MIN: f32 = 1e-4;
/// The alpha down to which splats are listed when a certificate is computed, and the least that `--alpha-min` takes.
pub const LISTED_ALPHA: f32 = 1e-12;
/// px^2, added to both diagonal entries of a projected covariance (the low-pass of the original 3DGS).
pub const LOW_PASS: f64 = 0.3_f32 as f64;
/// Smallest factor on an opacity that compensates for the low-pass, so that small splats do not vanish (gsplat since
/// commit 421f7698).
pub const COMPENSATION_MIN: f64 = 0.005;
/// Width and height of a tile in pixels.
pub const TILE: u32 = 16;

/// The rules of a picture in exact arithmetic. A trained scene looks as in training when it is drawn by the rules of
/// its trainer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rules {
    /// Near plane in world units: a Gaussian is drawn only if the depth of its mean is larger.
    pub near: f32,
    /// The weight of a Gaussian at a pixel of a pinhole.
    #[serde(default)]
    pub response: Response,
    /// Sort key of the splats.
    pub order: Order,
    /// How far from its mean a splat is drawn.
    pub extent: Footprint,
    /// Contributions below this alpha are skipped.
    pub alpha_min: f32,
    /// Largest alpha of a splat at a pixel.
    pub alpha_max: f32,
    /// A pixel ends before the splat that would take its transmittance below this.
    pub transmittance_min: f32,
    /// Multiplies the opacity of a splat by the ratio of its areas before and after the low-pass (Mip-Splatting, Yu et
    /// al. 2024). For scenes that were trained so.
    pub antialiased: bool,
    /// Sums of spherical harmonics are features, numbers of any sign: 0.5 is not added, and negative sums are kept.
    /// Only the library draws features, so that reports do not have this rule.
    #[serde(skip)]
    pub features: bool,
}

/// Sort key of the splats, front to back. Splats with equal keys keep the order of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Order {
    /// View depth of the mean as a 32-bit float. Scenes are trained in this order.
    Depth,
    /// Distance of the mean from the camera as a 32-bit float (KHR_gaussian_splatting).
    Distance,
    /// Per pixel, the depth at which the Gaussian is densest along the ray (StopThePop, Radl et al. 2024). Only the
    /// reference supports it.
    PerPixel,
}

/// The weight of a Gaussian at a pixel of a pinhole. Cameras with lenses are drawn along rays by both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Response {
    /// The value of its projection, which is made with the derivative at its mean (EWA splatting). Scenes are trained
    /// so.
    #[default]
    Screen,
    /// The greatest value along the ray of the pixel. Splats are in the order of their distance.
    Ray,
}

/// How far from its mean a splat is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Footprint {
    /// Up to where its alpha falls below the threshold; nothing is cut.
    Exact,
    /// As `Exact`, but at most three standard deviations (KHR_gaussian_splatting).
    ThreeSigma,
    /// In all tiles of the square whose half side is three standard deviations along the longest axis (the original
    /// 3DGS).
    ThreeSigmaSquares,
}

impl Order {
    /// Every value with its name on the command line and in reports.
    pub const NAMES: [(&'static str, Self); 3] =
        [("depth", Self::Depth), ("distance", Self::Distance), ("per-pixel", Self::PerPixel)];
}

impl Footprint {
    /// Every value with its name on the command line and in reports.
    pub const NAMES: [(&'static str, Self); 3] =
        [("exact", Self::Exact), ("three-sigma", Self::ThreeSigma), ("three-sigma-squares", Self::ThreeSigmaSquares)];
}

impl Response {
    /// Every value with its name on the command line and in reports.
    pub const NAMES: [(&'static str, Self); 2] = [("screen", Self::Screen), ("ray", Self::Ray)];
}

/// Writes and reads the values of an enum by their `NAMES`.
macro_rules! by_name {
    ($($type:ty),+) => {$(
        impl std::fmt::Display for $type {
            fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                let named = Self::NAMES.iter().find(|(_, named)| named == self);
                f.pad(named.expect("every value of the enum has a name").0)
            }
        }

        impl std::str::FromStr for $type {
            type Err = anyhow::Error;

            fn from_str(name: &str) -> anyhow::Result<Self> {
                let named = Self::NAMES.iter().find(|(known, _)| *known == name);
                let expected = || format!("expected {}", Self::NAMES.map(|(name, _)| name).join(", "));
                anyhow::Context::with_context(named.map(|(_, named)| *named), expected)
            }
        }
    )+};
}

pub(crate) use by_name;

by_name!(Order, Response, Footprint);

impl Rules {
    /// The rules of the original 3DGS (Kerbl et al. 2023), with footprints that are not cut.
    pub const TRAINED: Self = Self {
        near: 0.2,
        response: Response::Screen,
        order: Order::Depth,
        extent: Footprint::Exact,
        alpha_min: ALPHA_MIN,
        alpha_max: ALPHA_MAX,
        transmittance_min: TRANSMITTANCE_MIN,
        antialiased: false,
        features: false,
    };
    /// The rules of the original program (diff-gaussian-rasterization), which cuts footprints to squares of tiles.
    pub const INRIA: Self = Self { extent: Footprint::ThreeSigmaSquares, ..Self::TRAINED };
    /// The rules of gsplat 1.5.3. Its near plane is inclusive: it also draws a mean exactly on it.
    pub const GSPLAT: Self = Self { near: 0.01_f32.next_down(), alpha_max: 0.999, ..Self::TRAINED };
    /// The rules of KHR_gaussian_splatting (glTF). The specification has no alpha threshold, cap or stop; here, alphas
    /// below 1e-5 are skipped to bound the footprints.
    pub const KHR: Self = Self {
        order: Order::Distance,
        extent: Footprint::ThreeSigma,
        alpha_min: 1e-5,
        alpha_max: 1.0,
        transmittance_min: 0.0,
        ..Self::TRAINED
    };

    /// These rules without stop and with a threshold of 1e-9: the sum that thresholds and stops approximate.
    pub fn complete(self) -> Self {
        Self { alpha_min: 1e-9, transmittance_min: 0.0, extent: Footprint::Exact, ..self }
    }
}

/// The background of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Background {
    /// Red, green, blue as displayed; 1 is white.
    Colour([f32; 3]),
    /// None: the picture keeps its coverage as alpha.
    Transparent,
}

impl Background {
    /// Opaque black.
    pub const BLACK: Self = Self::Colour([0.0; 3]);

    /// The colour that is blended behind the last splat; black if transparent.
    pub fn colour(self) -> [f32; 3] {
        match self {
            Self::Colour(colour) => colour,
            Self::Transparent => [0.0; 3],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn command_line_names_are_those_of_reports() {
        assert!(Order::NAMES.iter().all(|(name, order)| serde_json::json!(order) == *name));
        assert!(Footprint::NAMES.iter().all(|(name, footprint)| serde_json::json!(footprint) == *name));
    }
}
