//! What a plan of a picture uploads to a device.

use std::sync::Arc;

use anyhow::Result;

use crate::gpu::Device;
use crate::options::Options;
use crate::packing::Statistics;
use crate::render::{Content, GpuScene, JoinedScenes, SceneSource, Upload};
use crate::scene::Gaussians;

/// What a plan uploads: one scene, or several that are drawn in pages.
#[derive(Clone)]
pub enum Source {
    Scene(SceneSource),
    Joined(JoinedScenes),
}

impl Source {
    /// The statistics of all Gaussians.
    pub fn statistics(&self) -> Arc<Statistics> {
        match self {
            Self::Scene(scene) => match &scene.content {
                Content::Memory { statistics, .. } => statistics.clone(),
                Content::File(file) => Arc::new(file.header().statistics.clone()),
            },
            Self::Joined(joined) => joined.statistics.clone(),
        }
    }

    /// All Gaussians, if they are in memory and drawn once.
    pub fn gaussians(&self) -> Option<Arc<Gaussians>> {
        match self {
            Self::Scene(SceneSource { content: Content::Memory { gaussians, .. }, .. }) => Some(gaussians.clone()),
            _ => None,
        }
    }

    /// Uploads it to a device.
    ///
    /// # Errors
    /// If memory runs out, or a file cannot be read.
    pub fn upload(&self, device: &Device, options: &Options, upload: Upload) -> Result<GpuScene> {
        match self {
            Self::Scene(scene) => scene.upload_with(device, options, upload),
            Self::Joined(joined) => joined.upload_with(device, options, upload),
        }
    }
}
