//! A search over combinations of knobs: from the exact options down, always the turn that costs the least accuracy for the
//! time it saves.

use anyhow::Result;

use super::candidates::{ALPHAS, KEY_BITS, SCALES, STOPS, STORAGES};
use super::measure::Study;
use super::report::Point;
use crate::options::{Options, Storage};
use crate::rules::Rules;

/// The search ends where pictures are farther than this from the exact ones, in dB.
const WORST_DB: f64 = 36.0;
/// The least part of a frame's time that a turn has to save: what measurements of one build differ by.
const LEAST_GAIN: f64 = 0.008;

/// The options on the way, each with its time and errors. `progress` is told a fraction done, by the accuracy left.
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

/// Each knob turned one step on.
fn turns(now: &Options, study: &Study) -> Vec<(String, Options)> {
    let mut all = Vec::new();
    let rules = now.rules;
    if let Some(stop) = next(&STOPS, &now.stop) {
        all.push((format!("stop {stop:.4}"), Options { stop, ..*now }));
    }
    if let Some(alpha_min) = next(&ALPHAS, &rules.alpha_min) {
        all.push((format!("alpha-min {alpha_min:.4}"), Options { rules: Rules { alpha_min, ..rules }, ..*now }));
    }
    if let Some(key_bits) = next(&KEY_BITS, &now.key_bits) {
        all.push((format!("key-bits {key_bits}"), Options { key_bits, ..*now }));
    }
    if let Some(scale) = next(&SCALES, &now.scale) {
        all.push((format!("scale {scale}"), Options { scale, ..*now }));
    }
    if now.sh_degree.min(study.needs.sh_degree) > 0 {
        let sh_degree = now.sh_degree.min(study.needs.sh_degree) - 1;
        all.push((format!("sh-degree {sh_degree}"), Options { sh_degree, ..*now }));
    }
    if let Some(sh_storage) = coarser(now.sh_storage, study.needs.sh_grids.is_some()) {
        all.push((format!("sh-storage {sh_storage:?}"), Options { sh_storage, ..*now }));
    }
    if let Some(shape_storage) = coarser(now.shape_storage, study.needs.scale_grid.is_some()) {
        all.push((format!("shape-storage {shape_storage:?}"), Options { shape_storage, ..*now }));
    }
    all
}

fn next<T: PartialEq + Copy>(steps: &[T], now: &T) -> Option<T> {
    let place = steps.iter().position(|step| step == now)?;
    steps.get(place + 1).copied()
}

/// Where the file held bytes, nothing is left to gain.
fn coarser(now: Storage, is_on_grid: bool) -> Option<Storage> {
    if is_on_grid { None } else { next(&STORAGES, &now) }
}
