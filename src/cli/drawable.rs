//! A scene that commands draw: Gaussians in memory, or a page file that is drawn page by page, perhaps at many places.

use std::path::Path;

use anyhow::Result;

use super::Usage;
use super::scenes::SceneArg;
use crate::gpu::Device;
use crate::measure::bench::SceneReport;
use crate::packing::Statistics;
use crate::render::{Content, SceneSource};
use crate::scene::{Gaussians, Placements, Scene, Unreadable};

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
            Self { source: SceneSource::of_file(file), is_antialiased, title: scene.title() }
        }))
    }

    /// A scene that was read.
    pub fn of(arg: &SceneArg, scene: Scene) -> Self {
        let Scene { gaussians, is_antialiased, .. } = scene;
        Self { source: SceneSource::of(gaussians), is_antialiased, title: arg.title() }
    }

    /// The scene at these places, if there are any.
    pub fn placed(self, placements: Option<Placements>) -> Self {
        Self { source: SceneSource { placements, ..self.source }, ..self }
    }

    /// Its entry in reports. The hash of a page file is that of its header, which holds checksums of all the rest. A
    /// scene at places has the Gaussians of all places, and a hash that depends on them.
    pub fn report(&self) -> SceneReport {
        let report = self.report_of_one();
        let Some(placements) = &self.source.placements else { return report };
        let hash = blake3::Hasher::new().update(report.hash.as_bytes()).update(placements.hash().as_bytes()).finalize();
        let gaussians = report.gaussians.saturating_mul(placements.all().len());
        SceneReport { gaussians, hash: hash.to_hex().to_string(), ..report }
    }

    /// The entry of the scene at one place.
    fn report_of_one(&self) -> SceneReport {
        match &self.source.content {
            Content::Memory { gaussians, .. } => SceneReport::of(self.title.clone(), gaussians),
            Content::File(file) => {
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
        match &self.source.content {
            Content::Memory { gaussians, statistics } => Ok((gaussians, statistics)),
            Content::File(_) => Err(Usage(format!(
                "{option} compares with the reference, which draws scenes in memory: {} is a page file",
                self.title
            ))
            .into()),
        }
    }
}

/// Reads the list of places of `--place`, if one is given.
pub(super) fn read_places(file: Option<&Path>) -> Result<Option<Placements>> {
    let read = |file: &Path| Placements::read(file).map_err(|problem| Unreadable::new(file, &problem));
    Ok(file.map(read).transpose()?)
}
