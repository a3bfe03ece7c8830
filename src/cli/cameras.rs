//! The cameras of a command: all cameras of a file, a split of them, or frames along a camera path.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::ValueEnum;

use super::{SceneArg, Usage, remark};
use crate::camera::{self, NamedCamera, Split, Timeline};
use crate::scene::Unreadable;

/// The choice of a split.
#[derive(clap::Args)]
pub(super) struct SplitArg {
    /// Use only the cameras of this split, numbered from 0. If the file names no split, every eighth camera in the
    /// order of names is in test (beginning with the first), all others are in train
    #[arg(long, value_enum, value_name = "SPLIT", default_value = "all")]
    split: Choice,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Choice {
    All,
    Train,
    Val,
    Test,
}

impl SplitArg {
    /// Reads the cameras of the split, in the order of the file. Prints the notices of the reader to stderr.
    pub fn read(&self, file: &Path) -> Result<Vec<NamedCamera>> {
        let read = camera::read(file).map_err(|problem| Unreadable::new(file, &problem))?;
        for notice in &read.notices {
            remark(&format!("note: {}: {notice}", file.display()));
        }
        let split = match self.split {
            Choice::All => return Ok(read.cameras),
            Choice::Train => Split::Train,
            Choice::Val => Split::Val,
            Choice::Test => Split::Test,
        };
        let count = read.cameras.len();
        let cameras = read.of(split);
        if cameras.is_empty() {
            let (name, file) = (format!("{split:?}").to_lowercase(), file.display());
            return Err(Usage(format!("--split {name}: {file} has {count} cameras, and none is in this split")).into());
        }
        Ok(cameras)
    }

    /// Fails if a split is given without a camera file.
    pub fn check_no_file(&self) -> Result<(), Usage> {
        if self.split == Choice::All {
            return Ok(());
        }
        Err(Usage("--split needs a camera file, and there is none".to_owned()))
    }
}

/// The camera file on the command line, or the one found next to the scene or in a folder above it.
pub(super) fn named_or_found(named: Option<&Path>, scene: &SceneArg) -> Option<PathBuf> {
    named.map(Path::to_owned).or_else(|| camera::find(&scene.path()?))
}

/// A camera path and its frame rate.
#[derive(clap::Args)]
pub(super) struct FilmArgs {
    /// Draw the frames of a camera path (docs/camera-path.md) into a folder. `smalto view` writes such files
    #[arg(long, value_name = "FILE", conflicts_with_all = ["cameras", "camera", "split"])]
    path: Option<PathBuf>,
    /// Frames per second of --path and --video [default: 30]
    #[arg(long, value_name = "FPS", value_parser = parse_fps)]
    fps: Option<f64>,
}

/// Frames per second.
pub(super) const DEFAULT_FPS: f64 = 30.0;
/// Largest number of frames along a path.
const MAX_FRAMES: usize = 100_000;

impl FilmArgs {
    pub fn has_path(&self) -> bool {
        self.path.is_some()
    }

    /// Frames per second, if given.
    pub fn fps(&self) -> Option<f64> {
        self.fps
    }

    /// Reads the path, if one is given, and samples its frames.
    pub fn read(&self) -> Result<Option<Vec<NamedCamera>>> {
        let Some(file) = &self.path else { return Ok(None) };
        let timeline = Timeline::read(file).map_err(|problem| Unreadable::new(file, &problem))?;
        let frames = timeline.frames(self.fps.unwrap_or(DEFAULT_FPS));
        let count = frames.len();
        if count > MAX_FRAMES {
            let (seconds, fps) = (timeline.duration(), self.fps.unwrap_or(DEFAULT_FPS));
            let which = format!("{seconds} s of {} at {fps} frames per second", file.display());
            return Err(Usage(format!("--path: {which} are {count} frames, over {MAX_FRAMES}")).into());
        }
        Ok(Some(frames.enumerate().map(|(i, camera)| NamedCamera { name: format!("frame {i}"), camera }).collect()))
    }
}

fn parse_fps(text: &str) -> Result<f64> {
    match text.parse() {
        Ok(fps) if fps > 0.0 && fps <= 1000.0 => Ok(fps),
        _ => bail!("expected frames per second, above 0 and at most 1000"),
    }
}
