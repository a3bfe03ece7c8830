//! The open scenes: the source of each, its placement, and whether it is shown.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use glam::{DQuat, DVec3, EulerRot};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::appearance::Appearance;
use super::edit::{Edit, set_of};
use super::job_event::{JobEvent, Jobs};
use super::loaded_scene::{DrawnScene, LoadedScene, OpenedScene};
use crate::formats;
use crate::formats::Reading;
use crate::pagefile;
use crate::pagefile::PageFile;
use crate::pagefile::write::temporary_levels;
use crate::procedural::Procedural;
use crate::scene::{Focus, Gaussians, Scene, SceneInstances, Transform, Watch, remarks};
use crate::viewer::jobs::{Cancel, FileStamp, file_watch};

/// The source of a scene.
#[derive(Clone, Debug, PartialEq)]
pub enum LayerSource {
    File(PathBuf),
    Procedural(Procedural),
}

/// A scene that is open or being read.
#[derive(Clone)]
pub struct Layer {
    pub number: u64,
    pub source: LayerSource,
    pub name: String,
    /// The Gaussians that were read, perhaps only a part of them; `None` before the first part.
    pub scene: Option<LoadedScene>,
    pub is_antialiased: bool,
    /// A text about the file and about Gaussians that were dropped.
    pub summary: String,
    pub placement: Placement,
    /// The list of places at which the scene is drawn, in the axes before the placement, and its file.
    pub places: Option<(PathBuf, SceneInstances)>,
    pub appearance: Appearance,
    /// The scene is a part of that of its source: this edit of the whole deletes what is not in it.
    pub part: Option<Arc<Edit>>,
    /// Selection, hidden and deleted Gaussians; `None` if no Gaussian has a flag.
    pub edit: Option<Arc<Edit>>,
    /// Edit of a project, as runs, to apply once the scene has been read.
    pub project_edit: Vec<(usize, u8)>,
    /// Bounds of the main content in the scene's own axes, once it is loaded.
    pub focus: Option<Focus>,
    /// By side: the picture includes this scene.
    pub is_shown: [bool; 2],
    /// The fraction read, 0 to 1; `None` once all is read.
    pub progress: Option<f64>,
    /// The whole scene was read at least once.
    pub is_loaded: bool,
    /// The file has changed; it is read again once the scene has no edit.
    pub has_changed: bool,
    /// How the file is read.
    pub reading: Reading,
    /// True if a scene is read with all levels that its file has.
    wants_levels: bool,
    /// Stamp of the file when it was read last.
    stamp: FileStamp,
    cancel: Cancel,
}

/// Where a scene lies in the world.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Placement {
    /// World units.
    #[serde(rename = "position")]
    pub translation: [f64; 3],
    /// Degrees around x, y and z. The rotation is Ry Rx Rz: around z first.
    pub rotation: [f64; 3],
    /// A factor over 0.
    pub scale: f64,
}

impl Default for Placement {
    fn default() -> Self {
        Self { translation: [0.0; 3], rotation: [0.0; 3], scale: 1.0 }
    }
}

impl Placement {
    /// The placement of a transform.
    pub fn of(transform: &Transform) -> Self {
        let (y, x, z) = transform.rotation().to_euler(EulerRot::YXZ);
        Self {
            translation: transform.translation().to_array(),
            rotation: [x, y, z].map(f64::to_degrees),
            scale: transform.scale(),
        }
    }

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

impl LayerSource {
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
    /// A layer whose scene a job starts to read; `wants_levels`: with all levels that its file has.
    pub fn open(number: u64, source: LayerSource, reading: Reading, wants_levels: bool, jobs: &Jobs) -> Self {
        let mut layer = Self {
            number,
            name: source.name(),
            source,
            scene: None,
            is_antialiased: false,
            summary: String::new(),
            placement: Placement::default(),
            places: None,
            appearance: Appearance::default(),
            part: None,
            edit: None,
            project_edit: Vec::new(),
            focus: None,
            is_shown: [true; 2],
            progress: None,
            is_loaded: false,
            has_changed: false,
            reading,
            wants_levels,
            stamp: None,
            cancel: Cancel::default(),
        };
        layer.read(jobs);
        layer
    }

    /// The layer as another viewer opens it, without reading it again.
    pub fn shared(&self, number: u64) -> Self {
        let mut layer = self.clone();
        (layer.number, layer.cancel) = (number, Cancel::default());
        // The other viewer may be reading it again.
        layer.progress.take_if(|_| self.is_loaded);
        layer
    }

    /// Takes the scene of another layer, which was read from the same source, if it is another one.
    pub fn follow(&mut self, read: &Self) -> bool {
        let (Some(old), Some(new)) = (&self.scene, &read.scene) else { return false };
        if old.is_same(new) {
            return false;
        }
        self.scene = Some(new.clone());
        (self.is_antialiased, self.focus) = (read.is_antialiased, read.focus);
        self.summary.clone_from(&read.summary);
        true
    }

    /// A layer with the selected Gaussians of another one, at their places.
    ///
    /// # Errors
    /// Memory runs out.
    pub fn part_of(whole: &Self, number: u64, name: String) -> Result<Option<Self>> {
        let (Some(LoadedScene::Whole(gaussians)), Some(edit)) = (&whole.scene, &whole.edit) else { return Ok(None) };
        let has = |i: u32| edit.selected()[i as usize / 32] >> (i % 32) & 1 == 1;
        let selected: Vec<u32> = (0..gaussians.len() as u32).filter(|i| has(*i)).collect();
        if selected.is_empty() {
            return Ok(None);
        }
        let scene = LoadedScene::Whole(Arc::new(gaussians.selected(&selected)?));
        // Of the whole scene, also if this one is a part.
        let of_source = whole.part.as_ref().map(|part| part.kept());
        let count = whole.part.as_ref().map_or(gaussians.len(), |part| part.gaussians());
        let indices: Vec<u32> =
            selected.iter().map(|i| of_source.as_ref().map_or(*i, |of_source| of_source[*i as usize])).collect();
        let part = Edit::new(count).deleting(&set_of(count, |i| indices.binary_search(&(i as u32)).is_err()));
        Ok(Some(Self {
            number,
            source: whole.source.clone(),
            name,
            focus: Some(scene.focus()),
            scene: Some(scene),
            is_antialiased: whole.is_antialiased,
            summary: format!("{} Gaussians of {}", selected.len(), whole.name),
            placement: whole.placement,
            places: whole.places.clone(),
            appearance: whole.appearance,
            part: Some(Arc::new(part)),
            edit: None,
            project_edit: Vec::new(),
            is_shown: whole.is_shown,
            progress: None,
            is_loaded: true,
            has_changed: false,
            reading: whole.reading,
            wants_levels: whole.wants_levels,
            stamp: None,
            cancel: Cancel::default(),
        }))
    }

    /// Starts a job that reads the scene. The scene that was read before stays until the job has finished.
    pub fn read(&mut self, jobs: &Jobs) {
        let (number, shows_parts) = (self.number, !self.is_loaded);
        let (reading, wants_levels) = (self.reading, self.wants_levels);
        let (source, cancel) = (self.source.clone(), self.cancel.clone());
        if let LayerSource::File(path) = &source {
            self.stamp = file_watch::stamp(path);
        }
        self.progress = Some(0.0);
        jobs.start(
            move |reporter| {
                let part = |part| reporter.send(JobEvent::Partial(number, part));
                let progress = |fraction| reporter.send(JobEvent::Reading(number, fraction));
                read(source, reading, wants_levels, &progress, shows_parts.then_some(&part), &cancel)
            },
            move |opened| JobEvent::Read(number, opened),
        );
    }

    /// Starts a job that waits until the file changes.
    pub fn watch_file(&self, jobs: &Jobs) {
        let LayerSource::File(path) = self.source.clone() else { return };
        let (number, stamp, cancel) = (self.number, self.stamp, self.cancel.clone());
        jobs.start(
            move |_| file_watch::wait_for_change(&path, stamp, &cancel),
            move |changed| JobEvent::Changed(number, changed),
        );
    }

    /// Stores the scene that was opened. Returns its Gaussians, and remarks for the user.
    ///
    /// # Errors
    /// The layer is a part of another scene, or memory runs out.
    pub fn set_opened(&mut self, opened: OpenedScene) -> Result<(LoadedScene, Vec<String>)> {
        let (format, count, degree, report, notices, is_antialiased, scene) = match opened {
            OpenedScene::Whole(scene) => {
                let Scene { gaussians, report, format, is_antialiased, notices, .. } = *scene;
                let gaussians = match &self.part {
                    Some(part) if part.gaussians() == gaussians.len() => gaussians.selected(&part.kept())?,
                    Some(_) => bail!("{} is a part of a file with other Gaussians", self.name),
                    None => gaussians,
                };
                let (count, degree) = (gaussians.len(), gaussians.sh_degree());
                (format, count, degree, report, notices, is_antialiased, LoadedScene::Whole(Arc::new(gaussians)))
            }
            OpenedScene::Paged(file, notices) => {
                let header = file.header();
                let (format, report, is_antialiased) = (header.format_of_pages(), header.report, header.is_antialiased);
                let (count, degree) = (header.statistics.count, header.statistics.sh_degree);
                (format, count, degree, report, notices, is_antialiased, LoadedScene::Paged(file.clone()))
            }
        };
        self.summary = format!("{format}, {count} Gaussians, SH degree {degree}; {report}");
        notices.iter().for_each(|notice| self.summary += &format!("; {notice}"));
        if matches!(scene, LoadedScene::Paged(_)) {
            self.summary += "; levels of detail, read page by page";
        }
        self.is_antialiased = is_antialiased;
        (self.progress, self.is_loaded) = (None, true);
        self.focus = Some(scene.focus());
        Ok((self.scene.insert(scene).clone(), remarks(&self.name, &report, &notices)))
    }

    /// Bounds of the main content in the world; `None` before the scene is loaded, or if its placement is no transform.
    pub fn placed_focus(&self) -> Option<Focus> {
        let (focus, transform) = (self.focus?, self.placement.transform().ok()?);
        let focus = self.places.as_ref().map_or(focus, |(_, places)| places.focus(focus));
        let centre = transform.point(DVec3::from(focus.centre)).to_array();
        Some(Focus { centre, radius: focus.radius * transform.scale() })
    }

    /// The scene that the picture of this side draws; `None` if it does not show the layer.
    ///
    /// # Errors
    /// The placement is not a valid transform.
    pub fn drawn_scene(&self, side: usize) -> Result<Option<DrawnScene>> {
        let scene = self.scene.as_ref().filter(|scene| self.is_shown[side] && scene.count() > 0);
        let Some(scene) = scene.cloned() else { return Ok(None) };
        let transform = self.placement.transform().with_context(|| format!("{} cannot be placed there", self.name))?;
        // A scene that is read again may have another number of Gaussians; it is not edited then.
        let edit = self.edit.clone().filter(|edit| edit.gaussians() == scene.count());
        let places = self.places.as_ref().map(|(_, places)| places.clone());
        Ok(Some(DrawnScene { scene, transform, places, appearance: self.appearance, edit }))
    }
}

/// Reads the scene of a layer, or opens its page file. `show` receives the Gaussians read so far.
fn read(
    source: LayerSource,
    reading: Reading,
    wants_levels: bool,
    progress: &(dyn Fn(f64) + Sync),
    show: Option<&dyn Fn(Arc<Gaussians>)>,
    cancel: &Cancel,
) -> Result<OpenedScene> {
    let path = match source {
        LayerSource::Procedural(procedural) => return reading.make(procedural).map(Box::new).map(OpenedScene::Whole),
        LayerSource::File(path) => path,
    };
    if reading == Reading::default()
        && let Some(file) = lod_file(&path)
    {
        return Ok(OpenedScene::Paged(Arc::new(file), Vec::new()));
    }
    if wants_levels
        && reading == Reading::default()
        && let Some(path) = formats::file_with_levels(&path)
    {
        let half = |begin: f64| move |fraction: f64| progress(begin + 0.5 * fraction);
        let (is_cancelled, first) = (|| cancel.is_cancelled(), half(0.0));
        let watch = Watch { progress: &first, is_cancelled: &is_cancelled, ..Watch::NONE };
        let levels = reading.read_levels(&path, &watch)?;
        let file = temporary_levels(&levels, &path, &half(0.5), &is_cancelled)?;
        return Ok(OpenedScene::Paged(Arc::new(file), levels.scene.notices));
    }
    let watch = Watch {
        progress,
        partial: &|so_far| {
            let Some(show) = show else { return };
            // A lack of memory is reported once the whole scene is read.
            if let Ok(part) = so_far.so_far() {
                show(Arc::new(part));
            }
        },
        is_cancelled: &|| cancel.is_cancelled(),
    };
    pagefile::read(&reading, &path, &watch).map(Box::new).map(OpenedScene::Whole)
}

/// The page file, if it has levels of detail. A damaged file is reported by the reader.
fn lod_file(path: &Path) -> Option<PageFile> {
    let file = pagefile::is_page_file(path).then(|| PageFile::open(path).ok()).flatten()?;
    file.levels().is_some().then_some(file)
}

impl Drop for Layer {
    fn drop(&mut self) {
        self.cancel.cancel();
    }
}
