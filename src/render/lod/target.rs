//! The target of a selection of levels of detail, and the report of its result.
//!
//! A node is drawn if its error is within the error limit of its group, and its parent's error is above the limit of
//! the parent's group. The limit of a group follows from the width of a pixel at its box. Boxes contain the boxes of
//! their children, and errors do not decrease towards the root, so exactly one node is drawn on the path from any
//! Gaussian to the root.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::lod::FINEST;
use crate::options::Options;
use crate::pagefile::{PARTS, PageLod, SAMPLES};
use crate::render::constants::fade_codes;
use crate::render::shaders::SelectionState;
use crate::render::shaders::lod::{BY_ERROR, BY_NODES, ERROR_UNITS};

/// A cut through levels of detail.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "Detailed")]
pub struct LodReport {
    /// The limit: the change of the picture per node that is saved, in pixels times steps of 1/255.
    pub lod_error: f64,
    /// Nodes of the cut that lie in the picture, hidden or not, as the table of levels and samples of pages tell: about
    /// those that are drawn.
    pub nodes: f64,
    /// Pages that hold the cut.
    pub pages: u64,
    /// The PSNR if the measured errors of these nodes were independent and none were hidden, dB; null without errors.
    /// No bound, and far below the PSNR of most pictures (docs/levels.md).
    pub predicted_psnr: Option<f64>,
    /// The PSNR of the picture against that of all Gaussians, dB; null if it was not measured, or no pixel differs.
    pub measured_psnr: Option<f64>,
    /// The standard error of `measured_psnr` if that is estimated from patches of the picture, dB; otherwise null.
    pub standard_error: Option<f64>,
    /// The number of patches of the estimate, and of all that pages touch; otherwise null.
    pub patches: Option<[u32; 2]>,
}

/// The PSNR of a picture by levels of detail against the picture of all Gaussians, estimated from a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampledPsnr {
    /// The mean squared error of the colour values of the whole picture: an unbiased estimate.
    pub mse: f64,
    /// The standard error of `mse`; 0 if the sample is the whole picture.
    pub standard_error: f64,
    /// The number of patches that were drawn, and of all that pages touch: others show the background alone.
    pub patches: [u32; 2],
}

impl SampledPsnr {
    /// The PSNR in dB; infinite if no pixel differs.
    pub fn psnr(&self) -> f64 {
        -10.0 * self.mse.log10()
    }

    /// By how many dB the PSNR exceeds a wanted one, with one standard error to spare.
    pub fn surplus(&self, wanted: f64) -> f64 {
        let error = self.mse + self.standard_error;
        // An error that no picture shows counts as one below the resolution of floats.
        if error.is_finite() { -10.0 * error.max(1e-18).log10() - wanted } else { f64::NEG_INFINITY }
    }

    /// The standard error of the PSNR in dB, to first order in that of `mse`.
    pub fn standard_error_db(&self) -> f64 {
        if self.mse == 0.0 { 0.0 } else { 10.0 / std::f64::consts::LN_10 * self.standard_error / self.mse }
    }
}

impl LodReport {
    /// True if the search ended above all errors: the file has no coarser nodes.
    pub fn is_coarsest(&self) -> bool {
        self.lod_error > ABOVE_ALL
    }

    pub(crate) fn of(state: &SelectionState) -> Self {
        let wide = |[low, high]: [u32; 2]| f64::from(high) * 32f64.exp2() + f64::from(low);
        Self {
            lod_error: 255.0 * f64::from(f32::from_bits(state.limit_squared)).sqrt(),
            nodes: wide(state.nodes) / NODE_UNITS,
            pages: state.selected.into(),
            predicted_psnr: Some(-10.0 * (wide(state.squared_error) / f64::from(ERROR_UNITS).exp2()).log10())
                .filter(|db| db.is_finite()),
            measured_psnr: None,
            standard_error: None,
            patches: None,
        }
    }

    /// The report with a PSNR that was estimated.
    pub fn with(self, sampled: &SampledPsnr) -> Self {
        Self {
            measured_psnr: Some(sampled.psnr()).filter(|db| db.is_finite()),
            standard_error: Some(sampled.standard_error_db()),
            patches: Some(sampled.patches),
            ..self
        }
    }
}

/// Above the error of any node, in pixels times steps of 1/255.
const ABOVE_ALL: f64 = 1e9;

/// Units per node in sums of nodes: the number of samples per page.
pub const NODE_UNITS: f64 = SAMPLES as f64;

/// The target that the options set, as limit.glsl reads it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LodTarget {
    /// The square of the error limit of the options.
    pub given_squared: f32,
    /// One bit per search.
    pub searches: u32,
    pub max_nodes: [u32; 2],
    /// Largest predicted squared error.
    pub max_error: [u32; 2],
    /// Codes above a limit over which nodes cross-fade.
    pub fade: u32,
}

impl LodTarget {
    /// The limit is 0 if the options do not request levels of detail.
    pub fn of(options: &Options) -> Self {
        let Options { lod_error, lod_psnr, splats, .. } = *options;
        let words = |wide: u64| [wide as u32, (wide >> 32) as u32];
        let given = if lod_psnr > 0.0 { 0.0 } else { f64::from(lod_error) / 255.0 };
        let error = 10_f64.powf(-f64::from(lod_psnr) / 10.0) * f64::from(ERROR_UNITS).exp2();
        Self {
            given_squared: (given * given) as f32,
            searches: u32::from(lod_psnr > 0.0) << BY_ERROR | u32::from(splats > 0) << BY_NODES,
            max_nodes: words(u64::from(splats) * NODE_UNITS as u64),
            max_error: words(error as u64),
            fade: fade_codes(options),
        }
    }
}

/// Estimates the drawn fraction of the nodes of a page under error limits, from the page table.
pub fn drawn_fraction(level: &PageLod, [own, parent]: [u16; 2]) -> f64 {
    (fraction_below(&level.errors, level.least_error, own) - fraction_below(&level.parent_errors, FINEST, parent))
        .max(0.0)
}

/// The fraction of the nodes whose error is at most `limit`, given the largest error of each eighth of the nodes.
fn fraction_below(largest: &[u16; PARTS], least: u16, limit: u16) -> f64 {
    let whole = largest.partition_point(|code| *code <= limit);
    if whole == PARTS {
        return 1.0;
    }
    let from = f64::from(if whole == 0 { least } else { largest[whole - 1] });
    let inside = ((f64::from(limit) - from) / (f64::from(largest[whole]) - from).max(1.0)).clamp(0.0, 1.0);
    (whole as f64 + inside) / PARTS as f64
}
