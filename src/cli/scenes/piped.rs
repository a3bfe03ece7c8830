//! Scenes from standard input and other pipes. Readers need the whole file, so it is kept in a temporary one.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use tempfile::NamedTempFile;

use crate::files::describe;
use crate::formats::Reading;
use crate::pagefile;
use crate::scene::{NoLevel, Scene, Unreadable, Watch};

/// True for `-` and for a FIFO, like that of `<(...)`.
pub fn is_piped(path: &Path) -> bool {
    path == Path::new("-") || std::fs::metadata(path).is_ok_and(|file| is_fifo(&file))
}

#[cfg(unix)]
fn is_fifo(file: &std::fs::Metadata) -> bool {
    use std::os::unix::fs::FileTypeExt;
    file.file_type().is_fifo()
}

#[cfg(not(unix))]
fn is_fifo(_: &std::fs::Metadata) -> bool {
    false
}

/// Reads a scene whose format can be recognized by its content. Errors name `path`.
pub fn read(path: &Path, reading: &Reading, progress: &dyn Fn(f64)) -> Result<Scene> {
    let name = || if path == Path::new("-") { "standard input".to_owned() } else { path.display().to_string() };
    let unreadable =
        |error: io::Error| Unreadable { path: name(), problem: format!("cannot be read: {}", describe(&error)) };
    let mut file = NamedTempFile::new().context("cannot make a temporary file for the scene")?;
    let from: &mut dyn io::Read =
        if path == Path::new("-") { &mut io::stdin().lock() } else { &mut File::open(path).map_err(unreadable)? };
    io::copy(from, &mut file).with_context(|| format!("{}: cannot be copied to a temporary file", name()))?;
    let watch = Watch::of_progress(progress);
    pagefile::read(reading, &kept(&file), &watch).map_err(|error| {
        let error = match error.downcast::<NoLevel>() {
            Ok(NoLevel { problem, .. }) => return NoLevel { path: name(), problem }.into(),
            Err(error) => error,
        };
        match error.downcast::<Unreadable>() {
            Ok(Unreadable { problem, .. }) => Unreadable { path: name(), problem }.into(),
            Err(error) => error,
        }
    })
}

/// The path of the temporary file. Its name is removed at once where the system has paths for open files, so that an
/// interrupted run leaves nothing.
fn kept(file: &NamedTempFile) -> PathBuf {
    #[cfg(target_os = "linux")]
    {
        use std::os::fd::AsRawFd;
        _ = std::fs::remove_file(file.path());
        PathBuf::from(format!("/proc/self/fd/{}", file.as_raw_fd()))
    }
    #[cfg(not(target_os = "linux"))]
    file.path().to_owned()
}
