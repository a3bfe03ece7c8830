//! A scene that commands draw: Gaussians in memory, or a page file that is drawn page by page.

use anyhow::Result;

use super::{SceneArg, Usage};
use crate::gpu::Device;
use crate::measure::bench::SceneReport;
use crate::render::SceneSource;
use crate::scene::{Gaussians, Scene};
use crate::storage::Statistics;

/// A scene that is read as far as it has to be before it is drawn.
pub(super) struct Drawable {
    pub source: SceneSource,
    pub is_antialiased: bool,
    title: String,
}

impl Drawable {
    /// Reads a scene for a device, if any.
    pub fn read(scene: &SceneArg, device: Option<&Device>) -> Result<Self> {
        match Self::in_pages(scene)? {
            Some(paged) => Ok(paged),
            None => Ok(Self::of(scene, scene.read_for(device)?)),
        }
    }

    /// The scene, if it is a page file and is drawn as it is.
    pub fn in_pages(scene: &SceneArg) -> Result<Option<Self>> {
        let file = scene.page_file()?;
        Ok(file.map(|file| {
            let is_antialiased = file.header().is_antialiased;
            Self { source: SceneSource::File(file.into()), is_antialiased, title: scene.title() }
        }))
    }

    /// A scene that was read.
    pub fn of(arg: &SceneArg, scene: Scene) -> Self {
        let Scene { gaussians, is_antialiased, .. } = scene;
        Self { source: SceneSource::of(gaussians), is_antialiased, title: arg.title() }
    }

    /// Its entry in reports. The hash of a page file is that of its header, which holds checksums of all the rest.
    pub fn report(&self) -> SceneReport {
        match &self.source {
            SceneSource::Memory { gaussians, .. } => SceneReport::of(self.title.clone(), gaussians),
            SceneSource::File(file) => {
                let header = file.header();
                SceneReport {
                    name: self.title.clone(),
                    gaussians: header.statistics.count,
                    sh_degree: header.statistics.sh_degree,
                    hash: blake3::hash(&header.encoded()).to_hex().to_string(),
                }
            }
        }
    }

    /// The Gaussians and their statistics, for what compares with the reference.
    ///
    /// # Errors
    /// [`Usage`] if they are in a page file. `option` names what needs them.
    pub fn in_memory(&self, option: &str) -> Result<(&Gaussians, &Statistics)> {
        match &self.source {
            SceneSource::Memory { gaussians, statistics } => Ok((gaussians, statistics)),
            SceneSource::File(_) => Err(Usage(format!(
                "{option} compares with the reference, which draws scenes in memory: {} is a page file",
                self.title
            ))
            .into()),
        }
    }
}
