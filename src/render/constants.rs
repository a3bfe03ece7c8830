//! The one map from options, scene layout and device to the specialization constants of all shaders.

use super::frame::footprint_code;
use super::shaders::SharedConstants;
use super::shaders::shared::{STORED_F16, STORED_F32, STORED_U8};
use crate::lod::CODES_PER_OCTAVE;
use crate::options::{Options, Storage};
use crate::packing::{Layout, Packing};
use crate::rules::Order;

/// The constants of pipelines whose subgroups have at most `subgroup` lanes. A shader takes those that it declares, and
/// its stage adds the constants of its own.
pub(super) fn shared(options: &Options, layout: &Layout, subgroup: u32) -> SharedConstants {
    let rules = &options.rules;
    SharedConstants {
        sh_degree: layout.sh_degree,
        sh_storage: stored(layout.sh),
        shape_storage: stored(layout.shape),
        has_clamped_alphas: layout.has_clamped_alphas,
        by_distance: rules.order == Order::Distance,
        antialiased: rules.antialiased,
        extent: footprint_code(rules.extent),
        alpha_min: rules.alpha_min,
        alpha_max: rules.alpha_max,
        transmittance_min: rules.transmittance_min,
        stop: layout.stop(options),
        compact: layout.is_compact(options),
        has_levels: options.wants_levels(),
        fade: fade_codes(options),
        subgroup,
        ballot_words: subgroup.div_ceil(32),
    }
}

/// The width of the band in which nodes fade, as codes of errors.
pub(super) fn fade_codes(options: &Options) -> u32 {
    (f64::from(options.lod_fade) * CODES_PER_OCTAVE).round() as u32
}

/// The number that shaders know a number format by.
fn stored(packing: Packing) -> u32 {
    match packing.storage {
        Storage::Lossless | Storage::F32 => STORED_F32,
        Storage::F16 => STORED_F16,
        Storage::U8 => STORED_U8,
    }
}
