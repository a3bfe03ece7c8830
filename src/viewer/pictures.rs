//! A scene on the GPU with its renderer, built by a job while the window goes on.

use std::sync::Arc;
use std::time::SystemTime;

use anyhow::Result;

use crate::camera::Camera;
use crate::gpu::Device;
use crate::options::Options;
use crate::render::{Frame, GpuScene, Inspection, Path, Renderer, SceneSource};
use crate::rules::Background;
use crate::scene::{Gaussians, Transform};
use crate::storage::{Layout, Statistics};

/// One of the two pictures that a window can show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    First,
    Second,
}

/// A picture to draw: scenes with their transforms, the options, and the version of the shaders.
#[derive(Clone)]
pub struct Plan {
    pub parts: Vec<(Arc<Gaussians>, Transform)>,
    pub options: Options,
    /// The newest change of shaders that are compiled at run time.
    pub shaders: Option<SystemTime>,
}

/// A scene on the GPU, and its picture.
pub struct Drawn {
    pub plan: Plan,
    /// The parts joined, in world space.
    pub gaussians: Arc<Gaussians>,
    pub statistics: Arc<Statistics>,
    pub scene: GpuScene,
    pub renderer: Renderer,
    /// Number of the build; tells this picture from one that it replaced.
    pub generation: u64,
    /// The first frame, which is complete; its totals are updated by later frames.
    pub frame: Frame,
    /// The path that drew the frame of these totals.
    pub path: Path,
    pub inspection: Inspection,
}

impl Plan {
    pub fn is_same(&self, other: &Self) -> bool {
        self.options == other.options && self.shaders == other.shaders && self.has_scene_of(other)
    }

    /// True if both plans draw the same Gaussians with the same transforms.
    pub fn has_scene_of(&self, other: &Self) -> bool {
        self.parts.len() == other.parts.len()
            && self.parts.iter().zip(&other.parts).all(|(a, b)| Arc::ptr_eq(&a.0, &b.0) && a.1 == b.1)
    }

    /// Uploads the scene and draws it once. Takes over from `reusable` what is the same.
    pub fn build(
        self,
        device: &Device,
        reusable: Option<Reusable>,
        view: &Camera,
        background: Background,
        generation: u64,
    ) -> Result<Drawn> {
        let reusable = reusable.filter(|old| old.plan.has_scene_of(&self));
        let (gaussians, statistics) = match &reusable {
            Some(old) => (old.gaussians.clone(), old.statistics.clone()),
            None => {
                let gaussians = self.joined()?;
                let statistics = Arc::new(Statistics::of(&gaussians));
                (gaussians, statistics)
            }
        };
        let layout = Layout::of(&statistics, &self.options);
        let same_threshold = |old: &Reusable| old.plan.options.rules.alpha_min == self.options.rules.alpha_min;
        let scene = match reusable.filter(|old| *old.scene.layout() == layout && same_threshold(old)) {
            Some(old) => old.scene,
            None => {
                let source = SceneSource::shared(gaussians.clone(), statistics.clone());
                let pixels: u64 = view.size_px.iter().map(|side| u64::from(*side)).product();
                source.bring(device, &self.options, false, BYTES_PER_PIXEL * pixels)?
            }
        };
        let mut renderer = Renderer::new(device, &self.options, &scene)?;
        let frame = renderer.render(view, background)?;
        let path = renderer.path();
        // Where the window looks into the picture, it does not wait for pipelines.
        renderer.prepare_portable()?;
        let inspection = Inspection::default();
        Ok(Drawn { plan: self, gaussians, statistics, scene, renderer, generation, frame, path, inspection })
    }

    /// The parts, transformed, as one scene.
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

/// The parts of a picture that the build of another picture may take over.
pub struct Reusable {
    plan: Plan,
    gaussians: Arc<Gaussians>,
    statistics: Arc<Statistics>,
    scene: GpuScene,
}

/// Device memory for pictures and panels, per pixel of the window.
const BYTES_PER_PIXEL: u64 = 64;

impl Drawn {
    pub fn reusable(&self) -> Reusable {
        Reusable {
            plan: self.plan.clone(),
            gaussians: self.gaussians.clone(),
            statistics: self.statistics.clone(),
            scene: self.scene.clone(),
        }
    }

    /// Device memory: name and bytes of every buffer.
    pub fn buffers(&self) -> Vec<(String, u64)> {
        let all = self.scene.buffers().into_iter().chain(self.renderer.buffers());
        all.map(|(name, bytes)| (name.to_owned(), bytes)).collect()
    }
}
