//! What each Gaussian contributes to a view: the largest part that it has of the light of a pixel.

use std::sync::Arc;

use anyhow::{Result, ensure};

use super::loaded_scene::Held;
use crate::camera::Camera;
use crate::gpu::Device;
use crate::options::Options;
use crate::packing::Statistics;
use crate::render::Pruner;
use crate::scene::{Gaussians, Transform};
use crate::viewer::frame::Plan;

/// A Gaussian with a smaller contribution changes no pixel by more than an 8-bit step.
pub const SEEN: f32 = 1.0 / 255.0;

/// A scene of a view.
pub struct Part {
    pub number: u64,
    pub whole: Arc<Gaussians>,
    /// The indices of those that are drawn.
    pub drawn: Vec<u32>,
    /// These Gaussians, and where they lie.
    pub placed: (Held, Transform),
}

/// The contributions of the Gaussians of several scenes to one view.
pub struct Shares {
    pub view: Camera,
    /// What contributes less is not selected.
    pub least: f32,
    parts: Vec<(u64, Arc<Gaussians>, Vec<f32>)>,
}

impl Shares {
    /// Draws the view without a stop on the GPU, and notes what each Gaussian contributes.
    ///
    /// # Errors
    /// If memory runs out or the device is lost.
    pub fn new(device: &Device, parts: Vec<Part>, options: &Options, view: Camera, least: f32) -> Result<Self> {
        let options = Options { stop: 0.0, ..options.untraded() };
        let placed = parts.iter().map(|part| part.placed.clone()).collect();
        let joined = Plan { parts: placed, options, shaders: None }.joined()?;
        let mut pruner = Pruner::new(device, &joined, &Statistics::of(&joined), &options)?;
        pruner.note(&view)?;
        let shares = pruner.shares()?;
        ensure!(shares.len() == parts.iter().map(|part| part.drawn.len()).sum::<usize>(), "each Gaussian has a share");
        let mut shares = shares.iter().map(|share| share.largest);
        let of_part = |Part { number, whole, drawn, .. }: Part| {
            let mut all = vec![0.0; whole.len()];
            for (index, share) in drawn.iter().zip(&mut shares) {
                all[*index as usize] = share;
            }
            (number, whole, all)
        };
        Ok(Self { view, least, parts: parts.into_iter().map(of_part).collect() })
    }

    /// By Gaussian of a scene; `None` if it was not a part of the view, or is another one by now.
    pub fn of(&self, number: u64, whole: &Arc<Gaussians>) -> Option<&[f32]> {
        let found = self.parts.iter().find(|(of, gaussians, _)| *of == number && Arc::ptr_eq(gaussians, whole));
        found.map(|(.., shares)| shares.as_slice())
    }
}
