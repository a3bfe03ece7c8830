//! Which cameras commands draw from: those of a file, a split of them, or those along a path.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::ValueEnum;

use super::{SceneArg, Usage, remark};
use crate::camera::{self, NamedCamera, Split, Timeline};
use crate::scene::Unreadable;

/// Which cameras of a file.
#[derive(clap::Args)]
pub(super) struct SplitArg {
    /// Which cameras of the file, numbered from 0: of a split, as the file says itself, or else test every eighth by name
    /// from the first on and train the others
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
    /// The cameras of the split, in the file's order. Says on stderr what the file has that is drawn otherwise.
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
            return Err(Usage(format!("--split {name}: none of the {count} cameras of {file} are in it")).into());
        }
        Ok(cameras)
    }

    /// Fails if a split is wanted where there is no camera file.
    pub fn check_no_file(&self) -> Result<(), Usage> {
        if self.split == Choice::All {
            return Ok(());
        }
        Err(Usage("--split chooses among the cameras of a file, and there is no camera file".to_owned()))
    }
}

/// The camera file that was named, or the one that lies beside the scene or above it.
pub(super) fn named_or_found(named: Option<&Path>, scene: &SceneArg) -> Option<PathBuf> {
    named.map(Path::to_owned).or_else(|| camera::find(&scene.path()?))
}

/// Views along a path.
#[derive(clap::Args)]
pub(super) struct FilmArgs {
    /// Draw the frames of a camera path into a folder: a file of cameras with times, as `smalto view` writes it
    /// (docs/camera-path.md)
    #[arg(long, value_name = "FILE", conflicts_with_all = ["cameras", "camera", "split"])]
    path: Option<PathBuf>,
    /// Frames a second, of a path and of a film [default: 30]
    #[arg(long, value_name = "FPS", value_parser = parse_fps)]
    fps: Option<f64>,
}

/// Frames a second of a film.
pub(super) const DEFAULT_FPS: f64 = 30.0;
/// Most frames of a film.
const MAX_FRAMES: usize = 100_000;

impl FilmArgs {
    pub fn has_path(&self) -> bool {
        self.path.is_some()
    }

    /// Frames a second, if they were asked for.
    pub fn fps(&self) -> Option<f64> {
        self.fps
    }

    /// The frames, if a path was given.
    pub fn read(&self) -> Result<Option<Vec<NamedCamera>>> {
        let Some(file) = &self.path else { return Ok(None) };
        let timeline = Timeline::read(file).map_err(|problem| Unreadable::new(file, &problem))?;
        let frames = timeline.frames(self.fps.unwrap_or(DEFAULT_FPS));
        let count = frames.len();
        if count > MAX_FRAMES {
            let (seconds, fps) = (timeline.duration(), self.fps.unwrap_or(DEFAULT_FPS));
            let which = format!("{seconds} s of {} at {fps} frames a second", file.display());
            return Err(Usage(format!("--path: {which} are {count} frames, over {MAX_FRAMES}")).into());
        }
        Ok(Some(frames.enumerate().map(|(i, camera)| NamedCamera { name: format!("frame {i}"), camera }).collect()))
    }
}

fn parse_fps(text: &str) -> Result<f64> {
    match text.parse() {
        Ok(fps) if fps > 0.0 && fps <= 1000.0 => Ok(fps),
        _ => bail!("expected frames a second, over 0 and up to 1000"),
    }
}
