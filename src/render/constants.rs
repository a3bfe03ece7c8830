//! The one map from options, scene layout and device to the specialization constants of all shaders.

use super::frame::footprint_code;
use super::layout::Layout;
use super::shaders::SharedConstants;
use crate::options::Options;
use crate::rules::Order;

/// The constants of pipelines whose subgroups have at most `subgroup` lanes. A shader takes those that it declares, and
/// its stage adds the constants of its own.
pub(super) fn shared(options: &Options, layout: &Layout, subgroup: u32) -> SharedConstants {
    let rules = &options.rules;
    SharedConstants {
        sh_degree: layout.sh_degree,
        sh_storage: layout.sh.code(),
        shape_storage: layout.shape.code(),
        has_clamped_alphas: layout.has_clamped_alphas,
        by_distance: rules.order == Order::Distance,
        antialiased: rules.antialiased,
        extent: footprint_code(rules.extent),
        alpha_min: rules.alpha_min,
        alpha_max: rules.alpha_max,
        transmittance_min: rules.transmittance_min,
        stop: layout.stop(options),
        compact: layout.is_compact(options),
        subgroup,
        ballot_words: subgroup.div_ceil(32),
    }
}
