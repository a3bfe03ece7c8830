//! The scenes that are open: where each comes from, where it is placed, and whether it is shown.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use glam::{DQuat, DVec3, EulerRot};

use super::jobs::{Cancel, Jobs, News};
use crate::scene::{self, Gaussians, Procedural, Reading, Scene, Transform, Watch};

/// Where a scene comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    File(PathBuf),
    Procedural(Procedural),
}

/// A scene that is open, or being read.
pub struct Layer {
    pub number: u64,
    pub name: String,
    pub gaussians: Option<Arc<Gaussians>>,
    pub is_antialiased: bool,
    /// What was read and dropped, in words.
    pub story: String,
    pub place: Place,
    /// Part of the first picture, and of the second where that shows scenes.
    pub is_shown: [bool; 2],
    /// The fraction read, while it is.
    pub progress: Option<f64>,
    cancel: Cancel,
}

/// A place as one edits it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// World units.
    pub translation: [f64; 3],
    /// Degrees around y, then x, then z.
    pub turn: [f64; 3],
    pub scale: f64,
}

impl Default for Place {
    fn default() -> Self {
        Self { translation: [0.0; 3], turn: [0.0; 3], scale: 1.0 }
    }
}

impl Place {
    /// Unchanged numbers change nothing at all.
    pub fn transform(&self) -> Result<Transform> {
        let [x, y, z] = self.turn.map(f64::to_radians);
        let rotation = DQuat::from_euler(EulerRot::YXZ, y, x, z);
        Transform::new(rotation, DVec3::from(self.translation), self.scale)
    }
}

impl Source {
    /// The file, the model folder's file, or the procedural scene that this names.
    pub fn of(path: &Path) -> Result<Self> {
        match path.to_str().and_then(Procedural::parse) {
            Some(procedural) => procedural.map(Self::Procedural),
            None => Ok(Self::File(scene::in_folder(path))),
        }
    }

    pub fn name(&self) -> String {
        match self {
            Self::File(path) => path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned(),
            Self::Procedural(procedural) => procedural.name().to_owned(),
        }
    }
}

impl Layer {
    /// Begins to read a scene.
    pub fn open(number: u64, source: Source, reading: Reading, jobs: &Jobs) -> Self {
        let cancel = Cancel::default();
        let (origin, stop) = (source.clone(), cancel.clone());
        jobs.start(
            move |reporter| match origin {
                Source::Procedural(procedural) => reading.make(procedural),
                Source::File(path) => reading.read_watched(
                    &path,
                    &Watch {
                        progress: &|fraction| reporter.tell(News::Reading(number, fraction)),
                        partial: &|so_far| {
                            // What cannot be placed is said when all is read.
                            let part = so_far.so_far().map_err(anyhow::Error::from);
                            if let Ok(placed) = part.and_then(|part| reading.placed(part)) {
                                reporter.tell(News::Partial(number, Arc::new(placed)));
                            }
                        },
                        is_cancelled: &|| stop.is_cancelled(),
                    },
                ),
            },
            move |scene| News::Read(number, scene),
        );
        Self {
            number,
            name: source.name(),
            gaussians: None,
            is_antialiased: false,
            story: String::new(),
            place: Place::default(),
            is_shown: [true; 2],
            progress: Some(0.0),
            cancel,
        }
    }

    /// Takes what was read.
    pub fn fill(&mut self, scene: Scene) {
        let Scene { gaussians, tally, format, is_antialiased, notices } = scene;
        let degree = gaussians.sh_degree();
        self.story = format!("{format}, {} Gaussians, SH degree {degree}; {tally}", gaussians.len());
        notices.iter().for_each(|notice| self.story += &format!("; {notice}"));
        self.is_antialiased = is_antialiased;
        self.gaussians = Some(Arc::new(gaussians));
        self.progress = None;
    }

    /// What a picture on this side draws of it.
    pub fn part(&self, side: usize) -> Result<Option<(Arc<Gaussians>, Transform)>> {
        let Some(gaussians) = self.gaussians.as_ref().filter(|_| self.is_shown[side]) else { return Ok(None) };
        let transform = self.place.transform().with_context(|| format!("{} cannot be placed there", self.name))?;
        Ok(Some((gaussians.clone(), transform)))
    }
}

impl Drop for Layer {
    fn drop(&mut self) {
        self.cancel.cancel();
    }
}
