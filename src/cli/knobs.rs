//! The knobs of quality and speed as arguments.

use clap::builder::PossibleValuesParser;

use super::Usage;
use crate::options::{Options, Storage};
use crate::rules::{Footprint, Order, Rules};

/// What overrides a preset.
#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = "Rules of the picture")]
pub(super) struct Knobs {
    /// Distance ahead of the camera, in world units, from which on Gaussians are drawn [default: the preset's, mostly
    /// 0.2; less where a small scene without cameras needs it]
    #[arg(long, value_name = "DISTANCE")]
    pub near: Option<f32>,
    /// What splats are sorted by [default: the preset's, mostly depth]
    #[arg(long, value_name = "BY")]
    order: Option<Order>,
    /// How far splats reach [default: the preset's, mostly exact]
    #[arg(long, value_name = "RULE")]
    extent: Option<Footprint>,
    /// Skip contributions below this alpha [default: the preset's, 1/255 when exact]
    #[arg(long, value_name = "ALPHA")]
    alpha_min: Option<f32>,
    /// Make up for the low-pass in the opacities (Mip-Splatting) [default: if the scene was trained so]
    #[arg(long, value_name = "YES", value_parser = clap::value_parser!(bool))]
    pub antialiased: Option<bool>,
    /// Finish a pixel once its transmittance is below this; no colour moves by more than this part of the brightest
    #[arg(long, value_name = "T", help_heading = TRADES)]
    stop: Option<f32>,
    /// Bits of a depth key, at most as many as the scene is deep
    #[arg(long, value_name = "8..32", value_parser = clap::value_parser!(u32).range(8..=32), help_heading = TRADES)]
    key_bits: Option<u32>,
    /// Leave out spherical harmonics above this degree
    #[arg(long, value_name = "0..3", value_parser = clap::value_parser!(u32).range(0..=3), help_heading = TRADES)]
    sh_degree: Option<u32>,
    /// How the GPU keeps spherical harmonics
    #[arg(long, value_name = "BITS", help_heading = TRADES)]
    sh_storage: Option<Storage>,
    /// How the GPU keeps rotations, scales and opacities
    #[arg(long, value_name = "BITS", help_heading = TRADES)]
    shape_storage: Option<Storage>,
    /// Draw at this part of the width and height, and enlarge
    #[arg(long, value_name = "0..1", help_heading = TRADES)]
    scale: Option<f32>,
}

const TRADES: &str = "Accuracy for speed (defaults are the preset's)";

impl Knobs {
    /// `preset` with what these arguments change, for a scene that was trained with or without antialiasing and needs a
    /// near plane no farther than `nearest`.
    pub fn options(&self, preset: &Options, antialiased: bool, nearest: f32) -> Options {
        let rules = &preset.rules;
        Options {
            rules: Rules {
                near: self.near.unwrap_or(rules.near.min(nearest)),
                order: self.order.unwrap_or(rules.order),
                extent: self.extent.unwrap_or(rules.extent),
                alpha_min: self.alpha_min.unwrap_or(rules.alpha_min),
                antialiased: self.antialiased.unwrap_or(antialiased),
                ..*rules
            },
            stop: self.stop.unwrap_or(preset.stop),
            key_bits: self.key_bits.unwrap_or(preset.key_bits),
            sh_degree: self.sh_degree.unwrap_or(preset.sh_degree),
            sh_storage: self.sh_storage.unwrap_or(preset.sh_storage),
            shape_storage: self.shape_storage.unwrap_or(preset.shape_storage),
            scale: self.scale.unwrap_or(preset.scale),
            portable: preset.portable,
        }
    }

    /// Fails if a number makes no sense.
    pub fn check(&self) -> Result<(), Usage> {
        let within = |name: &str, value: Option<f32>, low: f32, high: f32, what: &str| match value {
            Some(value) if !(value > low && value <= high) => Err(Usage(format!("--{name} {value} is not {what}"))),
            _ => Ok(()),
        };
        within("near", self.near, 0.0, f32::MAX, "a distance ahead of the camera")?;
        within("alpha-min", self.alpha_min, 0.0, 1.0, "an alpha over 0, at most 1")?;
        within("scale", self.scale, 0.0, 1.0, "a part of a side, over 0 and at most 1")?;
        within("stop", self.stop, 0.0_f32.next_down(), 1.0, "a transmittance from 0 to 1")
    }

    /// Whether accuracy is given up for speed by hand.
    pub fn trades(&self) -> bool {
        let Self { stop, key_bits, sh_degree, sh_storage, shape_storage, scale, .. } = self;
        let numbers = stop.is_some() || scale.is_some() || key_bits.is_some() || sh_degree.is_some();
        numbers || sh_storage.is_some() || shape_storage.is_some()
    }

    /// Whether the picture is drawn by other rules than the preset's, but for the near plane.
    pub fn rules(&self) -> bool {
        self.order.is_some() || self.extent.is_some() || self.alpha_min.is_some() || self.antialiased.is_some()
    }

    /// Fails if the GPU cannot draw by these rules.
    pub fn check_gpu(&self) -> Result<(), Usage> {
        match self.order {
            Some(Order::PerPixel) => Err(Usage("--order per-pixel is drawn by --reference alone".to_owned())),
            _ => Ok(()),
        }
    }
}

/// The names of the presets.
pub(super) fn preset_names() -> PossibleValuesParser {
    PossibleValuesParser::new(Options::PRESETS.map(|(name, _)| name))
}
