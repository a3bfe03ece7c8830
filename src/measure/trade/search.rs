//! Options with knobs turned: every knob alone, and a search over combinations. The search starts at the exact options
//! and repeatedly turns the knob that loses the least accuracy for the time that it saves.

use anyhow::Result;

use super::measure::Study;
use super::report::Point;
use crate::options::{Effect, Held, KNOBS, Knob, Options};
use crate::scene::Requirements;

/// The search ends when the PSNR to the exact pictures, in dB, would fall below this.
const WORST_DB: f64 = 36.0;
/// The least fraction of the frame time that a turn has to save. Repeated measurements of one build differ by as much.
const LEAST_GAIN: f64 = 0.008;

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

/// The options after each turn, with their time and errors. `progress` receives the completed fraction, estimated from
/// the remaining accuracy.
pub fn search(study: &Study, progress: &dyn Fn(f64)) -> Result<Vec<Point>> {
    let mut found = Vec::new();
    let mut now = study.exact;
    let (mut ms, mut error) = study.glance(&now)?;
    loop {
        let mut best: Option<(f64, String, Options, f64, f64)> = None;
        for (name, options) in turns(&now, study) {
            let (new_ms, new_error) = study.glance(&options)?;
            let saved = ms - new_ms;
            let is_good = saved > LEAST_GAIN * ms && decibels(new_error) >= WORST_DB;
            let price = (new_error - error).max(1e-12) / saved;
            if is_good && best.as_ref().is_none_or(|(least, ..)| price < *least) {
                best = Some((price, name, options, new_ms, new_error));
            }
        }
        let Some((_, name, options, new_ms, new_error)) = best else {
            return Ok(found);
        };
        (now, ms, error) = (options, new_ms, new_error);
        progress(((100.0 - decibels(error)) / (100.0 - WORST_DB)).clamp(0.0, 1.0));
        found.push(study.point(&format!("+ {name}"), &now)?);
    }
}

fn decibels(mse: f64) -> f64 {
    -10.0 * mse.log10()
}

/// `now` with each knob in turn moved to its next step that changes the picture.
fn turns(now: &Options, study: &Study) -> Vec<(String, Options)> {
    let held = held(&study.statistics.requirements);
    let searched = KNOBS.iter().filter(|knob| knob.is_searched);
    let turn = |knob: &Knob| {
        let current = (knob.get)(now);
        let mut coarser = knob.steps.iter().skip_while(|step| **step != current).skip(1);
        let next = coarser.find(|step| (knob.effect)(**step, &held) == Effect::Changed)?;
        Some((knob.title(*next), knob.turned(now, *next)))
    };
    searched.filter_map(turn).collect()
}

/// The properties of a scene on which the effects of knobs depend.
fn held(needs: &Requirements) -> Held {
    Held {
        sh_degree: needs.sh_degree,
        has_sh_bytes: needs.sh_grids.is_some(),
        has_shape_bytes: needs.scale_grid.is_some(),
    }
}
