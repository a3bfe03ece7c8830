//! The open scenes: the source of each, its placement, and whether it is shown.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};
use glam::{DQuat, DVec3, EulerRot};

use super::edit::Edit;
use super::edit_result::Edited;
use super::loaded_scene::{Held, Opened};
use crate::formats;
use crate::formats::Reading;
use crate::pagefile;
use crate::pagefile::PageFile;
use crate::procedural::Procedural;
use crate::scene::{Focus, Gaussians, Scene, Transform, Watch, remarks};
use crate::viewer::jobs::{Cancel, JobEvent, Jobs, Stamp, file_watch};

/// The source of a scene.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    File(PathBuf),
    Procedural(Procedural),
}

/// A scene that is open or being read.
pub struct Layer {
    pub number: u64,
    pub source: Source,
    pub name: String,
    pub held: Option<Held>,
    pub is_antialiased: bool,
    /// A text about what was read and what was dropped.
    pub summary: String,
    pub place: Place,
    /// What is done to its Gaussians; `None` if nothing is.
    pub edit: Option<Arc<Edit>>,
    /// What a project did to it, until it is read.
    pub saved_edit: Vec<(usize, u8)>,
    /// Where most of it lies, in its own axes, once it is read.
    pub focus: Option<Focus>,
    /// The Gaussians that an edit leaves.
    pub edited: Option<Edited>,
    /// By side: the picture includes this scene.
    pub is_shown: [bool; 2],
    /// The fraction read, 0 to 1; `None` once all is read.
    pub progress: Option<f64>,
    /// All of it was read at least once.
    pub is_read: bool,
    /// Its file changed, and is to be read again when nothing is edited.
    pub has_changed: bool,
    reading: Reading,
    /// Of the file, when it was read last.
    seen: Stamp,
    cancel: Cancel,
}

/// The placement of a scene, as the panel edits it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// World units.
    pub translation: [f64; 3],
    /// Degrees around y, then x, then z.
    pub rotation: [f64; 3],
    pub scale: f64,
}

impl Default for Place {
    fn default() -> Self {
        Self { translation: [0.0; 3], rotation: [0.0; 3], scale: 1.0 }
    }
}

impl Place {
    /// The transform of this placement: exactly the identity for the default numbers.
    ///
    /// # Errors
    /// The scale or another number is not usable.
    pub fn transform(&self) -> Result<Transform> {
        let [x, y, z] = self.rotation.map(f64::to_radians);
        let rotation = DQuat::from_euler(EulerRot::YXZ, y, x, z);
        Transform::new(rotation, DVec3::from(self.translation), self.scale)
    }
}

impl Source {
    /// The procedural scene, the file, or the scene file in the model folder that `path` names.
    pub fn of(path: &Path) -> Result<Self> {
        match path.to_str().and_then(Procedural::parse) {
            Some(procedural) => procedural.map(Self::Procedural),
            None => Ok(Self::File(formats::in_folder(path))),
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
    /// Starts to read a scene, on another thread.
    pub fn open(number: u64, source: Source, reading: Reading, jobs: &Jobs) -> Self {
        let mut layer = Self {
            number,
            name: source.name(),
            source,
            held: None,
            is_antialiased: false,
            summary: String::new(),
            place: Place::default(),
            edit: None,
            saved_edit: Vec::new(),
            focus: None,
            edited: None,
            is_shown: [true; 2],
            progress: None,
            is_read: false,
            has_changed: false,
            reading,
            seen: None,
            cancel: Cancel::default(),
        };
        layer.read(jobs);
        layer
    }

    /// Starts to read the scene, on another thread. What was read before stays until all is there.
    pub fn read(&mut self, jobs: &Jobs) {
        let (number, reading, shows_parts) = (self.number, self.reading, !self.is_read);
        let (source, cancel) = (self.source.clone(), self.cancel.clone());
        if let Source::File(path) = &source {
            self.seen = file_watch::stamp(path);
        }
        self.progress = Some(0.0);
        jobs.start(
            move |reporter| {
                let part = |part| reporter.send(JobEvent::Partial(number, part));
                let progress = |fraction| reporter.send(JobEvent::Reading(number, fraction));
                read(source, reading, &progress, shows_parts.then_some(&part), &cancel)
            },
            move |opened| JobEvent::Read(number, opened),
        );
    }

    /// Waits, on another thread, until the file changes.
    pub fn follow(&self, jobs: &Jobs) {
        let Source::File(path) = self.source.clone() else { return };
        let (number, seen, cancel) = (self.number, self.seen, self.cancel.clone());
        jobs.start(
            move |_| file_watch::wait_for_change(&path, seen, &cancel),
            move |changed| JobEvent::Changed(number, changed),
        );
    }

    /// Takes in the scene that was opened, and returns its Gaussians, and what a user should know of them.
    pub fn fill(&mut self, opened: Opened) -> (Held, Vec<String>) {
        let (format, count, degree, report, notices, is_antialiased, held) = match opened {
            Opened::Whole(scene) => {
                let Scene { gaussians, report, format, is_antialiased, notices, .. } = *scene;
                let (count, degree) = (gaussians.len(), gaussians.sh_degree());
                (format, count, degree, report, notices, is_antialiased, Held::Whole(Arc::new(gaussians)))
            }
            Opened::Pages(file) => {
                let header = file.header();
                let (format, report, is_antialiased) = (header.format_of_pages(), header.report, header.is_antialiased);
                let (count, degree) = (header.statistics.count, header.statistics.sh_degree);
                (format, count, degree, report, Vec::new(), is_antialiased, Held::Pages(file.clone()))
            }
        };
        self.summary = format!("{format}, {count} Gaussians, SH degree {degree}; {report}");
        notices.iter().for_each(|notice| self.summary += &format!("; {notice}"));
        if matches!(held, Held::Pages(_)) {
            self.summary += "; levels of detail, read page by page";
        }
        self.is_antialiased = is_antialiased;
        (self.progress, self.is_read) = (None, true);
        self.focus = Some(held.focus());
        (self.held.insert(held).clone(), remarks(&self.name, &report, &notices))
    }

    /// Where most of it lies in the world; `None` before all is read, or where its placement is no transform.
    pub fn placed_focus(&self) -> Option<Focus> {
        let (focus, place) = (self.focus?, self.place.transform().ok()?);
        let centre = place.point(DVec3::from(focus.centre)).to_array();
        Some(Focus { centre, radius: focus.radius * place.scale() })
    }

    /// True if the Gaussians that an edit leaves are not there yet.
    pub fn is_being_edited(&self) -> bool {
        match (&self.edit, &self.edited) {
            (None, None) => false,
            (Some(edit), Some(edited)) => !Arc::ptr_eq(edit, &edited.of),
            _ => true,
        }
    }

    /// The Gaussians and the transform that the picture of this side draws; `None` if it does not show the scene. With
    /// `is_tinted`, what is selected has another colour.
    ///
    /// # Errors
    /// The placement is not a valid transform.
    pub fn part(&self, side: usize, is_tinted: bool) -> Result<Option<(Held, Transform)>> {
        let held = match &self.edited {
            Some(Edited { tinted: Some(tinted), .. }) if is_tinted => Some(tinted),
            Some(edited) => Some(&edited.kept),
            None => self.held.as_ref(),
        };
        let Some(held) = held.filter(|held| self.is_shown[side] && held.count() > 0) else { return Ok(None) };
        let transform = self.place.transform().with_context(|| format!("{} cannot be placed there", self.name))?;
        Ok(Some((held.clone(), transform)))
    }
}

/// Reads the scene of a layer, or opens it if its pages are read later.
/// `show` receives what is read so far.
fn read(
    source: Source,
    reading: Reading,
    progress: &dyn Fn(f64),
    show: Option<&dyn Fn(Arc<Gaussians>)>,
    cancel: &Cancel,
) -> Result<Opened> {
    let path = match source {
        Source::Procedural(procedural) => return reading.make(procedural).map(Box::new).map(Opened::Whole),
        Source::File(path) => path,
    };
    if reading == Reading::default()
        && let Some(file) = with_levels(&path)
    {
        return Ok(Opened::Pages(Arc::new(file)));
    }
    let watch = Watch {
        progress,
        partial: &|so_far| {
            let Some(show) = show else { return };
            // A failure to place the scene is reported when all is read.
            let part = so_far.so_far().map_err(anyhow::Error::from);
            if let Ok(placed) = part.and_then(|part| reading.placed(part)) {
                show(Arc::new(placed));
            }
        },
        is_cancelled: &|| cancel.is_cancelled(),
    };
    pagefile::read(&reading, &path, &watch).map(Box::new).map(Opened::Whole)
}

/// The page file, if it has levels of detail. What is wrong with a file is reported where it is read.
fn with_levels(path: &Path) -> Option<PageFile> {
    let file = pagefile::is_page_file(path).then(|| PageFile::open(path).ok()).flatten()?;
    file.levels().is_some().then_some(file)
}

impl Drop for Layer {
    fn drop(&mut self) {
        self.cancel.cancel();
    }
}
