//! Contributions of Gaussians to a view: the largest alpha times transmittance of each at a pixel.

use std::sync::Arc;

use anyhow::{Result, ensure};

use super::loaded_scene::LoadedScene;
use super::plan::Plan;
use crate::camera::Camera;
use crate::gpu::Device;
use crate::options::Options;
use crate::packing::Statistics;
use crate::render::Pruner;
use crate::scene::{Gaussians, Transform};

/// Least contribution of a Gaussian that counts as visible: a smaller one changes no pixel by more than an 8-bit step.
pub const MIN_VISIBLE: f32 = 1.0 / 255.0;

/// A layer as the view draws it.
pub struct DrawnScene {
    pub number: u64,
    pub whole: Arc<Gaussians>,
    /// The indices of the drawn Gaussians.
    pub drawn: Vec<u32>,
    /// The drawn Gaussians with their transform.
    pub placed: (LoadedScene, Transform),
}

/// The contributions of the Gaussians of several scenes to one view.
pub struct Contributions {
    pub view: Camera,
    /// Gaussians with a smaller contribution are not selected.
    pub min: f32,
    /// Layer number, its Gaussians, and the contribution of each.
    layers: Vec<(u64, Arc<Gaussians>, Vec<f32>)>,
}

impl Contributions {
    /// Draws the view on the GPU without early termination, and records the contribution of each Gaussian.
    ///
    /// # Errors
    /// Memory runs out, or the device is lost.
    pub fn new(device: &Device, scenes: Vec<DrawnScene>, options: &Options, view: Camera, min: f32) -> Result<Self> {
        let options = Options { stop: 0.0, ..options.untraded() };
        let placed = scenes.iter().map(|scene| scene.placed.clone()).collect();
        let joined = Plan { scenes: placed, options, shaders: None }.joined()?;
        let mut pruner = Pruner::new(device, &joined, &Statistics::of(&joined), &options)?;
        pruner.note(&view)?;
        let shares = pruner.shares()?;
        ensure!(
            shares.len() == scenes.iter().map(|scene| scene.drawn.len()).sum::<usize>(),
            "each Gaussian has a share"
        );
        let mut shares = shares.iter().map(|share| share.largest);
        let of_scene = |DrawnScene { number, whole, drawn, .. }: DrawnScene| {
            let mut all = vec![0.0; whole.len()];
            for (index, share) in drawn.iter().zip(&mut shares) {
                all[*index as usize] = share;
            }
            (number, whole, all)
        };
        Ok(Self { view, min, layers: scenes.into_iter().map(of_scene).collect() })
    }

    /// Contributions by Gaussian of a layer; `None` if the view did not draw the layer, or its scene was read again.
    pub fn of(&self, number: u64, whole: &Arc<Gaussians>) -> Option<&[f32]> {
        let found = self.layers.iter().find(|(of, gaussians, _)| *of == number && Arc::ptr_eq(gaussians, whole));
        found.map(|(.., contributions)| contributions.as_slice())
    }
}
