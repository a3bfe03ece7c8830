//! Measurement of the cost of each changed knob in a view.

use anyhow::Result;

use crate::camera::Camera;
use crate::gpu::Device;
use crate::measure::bench::Protocol;
use crate::measure::trade::{Progress, Study};
use crate::options::{KNOBS, Options};
use crate::packing::Statistics;
use crate::rules::Background;
use crate::scene::Gaussians;

/// The costs of knobs in one view.
#[derive(Clone, Debug)]
pub struct KnobCosts {
    /// The options whose knobs were measured.
    pub options: Options,
    /// GPU time of the exact frame in milliseconds.
    pub exact_ms: f64,
    /// One entry per changed knob, alone; the last entry is for all together.
    pub knobs: Vec<KnobCost>,
}

/// The measured cost of one knob.
#[derive(Clone, Debug)]
pub struct KnobCost {
    pub knob: &'static str,
    /// GPU time of a frame in milliseconds.
    pub ms: f64,
    /// PSNR to the exact picture in dB; infinite if they are equal.
    pub psnr: f64,
}

/// The name of the last entry of [`KnobCosts::knobs`].
pub const ALL_KNOBS: &str = "all together";

const PROTOCOL: Protocol = Protocol { warmup: 4, frames: 24 };

/// `exact` with each knob set in which `options` differ, alone, then all together.
fn turned(exact: &Options, options: &Options) -> Vec<(&'static str, Options)> {
    let alone = KNOBS.iter().map(|knob| (knob.name, knob.turned(exact, (knob.get)(options))));
    alone.chain([(ALL_KNOBS, *options)]).filter(|(_, turned)| turned != exact).collect()
}

/// Measures every knob in which `options` differ from the exact options with the same rules.
pub fn costs(
    device: &Device,
    scene: (&Gaussians, &Statistics),
    options: &Options,
    view: &Camera,
    background: Background,
    progress: Progress,
) -> Result<KnobCosts> {
    let exact = Options { portable: false, ..options.untraded() };
    let study = Study::new(device, scene, (exact, background), [vec![view.clone()], Vec::new()], PROTOCOL, progress)?;
    let turned = turned(&exact, options);
    let count = turned.len() as f64 + 1.0;
    let cost = |(done, (knob, options)): (usize, (&'static str, Options))| {
        progress(done as f64 / count)?;
        let difference = study.from_exact(&options)?;
        let psnr = difference.psnr_db.unwrap_or(f64::INFINITY);
        Ok(KnobCost { knob, ms: study.gpu_ms(&options)?, psnr })
    };
    let knobs = turned.into_iter().enumerate().map(cost).collect::<Result<_>>()?;
    progress((count - 1.0) / count)?;
    Ok(KnobCosts { options: *options, exact_ms: study.gpu_ms(&exact)?, knobs })
}
