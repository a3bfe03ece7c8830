//! The cheapest options whose error stays within a budget: proven where there is a proof, else measured on the views.

use std::fmt;

use anyhow::Result;

use super::measure::{Study, worst_of};
use super::report::BudgetReport;
use crate::measure::bench::Protocol;
use crate::camera::Camera;
use crate::gpu::Device;
use crate::measure::metrics::Difference;
use crate::options::{Options, Storage};
use crate::rules::{Background, Rules};
use crate::render::Layout;
use crate::scene::{Gaussians, Requirements};

/// How far pictures may be from the reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// Largest difference of a colour value.
    MaxError(f64),
    /// Least PSNR in dB.
    MinPsnr(f64),
}

/// What speaks for a choice.
#[derive(Clone, Debug, PartialEq)]
pub enum Grounds {
    /// No value of any picture of the scene differs by more, besides what 32-bit floats make of it.
    Proven(f64),
    /// The worst of the views that were asked, with the margin.
    Measured(f64),
}

/// What was chosen.
#[derive(Clone, Debug)]
pub struct Choice {
    pub name: String,
    pub options: Options,
    pub gpu_ms: f64,
    /// Of the exact options.
    pub exact_gpu_ms: f64,
    pub grounds: Grounds,
    /// Cheaper options and how far they are.
    pub refused: Vec<(String, f64)>,
    budget: Budget,
}

/// No options keep the budget.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Unmeetable(String);

/// Other views may be worse than those that were asked: an error that is measured counts so many times.
const MARGIN: f64 = 1.5;
/// What f32 rounding alone may do to a value, whatever was measured.
const ROUNDING: f64 = 1e-4;

impl Budget {
    /// A difference in the measure of this budget, as an amplitude: the largest error, or the root mean square.
    fn amplitude(self, difference: &Difference) -> f64 {
        match self {
            Self::MaxError(_) => difference.max_error.into(),
            Self::MinPsnr(_) => difference.mse.sqrt(),
        }
    }

    /// The amplitude that is allowed.
    fn allowed(self) -> f64 {
        match self {
            Self::MaxError(error) => error,
            Self::MinPsnr(db) => 10_f64.powf(-db / 20.0),
        }
    }

    /// An amplitude as users say it.
    pub fn say(self, amplitude: f64) -> String {
        match self {
            Self::MaxError(_) => format!("an error of {amplitude:.2e}"),
            Self::MinPsnr(_) => format!("{:.1} dB", -20.0 * amplitude.log10()),
        }
    }
}

impl fmt::Display for Budget {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::MaxError(error) => write!(f, "--max-error {error}"),
            Self::MinPsnr(db) => write!(f, "--min-psnr {db}"),
        }
    }
}

/// Views that are asked, and those of them that the reference draws, this wide at most.
const VIEWS: usize = 8;
const ORACLE_VIEWS: usize = 3;
const ORACLE_WIDTH: u32 = 320;
const PROTOCOL: Protocol = Protocol { warmup: VIEWS, frames: 24 };

/// Chooses what to draw `views` with; `exact` has the rules, and no knob turned. `progress` is told the fraction done of
/// what the reference draws.
pub fn choose_for(
    device: &Device,
    scene: (&Gaussians, &Requirements),
    (exact, background): (Options, Background),
    views: &[Camera],
    budget: Budget,
    progress: &dyn Fn(f64),
) -> Result<Choice> {
    let views = spread(views, VIEWS);
    let small = spread(&views, ORACLE_VIEWS).iter().map(small).collect();
    choose(&Study::new(device, scene, (exact, background), [views, small], PROTOCOL, progress)?, budget)
}

/// At most `count` of these, evenly.
pub fn spread<T: Clone>(all: &[T], count: usize) -> Vec<T> {
    let count = count.min(all.len());
    (0..count).map(|i| all[i * all.len() / count].clone()).collect()
}

/// The same view, small enough for the reference.
fn small(camera: &Camera) -> Camera {
    let [width, height] = camera.size_px;
    let least = (width.max(height) as f64 / f64::from(ORACLE_WIDTH)).max(1.0);
    camera.sampled([width, height].map(|side| ((f64::from(side) / least).round() as u32).max(1)))
}

/// Chooses for the scene and the views of a study.
///
/// # Errors
/// [`Unmeetable`] if not even the exact options keep the budget.
pub fn choose(study: &Study, budget: Budget) -> Result<Choice> {
    let floor = budget.amplitude(&study.from_oracle(&study.exact)?).max(match budget {
        Budget::MaxError(_) => ROUNDING,
        Budget::MinPsnr(_) => 0.0,
    });
    // What 32-bit floats do adds to what the options do.
    let left = budget.allowed() - MARGIN * floor;
    if left.is_nan() || left < 0.0 {
        return Err(Unmeetable(format!(
            "{budget} is closer than 32-bit floats are to the reference: {} here, {} with a margin for other views",
            budget.say(floor),
            budget.say(MARGIN * floor)
        ))
        .into());
    }
    let exact_gpu_ms = study.gpu_ms(&study.exact)?;
    let mut candidates = Vec::new();
    for (name, options, proven) in proven(study, left).into_iter().chain(measured(study, budget)) {
        candidates.push((study.gpu_ms(&options)?, name, options, proven));
    }
    candidates.retain(|(ms, ..)| *ms < exact_gpu_ms);
    candidates.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut refused = Vec::new();
    for (gpu_ms, name, options, proven) in candidates {
        let error = match proven {
            Some(error) => error,
            None => (MARGIN * budget.amplitude(&study.from_exact(&options)?)).max(match budget {
                // Other views may have what a stop hides, and it has a bound.
                Budget::MaxError(_) => f64::from(options.stop) * brightest(study),
                Budget::MinPsnr(_) => 0.0,
            }),
        };
        if error <= left {
            let grounds = proven.map_or(Grounds::Measured(error + MARGIN * floor), Grounds::Proven);
            return Ok(Choice { name, options, gpu_ms, exact_gpu_ms, grounds, refused, budget });
        }
        refused.push((name, error + MARGIN * floor));
    }
    Ok(Choice {
        name: "exact".to_owned(),
        options: study.exact,
        gpu_ms: exact_gpu_ms,
        exact_gpu_ms,
        grounds: Grounds::Measured(MARGIN * floor),
        refused,
        budget,
    })
}

/// Above any colour that can be behind a splat: the scene's, or a background up to 1.
fn brightest(study: &Study) -> f64 {
    study.needs.brightest.max(1.0)
}

/// Options that differ from the exact ones in stop, degree and storage of the spherical harmonics alone, with the bounds
/// that docs/accuracy.md derives: a stop moves a value by its part of the brightest colour, a change of the colours by
/// itself.
fn proven(study: &Study, left: f64) -> Vec<(String, Options, Option<f64>)> {
    let brightest = brightest(study);
    let storages = if study.needs.sh_grids.is_some() {
        vec![Storage::Lossless]
    } else {
        vec![Storage::Lossless, Storage::F16, Storage::U8]
    };
    let degrees = 0..=study.needs.sh_degree;
    let kept = degrees.flat_map(|degree| storages.iter().map(move |storage| (degree, *storage)));
    let mut found = Vec::new();
    for (sh_degree, sh_storage) in kept {
        let options = Options { sh_degree, sh_storage, ..study.exact };
        let colours = Layout::of(study.gaussians, study.needs, &options).colour_error(study.gaussians);
        let stop = ((left - colours) / brightest).min(1.0 / 32.0) as f32;
        if stop > 0.0 {
            let stop = stop.next_down();
            let error = colours + f64::from(stop) * brightest;
            let name = format!("stop {stop:.5}, SH degree {sh_degree} {sh_storage:?}");
            found.push((name, Options { stop, ..options }, Some(error)));
        }
    }
    found
}

/// The presets and what lies between them, by the rules of the study. Splats that cut keys swap are in few pixels, but move
/// those by anything: no view tells the largest error of another.
fn measured(study: &Study, budget: Budget) -> Vec<(String, Options, Option<f64>)> {
    let swaps = matches!(budget, Budget::MinPsnr(_));
    let by_rules = |preset: &Options, alpha_min: f32| {
        let rules = Rules { alpha_min: alpha_min.max(study.rules().alpha_min), ..*study.rules() };
        let key_bits = if swaps { preset.key_bits } else { study.exact.key_bits };
        Options { rules, key_bits, portable: study.exact.portable, ..*preset }
    };
    let mut all = Vec::new();
    for (name, preset) in [("preview", Options::PREVIEW), ("fast", Options::FAST), ("balanced", Options::BALANCED)] {
        all.push((name.to_owned(), by_rules(&preset, preset.rules.alpha_min), None));
        for alpha in [1.0 / 224.0, 1.0 / 192.0, 1.0 / 160.0, 1.0 / 96.0] {
            let options = by_rules(&preset, alpha);
            all.push((format!("{name}, alpha-min 1/{:.0}", 1.0 / alpha), options, None));
        }
    }
    let stopped = Options { stop: 1.0 / 255.0, ..study.exact };
    all.push(("stop 1/255".to_owned(), stopped, None));
    if swaps {
        all.push(("key-bits 24".to_owned(), Options { key_bits: 24, ..study.exact }, None));
    }
    all
}

impl Choice {
    /// Which, why, and by how much, in a sentence.
    pub fn explain(&self) -> String {
        let why = match &self.grounds {
            Grounds::Proven(error) => {
                format!("proven to change no value by more than {error:.2e}, besides what 32-bit floats do")
            }
            Grounds::Measured(error) => format!("{} on these views, margin included", self.budget.say(*error)),
        };
        let next = self.refused.last().map_or_else(String::new, |(name, error)| {
            format!("; {} cheaper are not, the next is {name} with {}", self.refused.len(), self.budget.say(*error))
        });
        format!(
            "{}: {}, {why}; {:.2} ms a frame, {:.2} when exact{next}",
            self.budget, self.name, self.gpu_ms, self.exact_gpu_ms
        )
    }

    /// Holds the choice against views that were not asked: those of `study`, which has others than the one it was made
    /// with.
    pub fn hold(&self, study: &Study) -> Result<BudgetReport> {
        let each = study.each_from_oracle(&self.options)?;
        let kept = each.iter().filter(|d| self.budget.amplitude(d) <= self.budget.allowed()).count();
        Ok(BudgetReport {
            budget: self.budget.to_string(),
            choice: self.name.clone(),
            options: self.options,
            is_proven: matches!(self.grounds, Grounds::Proven(_)),
            gpu_ms: self.gpu_ms,
            exact_gpu_ms: self.exact_gpu_ms,
            held_out_views: each.len(),
            from_oracle: worst_of(&each),
            from_exact: study.from_exact(&self.options)?,
            exceeded: each.len() - kept,
        })
    }
}
