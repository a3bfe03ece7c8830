//! A scene that commands draw, with its name and its entry in reports.

use std::path::Path;

use anyhow::Result;

use super::Usage;
use super::scenes::SceneArg;
use crate::gpu::Device;
use crate::measure::bench::SceneReport;
use crate::packing::Statistics;
use crate::render::{Content, SceneSource};
use crate::scene::{Gaussians, Scene, SceneInstances, Unreadable};

/// A scene that is opened for drawing: read into memory, or a page file.
pub(super) struct Drawable {
    pub source: SceneSource,
    title: String,
}

impl Drawable {
    /// Opens a scene for a device, if any; `wants_levels`: with the levels that its file has.
    pub fn read(scene: &SceneArg, wants_levels: bool, device: Option<&Device>) -> Result<Self> {
        match Self::in_pages(scene, wants_levels)? {
            Some(paged) => Ok(paged),
            None => Ok(Self::of(scene, scene.read_for(device)?)),
        }
    }

    /// The scene, if it is a page file and is drawn as it is; `wants_levels`: also if its file has levels of its own,
    /// which are measured and written to a temporary file.
    pub fn in_pages(scene: &SceneArg, wants_levels: bool) -> Result<Option<Self>> {
        let file = match scene.page_file()? {
            None if wants_levels => scene.source_levels()?,
            file => file,
        };
        Ok(file.map(|file| Self { source: SceneSource::of_file(file), title: scene.title() }))
    }

    /// A scene in memory.
    pub fn of(arg: &SceneArg, scene: Scene) -> Self {
        let title = arg.title();
        Self { source: SceneSource::of_scene(scene, &title), title }
    }

    /// The scene with these instances, if any.
    pub fn placed(self, instances: Option<SceneInstances>) -> Self {
        Self { source: SceneSource { instances, ..self.source }, ..self }
    }

    /// Its entry in reports. The hash of a page file is that of its header, which holds checksums of all the rest. The
    /// instances of a scene add their Gaussians, and change the hash.
    pub fn report(&self) -> SceneReport {
        let report = self.report_of_one();
        let Some(instances) = &self.source.instances else { return report };
        let hash = blake3::Hasher::new().update(report.hash.as_bytes()).update(instances.hash().as_bytes()).finalize();
        let gaussians = report.gaussians.saturating_mul(instances.all().len());
        SceneReport { gaussians, hash: hash.to_hex().to_string(), ..report }
    }

    /// The entry of one instance of the scene.
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
                "{option} compares with the reference, which draws scenes in memory: {} is drawn from pages",
                self.title
            ))
            .into()),
        }
    }
}

/// Reads the list of places of `--place`, if one is given.
pub(super) fn read_places(file: Option<&Path>) -> Result<Option<SceneInstances>> {
    let read = |file: &Path| SceneInstances::read(file).map_err(|problem| Unreadable::new(file, &problem));
    Ok(file.map(read).transpose()?)
}
