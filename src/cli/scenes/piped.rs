//! Scenes from standard input and other pipes. Readers need the whole file, so it is copied to a temporary one.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use anyhow::{Context, Result};

use crate::files::{Scratch, describe};
use crate::formats::{Reading, SIGNATURE_BYTES, check_recognized};
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
    let copy = copy_of(path, &name())?;
    let watch = Watch::of_progress(progress);
    pagefile::read(reading, &copy.path(), &watch).map_err(|error| {
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

/// A copy of what a pipe holds, if its first bytes are those of a scene. A pipe without an end is thus refused at once.
/// Errors name `name`.
fn copy_of(path: &Path, name: &str) -> Result<Scratch> {
    let unreadable = |problem: String| Unreadable { path: name.to_owned(), problem };
    let cannot_read = |error: io::Error| unreadable(format!("cannot be read: {}", describe(&error)));
    let from: &mut dyn Read =
        if path == Path::new("-") { &mut io::stdin().lock() } else { &mut File::open(path).map_err(cannot_read)? };
    let mut begin = Vec::new();
    from.take(SIGNATURE_BYTES as u64).read_to_end(&mut begin).map_err(cannot_read)?;
    check_recognized(&begin).map_err(|problem| unreadable(problem.to_string()))?;
    Scratch::of(&mut begin.as_slice().chain(from)).with_context(|| name.to_owned())
}
