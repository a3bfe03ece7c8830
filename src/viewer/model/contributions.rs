//! Contributions of Gaussians to a view: the largest alpha times transmittance of each at a pixel.

use anyhow::Result;

use super::comparison::PictureContent;
use crate::gpu::{Buffer, Commands, Device};
use crate::options::Options;
use crate::render::{GpuScene, Pruner};

/// Least contribution of a Gaussian that counts as visible: a smaller one changes no pixel by more than an 8-bit step.
pub const MIN_VISIBLE: f32 = 1.0 / 255.0;

/// The contributions of the Gaussians of a picture.
pub struct Contributions {
    /// The picture.
    pub content: PictureContent,
    /// The alpha below which the scene on the device is culled.
    pub alpha_min: f32,
    /// By Gaussian of the joined scenes; 0 for those that are not drawn.
    pub all: Vec<f32>,
    /// The same, on the device.
    pub on_device: Buffer<f32>,
}

impl Contributions {
    /// Draws the view on the GPU without early termination, and records the contribution of each Gaussian. `options`
    /// are those that the scene was uploaded for.
    ///
    /// # Errors
    /// Memory runs out, or the device is lost.
    pub fn new(device: &Device, scene: &GpuScene, options: &Options, content: PictureContent) -> Result<Self> {
        // Gaussians that the scene on the device culls contribute nothing.
        let options = Options { rules: options.rules, stop: 0.0, ..options.untraded() };
        let mut pruner = Pruner::of(device, scene, &options)?;
        pruner.note(&content.view)?;
        let all: Vec<f32> = pruner.shares()?.iter().map(|share| share.largest).collect();
        let on_device = Buffer::new(device, "contributions", all.len())?;
        let mut cmd = Commands::new(device)?;
        cmd.upload(&on_device, 0, all.len(), |memory| memory.copy_from_slice(&all))?;
        cmd.submit()?.wait()?;
        Ok(Self { content, alpha_min: options.rules.alpha_min, all, on_device })
    }
}
