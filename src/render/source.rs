//! A scene before it is on a device: Gaussians in memory, or a page file.

use std::sync::Arc;

use anyhow::Result;

use super::gpu_scene::GpuScene;
use crate::gpu::Device;
use crate::host_memory::OutOfMemory;
use crate::options::Options;
use crate::rules::{LISTED_ALPHA, Rules};
use crate::scene::{Focus, Gaussians};
use crate::storage::{PageFile, Pages, Statistics};

/// A scene that can be brought to any number of devices. A clone shares it.
#[derive(Clone)]
pub enum SceneSource {
    Memory { gaussians: Arc<Gaussians>, statistics: Arc<Statistics> },
    File(Arc<PageFile>),
}

impl SceneSource {
    pub fn of(gaussians: Gaussians) -> Self {
        let statistics = Arc::new(Statistics::of(&gaussians));
        Self::Memory { gaussians: Arc::new(gaussians), statistics }
    }

    pub fn statistics(&self) -> &Statistics {
        match self {
            Self::Memory { statistics, .. } => statistics,
            Self::File(file) => &file.header().statistics,
        }
    }

    /// Where most of the scene lies.
    pub fn focus(&self) -> Focus {
        match self {
            Self::Memory { gaussians, .. } => Focus::of(gaussians),
            Self::File(file) => file.header().statistics.focus,
        }
    }

    /// The Gaussians, if they are in memory.
    pub fn gaussians(&self) -> Option<&Gaussians> {
        match self {
            Self::Memory { gaussians, .. } => Some(gaussians),
            Self::File(_) => None,
        }
    }

    /// Brings the scene to a device, for a renderer that makes certificates or one that does not. A page file, or a
    /// scene that is too large for the device, is drawn in pages; `reserve` bytes of memory are then left for pictures.
    ///
    /// # Errors
    /// If there is too little memory for some pages, or a page cannot be read.
    pub fn bring(&self, device: &Device, options: &Options, certifies: bool, reserve: u64) -> Result<GpuScene> {
        let alpha_min = if certifies { LISTED_ALPHA } else { options.rules.alpha_min };
        let options = &Options { rules: Rules { alpha_min, ..options.rules }, ..*options };
        let pages = match self {
            Self::Memory { gaussians, statistics } => {
                match GpuScene::with_reserve(device, gaussians, statistics, options, reserve) {
                    Err(error) if error.is::<OutOfMemory>() => {}
                    other => return other,
                }
                Pages::of_gaussians(gaussians.clone(), Statistics::clone(statistics), options)
            }
            Self::File(file) => Pages::of_file(file.clone(), options),
        };
        GpuScene::of_pages(device, &pages, options, reserve)
    }
}
