//! The one map from options, scene layout and device to the specialization constants of all shaders.

use super::frame::footprint_code;
use super::shaders::shared::{STORED_F16, STORED_F32, STORED_U8};
use super::shaders::{SharedConstants, pages, shared};
use crate::lod::{CODES_PER_OCTAVE, LOWEST_EXPONENT};
use crate::options::{Options, Storage};
use crate::packing::{Layout, Packing, SH_PLANES};
use crate::pagefile::PAGE;
use crate::rules::Order;

// Numbers that modules below this one and shaders both have.
const _: () = assert!(PAGE == pages::PAGE as usize);
const _: () = assert!(SH_PLANES == shared::SH_PLANES as usize);
const _: () = assert!(CODES_PER_OCTAVE == shared::CODES_PER_OCTAVE as f64);
const _: () = assert!(LOWEST_EXPONENT == shared::CODE_LOWEST_EXPONENT as f64);

/// The constants of pipelines whose subgroups have at most `subgroup` lanes. A shader takes those that it declares, and
/// its stage adds the constants of its own.
pub(super) fn shared(options: &Options, layout: &Layout, subgroup: u32) -> SharedConstants {
    let rules = &options.rules;
    SharedConstants {
        sh_degree: layout.sh_degree,
        sh_storage: stored(layout.sh),
        shape_storage: stored(layout.shape),
        has_clamped_alphas: layout.has_clamped_alphas,
        flushes: false,
        by_distance: rules.order == Order::Distance,
        antialiased: rules.antialiased,
        features: rules.features,
        extent: footprint_code(rules.extent),
        alpha_min: rules.alpha_min,
        alpha_max: rules.alpha_max,
        transmittance_at_alpha_max: transmittance_at_alpha_max(rules.alpha_max),
        inverse_alpha_max: rules.alpha_max.recip(),
        transmittance_min: rules.transmittance_min,
        stop: layout.stop(options),
        compact: layout.is_compact(options),
        has_levels: options.wants_levels(),
        has_stop_keys: options.simplifies_hidden(),
        fade: fade_codes(options),
        subgroup,
        ballot_words: subgroup.div_ceil(32),
    }
}

/// True if pipelines with these options draw scenes of both layouts.
pub(super) fn are_drawn_alike(options: &Options, layouts: [&Layout; 2]) -> bool {
    let [a, b] = layouts.map(|layout| shared(options, layout, u32::BITS));
    a == b
}

/// The width of the band in which nodes fade, as codes of errors.
pub(super) fn fade_codes(options: &Options) -> u32 {
    (f64::from(options.lod_fade) * CODES_PER_OCTAVE).round() as u32
}

/// One less the largest alpha as the rules write it in decimals, rounded once.
fn transmittance_at_alpha_max(alpha_max: f32) -> f32 {
    let decimal = (f64::from(alpha_max) * 1e6).round() / 1e6;
    (1.0 - decimal) as f32
}

/// The number that shaders know a number format by.
pub(super) fn stored(packing: Packing) -> u32 {
    match packing.storage {
        Storage::Lossless | Storage::F32 => STORED_F32,
        Storage::F16 => STORED_F16,
        Storage::U8 => STORED_U8,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::Rules;

    #[test]
    fn the_transmittance_at_the_largest_alpha_is_the_nearest_float() {
        for (rules, expected) in [(Rules::TRAINED, 0.01), (Rules::GSPLAT, 0.001), (Rules::KHR, 0.0)] {
            assert_eq!(transmittance_at_alpha_max(rules.alpha_max).to_bits(), f32::to_bits(expected));
        }
    }
}
