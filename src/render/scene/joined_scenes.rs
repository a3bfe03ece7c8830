//! Several scenes that are drawn together from one page cache: page files and Gaussians in memory.

use std::sync::Arc;

use anyhow::{Result, ensure};

use super::gpu_scene::GpuScene;
use super::scene_source::{NoLevels, Upload};
use crate::gpu::Device;
use crate::options::Options;
use crate::packing::Statistics;
use crate::pagefile::{PagedScene, Pages};
use crate::scene::SceneInstances;

/// Several scenes, each at its own instances. A clone shares them.
#[derive(Clone)]
pub struct JoinedScenes {
    scenes: Arc<[(PagedScene, SceneInstances)]>,
    /// The statistics of all of them.
    pub statistics: Arc<Statistics>,
}

impl JoinedScenes {
    /// # Errors
    /// If there is no Gaussian in them.
    pub fn new(mut scenes: Vec<(PagedScene, SceneInstances)>) -> Result<Self> {
        // Pages of a scene without Gaussians have no bounds.
        scenes.retain(|(scene, _)| scene.statistics().count > 0);
        ensure!(!scenes.is_empty(), "no Gaussian is left: all are deleted or hidden");
        let statistics = Arc::new(Statistics::joined(scenes.iter().map(|(scene, _)| scene.statistics())));
        Ok(Self { scenes: scenes.into(), statistics })
    }

    /// True if a scene has levels of detail.
    pub fn has_levels(&self) -> bool {
        self.scenes.iter().any(|(scene, _)| matches!(scene, PagedScene::File(file) if file.levels().is_some()))
    }

    /// Makes a page cache for all of them, as far as the free memory of a device allows.
    ///
    /// # Errors
    /// If there is too little memory for some pages, a page cannot be read, or the instances have too many Gaussians;
    /// [`NoLevels`].
    pub fn upload_with(&self, device: &Device, options: &Options, upload: Upload) -> Result<GpuScene> {
        ensure!(!options.wants_levels() || self.has_levels(), NoLevels);
        let all: Vec<PagedScene> = self.scenes.iter().map(|(scene, _)| scene.clone()).collect();
        let pages = Pages::joined(&all, &upload.culling(options));
        let scene = GpuScene::of_pages(device, &pages, options, upload.reserve_bytes)?;
        let placed = self.scenes.iter().map(|(scene, instances)| (instances.clone(), scene.statistics().extent));
        scene.with_placed_scenes(&placed.collect::<Vec<_>>())
    }
}
