//! A scene before it is on a device: Gaussians in memory or a page file, with placements if it has any.

use std::sync::Arc;

use anyhow::{Result, ensure};

use super::gpu_scene::GpuScene;
use crate::gpu::Device;
use crate::host_memory::OutOfMemory;
use crate::options::Options;
use crate::packing::Statistics;
use crate::pagefile::{PageFile, Pages};
use crate::rules::{LISTED_ALPHA, Rules};
use crate::scene::{Focus, Gaussians, Placements};

/// A scene that can be brought to any number of devices. A clone shares it.
#[derive(Clone)]
pub struct SceneSource {
    pub content: Content,
    /// The placements of the scene in the world, if it has any.
    pub placements: Option<Placements>,
}

/// The scene has no levels of detail, and the options require them.
#[derive(Debug, thiserror::Error)]
#[error(
    "there are no levels of detail here: `smalto lod` makes a file with them; `render`, `bench`, `view` and `trade` \
     draw it"
)]
pub struct NoLevels;

/// The Gaussians of a scene, in memory or in a page file.
#[derive(Clone)]
pub enum Content {
    Memory { gaussians: Arc<Gaussians>, statistics: Arc<Statistics> },
    File(Arc<PageFile>),
}

impl SceneSource {
    pub fn of(gaussians: Gaussians) -> Self {
        let statistics = Arc::new(Statistics::of(&gaussians));
        Self::shared(Arc::new(gaussians), statistics)
    }

    /// A scene of Gaussians with known statistics.
    pub fn shared(gaussians: Arc<Gaussians>, statistics: Arc<Statistics>) -> Self {
        Self { content: Content::Memory { gaussians, statistics }, placements: None }
    }

    pub fn of_file(file: PageFile) -> Self {
        Self { content: Content::File(Arc::new(file)), placements: None }
    }

    /// The statistics of the scene without its placements.
    pub fn statistics(&self) -> &Statistics {
        match &self.content {
            Content::Memory { statistics, .. } => statistics,
            Content::File(file) => &file.header().statistics,
        }
    }

    /// The region of most of the scene, all placements together.
    pub fn focus(&self) -> Focus {
        let focus = match &self.content {
            Content::Memory { gaussians, .. } => Focus::of(gaussians),
            Content::File(file) => file.header().statistics.focus,
        };
        self.placements.as_ref().map_or(focus, |placements| placements.focus(focus))
    }

    /// The Gaussians without placements, if they are in memory.
    pub fn gaussians(&self) -> Option<&Gaussians> {
        match &self.content {
            Content::Memory { gaussians, .. } => Some(gaussians),
            Content::File(_) => None,
        }
    }

    /// True if the scene has levels of detail.
    pub fn has_levels(&self) -> bool {
        matches!(&self.content, Content::File(file) if file.levels().is_some())
    }

    /// Brings the scene to a device, for a renderer that makes certificates or one that does not. A page file, a scene
    /// that is too large for the device, or one with placements is drawn in pages; `reserve` bytes of memory then stay
    /// free for pictures.
    ///
    /// # Errors
    /// If the least number of pages does not fit, a page cannot be read, or the placements have too many Gaussians;
    /// [`NoLevels`].
    pub fn bring(&self, device: &Device, options: &Options, certifies: bool, reserve: u64) -> Result<GpuScene> {
        // A scene without Gaussians is empty everywhere.
        let placements = self.placements.as_ref().filter(|_| self.statistics().count > 0);
        ensure!(!certifies || placements.is_none(), "pictures of scenes at places have no certificates");
        ensure!(!options.wants_levels() || self.has_levels() || self.statistics().count == 0, NoLevels);
        let alpha_min = if certifies { LISTED_ALPHA } else { options.rules.alpha_min };
        let options = &Options { rules: Rules { alpha_min, ..options.rules }, ..*options };
        let pages = match &self.content {
            Content::Memory { gaussians, statistics } => {
                let whole = || GpuScene::with_reserve(device, gaussians, statistics, options, reserve);
                match placements.is_none().then(whole) {
                    None => {}
                    Some(Err(error)) if error.is::<OutOfMemory>() => {}
                    Some(other) => return other,
                }
                Pages::of_gaussians(gaussians.clone(), Statistics::clone(statistics), options)
            }
            Content::File(file) => Pages::of_file(file.clone(), options),
        };
        let scene = GpuScene::of_pages(device, &pages, options, reserve)?;
        match placements {
            None => Ok(scene),
            Some(placements) => scene.placed(placements),
        }
    }
}
