//! The fastest options whose error stays within a budget: by proof if there is one, else by measurement on the views.

use std::fmt;
use std::time::Duration;

use anyhow::Result;

use super::Progress;
use super::measure::{Study, worst_of};
use super::report::BudgetReport;
use crate::camera::Camera;
use crate::gpu::Device;
use crate::measure::bench::Protocol;
use crate::measure::metrics::Difference;
use crate::options::{Options, Storage};
use crate::packing::{Layout, Statistics};
use crate::rules::{Background, Rules};
use crate::scene::Gaussians;

/// Largest error of the pictures against the reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// Largest difference of a colour value.
    MaxError(f64),
    /// Least PSNR in dB.
    MinPsnr(f64),
}

/// The reason for a choice: a bound of the error, and where it comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum Grounds {
    /// Proven for every value of every picture of the scene, except for the rounding of 32-bit floats.
    Proven(f64),
    /// The worst of the measured views, times the margin.
    Measured(f64),
}

/// The options chosen for a budget.
#[derive(Clone, Debug)]
pub struct Choice {
    pub name: String,
    pub options: Options,
    /// GPU time of a frame with the chosen options, in milliseconds.
    pub gpu_ms: f64,
    /// GPU time of a frame with the exact options, in milliseconds.
    pub exact_gpu_ms: f64,
    /// Number of frames that were measured for each of these times.
    pub frames: usize,
    pub grounds: Grounds,
    /// Faster options and their errors, which exceed the budget.
    pub refused: Vec<(String, f64)>,
    budget: Budget,
}

/// No options stay within the budget.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Unmeetable(String);

/// Factor on measured errors, because other views may be worse than the measured ones.
const MARGIN: f64 = 1.5;
/// Error of a value that f32 rounding alone may cause, even if less was measured.
const ROUNDING: f64 = 1e-4;

impl Budget {
    /// A difference as an amplitude: the largest error, or for a PSNR the root mean square error.
    fn amplitude(self, difference: &Difference) -> f64 {
        match self {
            Self::MaxError(_) => difference.max_error.into(),
            Self::MinPsnr(_) => difference.mse.sqrt(),
        }
    }

    /// The largest amplitude within the budget.
    fn allowed(self) -> f64 {
        match self {
            Self::MaxError(error) => error,
            Self::MinPsnr(db) => 10_f64.powf(-db / 20.0),
        }
    }

    /// An amplitude in the unit of the budget.
    pub fn format(self, amplitude: f64) -> String {
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

/// Most views that are measured.
const VIEWS: usize = 8;
/// Number of views that the reference draws.
const ORACLE_VIEWS: usize = 3;
/// Longest side of the reference's pictures, in pixels.
const ORACLE_SIDE: u32 = 320;
const PROTOCOL: Protocol = Protocol { warmup: VIEWS, frames: 24 };
/// Time for the frames of a candidate.
const PATIENCE: Duration = Duration::from_millis(500);
/// Fraction of the work that is spent on reference pictures.
const ORACLE_FRACTION: f64 = 0.2;

/// Chooses options to draw `views` with. `exact` has the rules of the picture and every knob at its most exact step. If
/// frames are slow, fewer frames and views are measured.
///
/// # Errors
/// [`Unmeetable`] if not even the exact options stay within the budget.
pub fn choose_for(
    device: &Device,
    scene: (&Gaussians, &Statistics),
    (exact, background): (Options, Background),
    views: &[Camera],
    budget: Budget,
    progress: Progress,
) -> Result<Choice> {
    let views = spread(views, VIEWS);
    let small = spread(&views, ORACLE_VIEWS).iter().map(small).collect();
    let drawn = |done| progress(ORACLE_FRACTION * done);
    let study = Study::new(device, scene, (exact, background), [views, small], PROTOCOL, &drawn)?.within(PATIENCE)?;
    choose(&study, budget, &|done| progress(ORACLE_FRACTION + (1.0 - ORACLE_FRACTION) * done))
}

/// At most `count` elements, evenly spread.
pub fn spread<T: Clone>(all: &[T], count: usize) -> Vec<T> {
    let count = count.min(all.len());
    (0..count).map(|i| all[i * all.len() / count].clone()).collect()
}

/// The same view at a size that the reference draws in a reasonable time.
fn small(camera: &Camera) -> Camera {
    let [width, height] = camera.size_px;
    let least = (width.max(height) as f64 / f64::from(ORACLE_SIDE)).max(1.0);
    camera.sampled([width, height].map(|side| ((f64::from(side) / least).round() as u32).max(1)))
}

/// Chooses options for the scene and the views of a study.
///
/// # Errors
/// [`Unmeetable`] if not even the exact options stay within the budget.
pub fn choose(study: &Study, budget: Budget, progress: Progress) -> Result<Choice> {
    let floor = budget.amplitude(&study.from_oracle(&study.exact)?).max(match budget {
        Budget::MaxError(_) => ROUNDING,
        Budget::MinPsnr(_) => 0.0,
    });
    // The error of 32-bit floats adds to that of the options.
    let left = budget.allowed() - MARGIN * floor;
    if left.is_nan() || left < 0.0 {
        return Err(Unmeetable(format!(
            "{budget} cannot be met: 32-bit floats alone differ from the reference by {}, \
             {} with a margin for other views",
            budget.format(floor),
            budget.format(MARGIN * floor)
        ))
        .into());
    }
    let exact_gpu_ms = study.gpu_ms(&study.exact)?;
    let mut candidates = Vec::new();
    let all: Vec<_> = proven(study, left).into_iter().chain(measured(study, budget)).collect();
    let count = all.len() as f64;
    for (done, (name, options, proven)) in all.into_iter().enumerate() {
        progress(done as f64 / count)?;
        candidates.push((study.gpu_ms(&options)?, name, options, proven));
    }
    candidates.retain(|(ms, ..)| *ms < exact_gpu_ms);
    candidates.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut refused = Vec::new();
    for (gpu_ms, name, options, proven) in candidates {
        let error = match proven {
            Some(error) => error,
            None => (MARGIN * budget.amplitude(&study.from_exact(&options)?)).max(match budget {
                // Other views may show colours that the stop hides in these; the bound of its error covers them.
                Budget::MaxError(_) => f64::from(options.stop) * brightest(study),
                Budget::MinPsnr(_) => 0.0,
            }),
        };
        if error <= left {
            let grounds = proven.map_or(Grounds::Measured(error + MARGIN * floor), Grounds::Proven);
            let frames = study.protocol().frames;
            return Ok(Choice { name, options, gpu_ms, exact_gpu_ms, frames, grounds, refused, budget });
        }
        refused.push((name, error + MARGIN * floor));
    }
    Ok(Choice {
        name: "exact".to_owned(),
        options: study.exact,
        gpu_ms: exact_gpu_ms,
        exact_gpu_ms,
        frames: study.protocol().frames,
        grounds: Grounds::Measured(MARGIN * floor),
        refused,
        budget,
    })
}

/// Upper bound of the colours behind a splat: the brightest colour of the scene, or a background up to 1.
fn brightest(study: &Study) -> f64 {
    study.statistics.requirements.brightest.max(1.0)
}

/// Options that differ from the exact ones only in stop, SH degree and SH storage, with the error bounds that
/// docs/accuracy.md derives: a stop changes a value by at most `stop` times the brightest colour, a change of the
/// colours by at most itself.
fn proven(study: &Study, left: f64) -> Vec<(String, Options, Option<f64>)> {
    let brightest = brightest(study);
    let storages = if study.statistics.requirements.sh_grids.is_some() {
        vec![Storage::Lossless]
    } else {
        vec![Storage::Lossless, Storage::F16, Storage::U8]
    };
    let degrees = 0..=study.statistics.requirements.sh_degree;
    let kept = degrees.flat_map(|degree| storages.iter().map(move |storage| (degree, *storage)));
    let mut found = Vec::new();
    for (sh_degree, sh_storage) in kept {
        let options = Options { sh_degree, sh_storage, ..study.exact };
        let colours = Layout::of(study.statistics, &options).colour_error(study.gaussians);
        let stop = ((left - colours) / brightest).min(1.0 / 32.0) as f32;
        if stop > 0.0 {
            let stop = stop.next_down();
            let error = colours + f64::from(stop) * brightest;
            let name = format!("stop {stop:.5}, sh-degree {sh_degree}, sh-storage {sh_storage}");
            found.push((name, Options { stop, ..options }, Some(error)));
        }
    }
    found
}

/// The presets and some options between them, with the rules of the study. Shortened depth keys swap splats in few
/// pixels, whose error has no bound, so the largest error of one view says nothing about another: only a PSNR budget
/// allows them.
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
    /// The choice, the reason and the times in one sentence.
    pub fn explain(&self) -> String {
        let why = match &self.grounds {
            Grounds::Proven(error) => {
                format!("proven to change no value by more than {error:.2e}, except for f32 rounding")
            }
            Grounds::Measured(error) => format!("{} on these views, margin included", self.budget.format(*error)),
        };
        let next = self.refused.last().map_or_else(String::new, |(name, error)| {
            let error = self.budget.format(*error);
            match self.refused.len() {
                1 => format!("; one faster choice, {name}, exceeds it ({error})"),
                count => format!("; {count} faster choices exceed it, the slowest of them is {name} ({error})"),
            }
        });
        format!(
            "{}: {}, {why}; {:.2} ms per frame, {:.2} when exact (medians of {} frames){next}",
            self.budget, self.name, self.gpu_ms, self.exact_gpu_ms, self.frames
        )
    }

    /// Measures the choice on the views of `study`, which should be other views than those of the choice.
    pub fn verify(&self, study: &Study) -> Result<BudgetReport> {
        let each = study.each_from_oracle(&self.options)?;
        let within = each.iter().filter(|d| self.budget.amplitude(d) <= self.budget.allowed()).count();
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
            exceeded: each.len() - within,
        })
    }
}
