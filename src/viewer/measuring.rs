//! What the knobs cost in the current view: measured on demand, each alone against none.

use anyhow::Result;

use crate::measure::bench::Protocol;
use crate::camera::Camera;
use crate::gpu::Device;
use crate::options::Options;
use crate::rules::{Background, Rules};
use crate::scene::{Gaussians, Requirements};
use crate::measure::trade::Study;

/// What turning knobs costs in one view.
#[derive(Clone, Debug)]
pub struct Costs {
    /// GPU time of a frame in milliseconds with no knob turned.
    pub exact_ms: f64,
    /// Every knob that is turned, alone, then all together.
    pub knobs: Vec<Cost>,
}

#[derive(Clone, Debug)]
pub struct Cost {
    pub knob: &'static str,
    /// GPU time of a frame in milliseconds.
    pub ms: f64,
    /// To the exact picture, in dB; infinite where they are equal.
    pub psnr: f64,
}

/// As the last of [`Costs::knobs`] is called.
pub const ALL: &str = "all together";

const PROTOCOL: Protocol = Protocol { warmup: 4, frames: 24 };

/// Each knob in which the options differ, alone.
fn turned(exact: &Options, options: &Options) -> Vec<(&'static str, Options)> {
    let rules = |rules: Rules| Options { rules, ..*exact };
    let (from, to) = (&exact.rules, &options.rules);
    let all = [
        ("alpha-min", rules(Rules { alpha_min: to.alpha_min, ..*from })),
        ("stop", Options { stop: options.stop, ..*exact }),
        ("key-bits", Options { key_bits: options.key_bits, ..*exact }),
        ("sh-degree", Options { sh_degree: options.sh_degree, ..*exact }),
        ("sh-storage", Options { sh_storage: options.sh_storage, ..*exact }),
        ("shape-storage", Options { shape_storage: options.shape_storage, ..*exact }),
        ("scale", Options { scale: options.scale, ..*exact }),
        ("portable", Options { portable: options.portable, ..*exact }),
        (ALL, *options),
    ];
    all.into_iter().filter(|(_, turned)| turned != exact).collect()
}

/// Measures every knob that `options` turn.
pub fn costs(
    device: &Device,
    scene: (&Gaussians, &Requirements),
    options: &Options,
    view: &Camera,
    background: Background,
) -> Result<Costs> {
    let exact = Options { portable: false, ..options.untraded() };
    let study = Study::new(device, scene, (exact, background), [vec![view.clone()], Vec::new()], PROTOCOL, &|_| {})?;
    let cost = |(knob, options): (&'static str, Options)| {
        let difference = study.from_exact(&options)?;
        let psnr = difference.psnr_db.unwrap_or(f64::INFINITY);
        Ok(Cost { knob, ms: study.gpu_ms(&options)?, psnr })
    };
    let knobs = turned(&exact, options).into_iter().map(cost).collect::<Result<_>>()?;
    Ok(Costs { exact_ms: study.gpu_ms(&exact)?, knobs })
}
