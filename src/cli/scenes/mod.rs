//! The scene argument of commands, and how scene files are read.
//!
//! - `piped` - scenes from standard input and other pipes, kept in a temporary file

mod piped;

use std::path::{Component, Path, PathBuf};
use std::time::UNIX_EPOCH;

use anyhow::{Context, Result, ensure};
use clap::Args;
use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::camera::Up;
use crate::cli::headings::SCENE;
use crate::cli::values::whole;
use crate::cli::{Usage, progress, remark};
use crate::formats::{LOD_META, Reading, SourceLevels};
use crate::gpu::Device;
use crate::pagefile::PageFile;
use crate::pagefile::write::temporary_levels;
use crate::procedural::Procedural;
use crate::render::GpuScene;
use crate::scene::{NoLevel, Scene, Transform, Watch};
use crate::{formats, pagefile};

/// The scene that a command draws, describes or measures.
#[derive(Args)]
pub(crate) struct SceneArg {
    #[arg(
        default_value = "cactus",
        help = "Scene file or folder, - for standard input, or procedural scene",
        long_help = format!(
            "Scene file ({}), folder of a SOG, model folder of the original 3DGS, - for a file on standard input, or \
             procedural scene: {}, optionally with a number of Gaussians, like cactus:20K",
            formats::read_labels(),
            formats::listed(Procedural::names().map(str::to_owned))
        )
    )]
    pub scene: PathBuf,
    #[command(flatten)]
    pub reading: ReadingArgs,
}

/// A scene in a single file, as the file system describes it. While this is the same, so is the scene.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct SceneFile {
    name: String,
    bytes: u64,
    /// Time of the last change, since 1970.
    modified_ns: u64,
}

impl SceneArg {
    /// The current file of the scene. `None` if the scene is procedural, comes from a pipe, lies in several files, or
    /// is read with --up, --flip or --sog-level.
    pub fn file(&self) -> Option<SceneFile> {
        let path = self.path()?;
        let names_others = path.extension().is_some_and(|end| end == "json" || end == "gltf");
        if names_others || !self.reading.is_plain() {
            return None;
        }
        let data = path.metadata().ok().filter(|data| data.is_file())?;
        let since_1970 = data.modified().ok()?.duration_since(UNIX_EPOCH).ok()?;
        let name = path.file_name()?.to_str()?.to_owned();
        Some(SceneFile { name, bytes: data.len(), modified_ns: u64::try_from(since_1970.as_nanos()).ok()? })
    }

    /// The procedural scene, if the argument names one.
    pub fn procedural(&self) -> Option<Result<Procedural>> {
        Procedural::parse(self.scene.to_str()?)
    }

    /// The file of the scene, if it is neither procedural nor comes from a pipe. In a model folder, the point cloud of
    /// the last iteration.
    pub fn path(&self) -> Option<PathBuf> {
        let is_file = self.procedural().is_none() && !piped::is_piped(&self.scene);
        is_file.then(|| formats::in_folder(&self.scene))
    }

    /// The scene if it is a town. Its cameras are paths of its own.
    pub fn town(&self) -> Result<Option<Procedural>> {
        let made = match self.procedural().transpose()? {
            Some(made) => Some(made),
            // A page file records its source.
            None => self.page_file()?.and_then(|file| {
                let header = file.header();
                let name = header.format.strip_prefix("procedural ")?;
                Procedural::parse(&format!("{name}:{}", header.statistics.count))?.ok()
            }),
        };
        let is_turned = self.reading.up.is_some() || self.reading.flip.is_some();
        Ok(made.filter(|made| made.is_town() && !is_turned))
    }

    /// The name of the scene in reports: its file name without the folder.
    pub fn title(&self) -> String {
        self.scene.file_name().unwrap_or(self.scene.as_os_str()).to_string_lossy().into_owned()
    }

    /// The stem of output files that are named after the scene. All models of the original and all SOGs in folders have
    /// files of the same names, so they are named by their folders.
    pub fn stem(&self) -> String {
        const OTHERWISE: &str = "scene";
        if let Some(Ok(procedural)) = self.procedural() {
            return procedural.name().to_owned();
        }
        let Some(path) = self.path() else { return OTHERWISE.to_owned() };
        let is_meta = path.file_name().is_some_and(|name| name == "meta.json" || name == LOD_META);
        if is_meta || self.scene.is_dir() {
            let folder = if is_meta { path.parent().unwrap_or(Path::new("")) } else { &self.scene };
            return folder_name(folder).unwrap_or_else(|| OTHERWISE.to_owned());
        }
        let name = path.file_name().map_or_else(|| OTHERWISE.into(), |n| n.to_string_lossy().into_owned());
        name.split('.').find(|part| !part.is_empty()).unwrap_or(OTHERWISE).to_owned()
    }

    /// Reads the scene to draw it on this device, if any. A procedural scene that is too large for it is refused before
    /// it is made.
    pub fn read_for(&self, device: Option<&Device>) -> Result<Scene> {
        if let (Some(device), Some(Ok(procedural))) = (device, self.procedural()) {
            GpuScene::check_count(device, procedural.count())?;
        }
        self.read()
    }

    /// The page file of the scene, if it is one and is read as it is.
    pub fn page_file(&self) -> Result<Option<PageFile>> {
        let path = self.path().filter(|path| pagefile::is_page_file(path));
        match path.filter(|_| self.reading.is_plain()) {
            Some(path) => Ok(Some(PageFile::open(&path)?)),
            None => Ok(None),
        }
    }

    /// Reads all levels of a scene that has some, and prints to stderr what was dropped or clamped.
    pub fn read_levels(&self, path: &Path) -> Result<SourceLevels> {
        let bar = progress::Bar::new("reading");
        let set = |fraction| bar.set(fraction);
        let levels = self.reading.reading()?.read_levels(path, &Watch::of_progress(&set))?;
        drop(bar);
        self.remark(&levels.scene);
        Ok(levels)
    }

    /// The file of the scene, if it has levels of its own and is read as it is.
    pub fn file_with_levels(&self) -> Option<PathBuf> {
        self.path().filter(|_| self.reading.is_plain()).and_then(|path| formats::file_with_levels(&path))
    }

    /// A temporary page file with the levels of the scene, if its file has some. Their errors are measured.
    pub fn source_levels(&self) -> Result<Option<PageFile>> {
        let Some(path) = self.file_with_levels() else { return Ok(None) };
        let levels = self.read_levels(&path)?;
        let bar = progress::Bar::new("measuring levels");
        temporary_levels(&levels, &path, &|fraction| bar.set(fraction), &|| false).map(Some)
    }

    /// Reads the file or makes the procedural scene. Prints to stderr what was dropped or clamped.
    pub fn read(&self) -> Result<Scene> {
        let scene = self.read_unless(&|| false)?;
        self.remark(&scene);
        Ok(scene)
    }

    /// Reads a scene, and prints only the progress. Reading a file, not a pipe, fails soon after it is cancelled.
    pub fn read_unless(&self, is_cancelled: &dyn Fn() -> bool) -> Result<Scene> {
        let path = self.path().unwrap_or_else(|| self.scene.clone());
        let (name, reading) = (path.display(), self.reading.reading()?);
        let read = match self.procedural() {
            Some(procedural) => reading.make(procedural.map_err(|e| Usage(format!("{name}: {e:#}")))?),
            None => {
                let bar = progress::Bar::new("reading");
                let progress = |fraction| bar.set(fraction);
                if piped::is_piped(&self.scene) {
                    piped::read(&self.scene, &reading, &progress)
                } else {
                    pagefile::read(&reading, &path, &Watch { progress: &progress, is_cancelled, ..Watch::NONE })
                }
            }
        };
        read.map_err(no_level)
    }

    /// Prints the notices of the reader to stderr.
    pub fn remark(&self, scene: &Scene) {
        let path = self.path().unwrap_or_else(|| self.scene.clone());
        let remarks = crate::scene::remarks(&path.display().to_string(), &scene.report, &scene.notices);
        remarks.iter().for_each(|text| remark(text));
    }
}

/// A level of detail that the scene lacks is an error of usage.
fn no_level(error: anyhow::Error) -> anyhow::Error {
    match error.downcast::<NoLevel>() {
        Ok(none) => Usage(format!("--sog-level: {none}")).into(),
        Err(error) => error,
    }
}

/// The name of the folder of a model or a SOG. The folders inside of a model have the same names in all models.
fn folder_name(folder: &Path) -> Option<String> {
    let folder = folder.canonicalize().ok()?;
    let names = folder.components().rev().filter_map(|part| match part {
        Component::Normal(name) => Some(name.to_string_lossy().into_owned()),
        _ => None,
    });
    let mut names = names.skip_while(|name| name.starts_with("iteration_") || name == "point_cloud");
    names.next()
}

/// Properties that scene files do not record, or record wrongly.
#[derive(Args, Clone, Copy, Default)]
pub(crate) struct ReadingArgs {
    /// Axis of the scene that points up: x, y, z, -x, -y, -z [default: -y]
    ///
    /// The scene is turned, cameras are not.
    #[arg(long, help_heading = SCENE, value_name = "AXIS", allow_hyphen_values = true, value_parser = parse_up)]
    up: Option<Up>,
    /// Axes of the scene to reverse, like y or yz
    ///
    /// For files whose axes point the other way than the format says.
    #[arg(long, help_heading = SCENE, value_name = "AXES", value_parser = parse_axes)]
    flip: Option<Axes>,
    /// Level of a streamed SOG (lod-meta.json), 0 is finest [default: 0]
    ///
    /// Without it, all levels are read where --splats, --lod-error or --lod-psnr ask for them.
    #[arg(long = "sog-level", help_heading = SCENE, value_name = "LEVEL", value_parser = whole::<u32>(0..=1000))]
    lod: Option<u32>,
    /// Applied after `up` and `flip`, by commands that change scenes.
    #[arg(skip)]
    then: Transform,
}

/// The axes that are reversed.
#[derive(Clone, Copy)]
struct Axes([bool; 3]);

impl ReadingArgs {
    /// The same reading, followed by a transform.
    pub fn then(self, transform: Transform) -> Self {
        Self { then: transform, ..self }
    }

    /// True if the file is read as it is.
    fn is_plain(&self) -> bool {
        self.up.is_none() && self.flip.is_none() && self.lod.is_none() && self.then == Transform::IDENTITY
    }

    /// The options of a command line with these values.
    #[cfg(feature = "viewer")]
    pub fn options(&self) -> Vec<String> {
        let axes = |Axes(axes): Axes| "xyz".chars().zip(axes).filter(|(_, is)| *is).map(|(axis, _)| axis).collect();
        let up = self.up.map(|up| ("--up", up.to_string()));
        let flip = self.flip.map(|flip| ("--flip", axes(flip)));
        let level = self.lod.map(|level| ("--sog-level", level.to_string()));
        let all = [up, flip, level].into_iter().flatten();
        all.flat_map(|(name, value): (_, String)| [name.to_owned(), value]).collect()
    }

    pub fn reading(&self) -> Result<Reading> {
        Ok(Reading {
            level: self.lod,
            flip: self.flip.map_or([false; 3], |Axes(axes)| axes),
            transform: self.up.map_or(Ok(Transform::IDENTITY), upright)?.then(&self.then)?,
        })
    }
}

/// The reading of a file with these values of --up, --flip and --sog-level.
///
/// # Errors
/// If a value is none that the option takes.
pub fn reading(up: Option<&str>, flip: Option<&str>, lod: Option<u32>) -> Result<Reading> {
    let up = up.map(parse_up).transpose().context("up")?;
    let flip = flip.map(parse_axes).transpose().context("flip")?;
    ReadingArgs { up, flip, lod, ..ReadingArgs::default() }.reading()
}

/// The rotation from the axis `up` to -y. If `up` is the opposite axis, the rotation is about x.
fn upright(up: Up) -> Result<Transform> {
    let wanted = Up::default().vector();
    let rotation = if up.flipped() == Up::default() {
        DQuat::from_rotation_x(std::f64::consts::PI)
    } else {
        DQuat::from_rotation_arc(up.vector(), wanted)
    };
    // The entries of quarter turns are exactly 0, 1 or -1.
    let matrix = DMat3::from_quat(rotation).to_cols_array().map(f64::round);
    Transform::new(DQuat::from_mat3(&DMat3::from_cols_array(&matrix)), DVec3::ZERO, 1.0)
}

fn parse_up(text: &str) -> Result<Up> {
    let wanted = text.trim_start_matches('+');
    let found = Up::ALL.into_iter().find(|up| up.to_string().trim_start_matches('+') == wanted);
    found.context("expected x, y, z, -x, -y or -z")
}

fn parse_axes(text: &str) -> Result<Axes> {
    ensure!(!text.is_empty() && text.chars().all(|c| "xyz".contains(c)), "expected some of x, y and z, like yz");
    Ok(Axes(['x', 'y', 'z'].map(|axis| text.contains(axis))))
}
