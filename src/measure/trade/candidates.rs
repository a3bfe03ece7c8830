//! The exact options with one knob turned.

use crate::options::{Effect, Held, KNOBS, Options};
use crate::scene::Requirements;

/// Every step of every knob that has an effect on the scene, alone: its title, and `base` with this knob turned. `base`
/// has the rules of the scene, and no other knob turned.
pub fn knobs(base: &Options, needs: &Requirements) -> Vec<(String, Options)> {
    let held = held(needs);
    let mut all = Vec::new();
    for knob in &KNOBS {
        let has_effect = |value| value != (knob.get)(base) && (knob.effect)(value, &held) != Effect::None;
        let steps = knob.steps.iter().copied().filter(|value| has_effect(*value));
        all.extend(steps.map(|value| (knob.title(value), knob.turned(base, value))));
    }
    all
}

/// The properties of a scene on which the effects of knobs depend.
pub(super) fn held(needs: &Requirements) -> Held {
    Held {
        sh_degree: needs.sh_degree,
        has_sh_bytes: needs.sh_grids.is_some(),
        has_shape_bytes: needs.scale_grid.is_some(),
    }
}
