//! The cut through the levels of detail of a scene, in numbers: what is asked for, and what was found.
//!
//! A node is drawn if its own error is within the limit of its page, and its parent's is not within that of its own
//! page. The limit of a page follows from the width of a pixel at its box. Boxes hold those of their children and
//! errors do not fall towards the root, so on the way from any Gaussian to the root exactly one node is drawn.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::lod::FINEST;
use crate::options::Options;
use crate::pagefile::{PARTS, PageLod, SAMPLES};
use crate::render::constants::fade_codes;
use crate::render::shaders::CutState;
use crate::render::shaders::lod::{BY_ENERGY, BY_NODES, ENERGY_UNITS};

/// A cut through levels of detail.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Detailed {
    /// The limit: the change of the picture per node that is saved, in pixels times steps of 1/255.
    pub lod_error: f64,
    /// Nodes of the cut that lie in the picture, hidden or not, as the table of levels and samples of pages tell: about
    /// those that are drawn.
    pub nodes: f64,
    /// Pages that hold the cut.
    pub pages: u64,
    /// The PSNR that the measured errors of these nodes predict, dB; null if no error is predicted.
    pub predicted_psnr: Option<f64>,
    /// The PSNR of the picture against that of all Gaussians, dB; null if it was not measured, or both are equal.
    pub measured_psnr: Option<f64>,
}

impl Detailed {
    /// True if the search for a limit ended above all errors: there are no coarser nodes, whatever is asked for.
    pub fn is_coarsest(&self) -> bool {
        self.lod_error > ABOVE_ALL
    }

    pub(crate) fn of(state: &CutState) -> Self {
        let wide = |[low, high]: [u32; 2]| f64::from(high) * 32f64.exp2() + f64::from(low);
        Self {
            lod_error: 255.0 * f64::from(f32::from_bits(state.limit_squared)).sqrt(),
            nodes: wide(state.nodes) / NODE_UNITS,
            pages: state.listed.into(),
            predicted_psnr: Some(-10.0 * (wide(state.energy) / f64::from(ENERGY_UNITS).exp2()).log10())
                .filter(|db| db.is_finite()),
            measured_psnr: None,
        }
    }
}

/// No node has as large an error, in pixels times steps of 1/255.
const ABOVE_ALL: f64 = 1e9;

/// Units of a node where nodes are counted: nodes of a page that are looked for in the picture.
pub const NODE_UNITS: f64 = SAMPLES as f64;

/// What the options ask for, as limit.glsl reads it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wanted {
    pub given_squared: f32,
    /// A bit for each search.
    pub searches: u32,
    pub most_nodes: [u32; 2],
    pub most_energy: [u32; 2],
    /// Codes above a limit over which nodes fade.
    pub fade: u32,
}

impl Wanted {
    /// Nothing is simplified where the options do not ask for levels.
    pub fn of(options: &Options) -> Self {
        let Options { lod_error, lod_psnr, splats, .. } = *options;
        let words = |wide: u64| [wide as u32, (wide >> 32) as u32];
        let given = if lod_psnr > 0.0 { 0.0 } else { f64::from(lod_error) / 255.0 };
        let energy = 10_f64.powf(-f64::from(lod_psnr) / 10.0) * f64::from(ENERGY_UNITS).exp2();
        Self {
            given_squared: (given * given) as f32,
            searches: u32::from(lod_psnr > 0.0) << BY_ENERGY | u32::from(splats > 0) << BY_NODES,
            most_nodes: words(u64::from(splats) * NODE_UNITS as u64),
            most_energy: words(energy as u64),
            fade: fade_codes(options),
        }
    }
}

/// The part of the nodes of a page that is drawn within limits of codes, as the table of levels tells.
pub fn part(level: &PageLod, [own, parent]: [u16; 2]) -> f64 {
    (below(&level.errors, level.least_error, own) - below(&level.parent_errors, FINEST, parent)).max(0.0)
}

/// The part of the nodes whose error is at most `limit`; `largest`: of each eighth of them.
fn below(largest: &[u16; PARTS], least: u16, limit: u16) -> f64 {
    let whole = largest.partition_point(|code| *code <= limit);
    if whole == PARTS {
        return 1.0;
    }
    let from = f64::from(if whole == 0 { least } else { largest[whole - 1] });
    let inside = ((f64::from(limit) - from) / (f64::from(largest[whole]) - from).max(1.0)).clamp(0.0, 1.0);
    (whole as f64 + inside) / PARTS as f64
}
