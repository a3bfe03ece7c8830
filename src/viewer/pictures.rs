//! A scene on the GPU with what draws it, made on a thread beside the window.

use std::sync::Arc;

use anyhow::Result;

use crate::camera::Camera;
use crate::gpu::Device;
use crate::options::Options;
use crate::rules::Background;
use crate::render::{Frame, GpuScene, Inspection, Layout, Renderer};
use crate::scene::{Gaussians, Requirements, Transform};

/// What is to be drawn: scenes in their places, and how.
#[derive(Clone)]
pub struct Plan {
    pub parts: Vec<(Arc<Gaussians>, Transform)>,
    pub options: Options,
}

/// A scene on the GPU, and its picture.
pub struct Drawn {
    pub plan: Plan,
    /// The parts as one.
    pub gaussians: Arc<Gaussians>,
    pub needs: Arc<Requirements>,
    pub scene: GpuScene,
    pub still: Renderer,
    /// Tells it from the one that was here before.
    pub generation: u64,
    /// Of the first frame, which is complete.
    pub frame: Frame,
    pub inspection: Inspection,
}

impl Plan {
    pub fn is_same(&self, other: &Self) -> bool {
        self.options == other.options && self.has_scene_of(other)
    }

    /// Whether it draws the same Gaussians in the same places.
    pub fn has_scene_of(&self, other: &Self) -> bool {
        self.parts.len() == other.parts.len()
            && self.parts.iter().zip(&other.parts).all(|(a, b)| Arc::ptr_eq(&a.0, &b.0) && a.1 == b.1)
    }

    /// Puts it on the GPU and draws it once; takes over what `before` has of it already.
    pub fn build(
        self,
        device: &Device,
        before: Option<Kept>,
        view: &Camera,
        background: Background,
        generation: u64,
    ) -> Result<Drawn> {
        let before = before.filter(|before| before.plan.has_scene_of(&self));
        let (gaussians, needs) = match &before {
            Some(before) => (before.gaussians.clone(), before.needs.clone()),
            None => {
                let gaussians = self.joined()?;
                let needs = Arc::new(Requirements::of(&gaussians));
                (gaussians, needs)
            }
        };
        let layout = Layout::of(&gaussians, &needs, &self.options);
        let same_threshold = |before: &Kept| before.plan.options.rules.alpha_min == self.options.rules.alpha_min;
        let scene = match before.filter(|before| *before.scene.layout() == layout && same_threshold(before)) {
            Some(before) => before.scene,
            None => GpuScene::with(device, &gaussians, &needs, &self.options)?,
        };
        let mut still = Renderer::new(device, &self.options, &scene)?;
        let frame = still.render(view, background)?;
        let inspection = Inspection::default();
        Ok(Drawn { plan: self, gaussians, needs, scene, still, generation, frame, inspection })
    }

    /// The parts in their places, as one scene.
    pub fn joined(&self) -> Result<Arc<Gaussians>> {
        if let [(gaussians, transform)] = &self.parts[..]
            && *transform == Transform::IDENTITY
        {
            return Ok(gaussians.clone());
        }
        let placed = self.parts.iter().map(|(gaussians, transform)| gaussians.transformed(transform));
        let placed = placed.collect::<Result<Vec<_>>>()?;
        Ok(Arc::new(Gaussians::joined(placed.iter())?))
    }
}

/// What of a picture another may use.
pub struct Kept {
    plan: Plan,
    gaussians: Arc<Gaussians>,
    needs: Arc<Requirements>,
    scene: GpuScene,
}

impl Drawn {
    pub fn kept(&self) -> Kept {
        Kept {
            plan: self.plan.clone(),
            gaussians: self.gaussians.clone(),
            needs: self.needs.clone(),
            scene: self.scene.clone(),
        }
    }

    /// Device memory: every buffer's name and bytes.
    pub fn buffers(&self) -> Vec<(String, u64)> {
        let all = self.scene.buffers().into_iter().chain(self.still.buffers());
        all.map(|(name, bytes)| (name.to_owned(), bytes)).collect()
    }
}
