//! Atomic file writes (temporary file, then rename), writes to devices and pipes, whole-file reads, and readable I/O
//! error messages.
//!
//! - `mod` - writes of one file, checks before long work, locks
//! - `destination` - the destination of an output: a file, a device, a descriptor
//! - `partial` - incomplete files and folders, which are removed if the program ends early
//! - `batch` - several files that are written together or not at all
//! - `checkpoint` - intermediate files of long work, kept for another run
//! - `regular` - regular files: opening, whole reads, reads and writes at a position
//! - `scratch` - temporary files without a name

mod batch;
mod checkpoint;
mod destination;
mod partial;
mod regular;
mod scratch;

use std::cell::Cell;
use std::fs::{File, TryLockError};
use std::io::{self, BufWriter, ErrorKind, Seek, SeekFrom, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, Error, Result, anyhow, ensure};

pub use batch::{write_batch, write_new, write_tree};
pub use checkpoint::Checkpoint;
pub(crate) use partial::PartialFolder;
pub use partial::remove_unfinished;
pub use regular::{append_own, hash_of, open_regular, read_exact_at, read_own, read_whole, write_all_at, write_own};
pub use scratch::{Scratch, is_full};

use destination::Destination;

/// The writer of a file.
pub type Writer<'f> = BufWriter<Watched<'f>>;

thread_local! {
    static IN_WRITES: Cell<Duration> = const { Cell::new(Duration::ZERO) };
}

/// The time that this thread has spent in writing files, as opposed to making their content.
pub fn time_in_writes() -> Duration {
    IN_WRITES.get()
}

/// Adds the time of `write` to [`time_in_writes`].
fn timed<T>(write: impl FnOnce() -> T) -> T {
    let started = Instant::now();
    let outcome = write();
    IN_WRITES.set(IN_WRITES.get() + started.elapsed());
    outcome
}

/// A file that keeps the reason of a failed write. Encoders wrap the reason in texts of their own.
pub struct Watched<'f> {
    file: &'f File,
    failure: Option<String>,
}

/// Writes a file under a temporary name in its folder and renames it when it is complete.
///
/// - A file that is replaced keeps its mode and, where permitted, its owner and group.
/// - A symbolic link stays: the file it leads to is replaced, or made if there is none.
/// - A device, a FIFO or an open descriptor such as /dev/stdout is not replaced: the complete content is copied into
///   it. `-` is standard output. A reader that closes it before it has all is an error.
/// - A file that its owner may not write is refused, even to root.
///
/// # Errors
/// If the temporary file cannot be made, written or renamed, or `write` fails. A file that was at `path` is then
/// unchanged.
pub fn write_whole(path: &Path, write: impl FnOnce(&mut Writer) -> Result<()>) -> Result<()> {
    write_checked(path, "", write, |_| Ok(()))
}

/// Like [`write_whole`], but renames or copies the file only if `check` accepts it. `check` gets the path of the
/// complete temporary file, whose name ends in `ending`, and its result is returned.
///
/// # Errors
/// Those of [`write_whole`], and those of `check`.
pub fn write_checked<T>(
    path: &Path,
    ending: &str,
    write: impl FnOnce(&mut Writer) -> Result<()>,
    check: impl FnOnce(&Path) -> Result<T>,
) -> Result<T> {
    let attempt = || -> Result<T> {
        let destination = Destination::of(path)?;
        let partial = timed(|| destination.partial_file(ending))?;
        fill(partial.file(), write)?;
        let found = check(partial.path())?;
        timed(|| destination.commit(partial))?;
        Ok(found)
    };
    attempt().with_context(|| cannot_write(path))
}

/// Writes into `file`. If the file system fails, the error is its own and not that of an encoder.
fn fill(file: &File, write: impl FnOnce(&mut Writer) -> Result<()>) -> Result<()> {
    let mut writer = BufWriter::new(Watched { file, failure: None });
    let written = write(&mut writer).and_then(|()| Ok(writer.flush()?));
    let (watched, _) = writer.into_parts();
    written.map_err(|error| watched.failure.map_or(error, Error::msg))
}

/// Checks before a long computation that its result can be written to `path`.
///
/// # Errors
/// If `path` is a folder or read-only, or [`write_whole`] could not make its temporary file.
pub fn check_writable(path: &Path) -> Result<()> {
    Destination::of(path)
        .and_then(|destination| destination.partial_file(""))
        .map(drop)
        .with_context(|| cannot_write(path))
}

/// Like [`check_writable`], for content that is not text.
///
/// # Errors
/// Those of [`check_writable`], and if `path` is a terminal.
pub fn check_binary_writable(path: &Path) -> Result<()> {
    check_writable(path)?;
    ensure!(
        !Destination::of(path)?.is_terminal(),
        "{}: not text, which a terminal cannot show: write to a file or a pipe",
        cannot_write(path)
    );
    Ok(())
}

/// Checks that nothing would be overwritten at `path`, for `--no-clobber`. Devices and pipes hold nothing to overwrite.
///
/// # Errors
/// If there is a file.
pub fn check_absent(path: &Path) -> Result<()> {
    let exists = matches!(Destination::of(path), Ok(Destination::File { old: Some(_), .. }) | Err(_)) && path.exists();
    ensure!(!exists, "{}: it exists, and --no-clobber keeps what exists", cannot_write(path));
    Ok(())
}

/// True if what is written to `path` appears on the standard output of the program: `-`, /dev/stdout and its like.
pub fn is_stdout(path: &Path) -> bool {
    matches!(Destination::of(path), Ok(Destination::Stdout))
}

/// Locks an open file or folder against other runs of this program, until it is closed or the process ends.
///
/// # Errors
/// If another run has locked it. Where the file system has no locks, nothing is locked.
pub fn lock(file: &File) -> Result<()> {
    ensure!(!is_locked(file), "another run of smalto is writing there");
    Ok(())
}

/// True if another run holds the lock of a file or folder. Otherwise this one holds it now.
fn is_locked(file: &File) -> bool {
    matches!(file.try_lock(), Err(TryLockError::WouldBlock))
}

/// A path as text of a report. A byte that is not UTF-8 stands as `\xHH`.
pub fn text_of(path: &Path) -> String {
    let chunks = path.as_os_str().as_encoded_bytes().utf8_chunks();
    chunks.map(|chunk| format!("{}{}", chunk.valid(), chunk.invalid().escape_ascii())).collect()
}

/// Makes a folder and those above it.
///
/// # Errors
/// If one of them cannot be made.
pub fn make_folder(folder: &Path) -> Result<()> {
    let made = std::fs::create_dir_all(folder);
    made.map_err(|e| anyhow!("cannot make the folder {}: {}", folder.display(), describe(&e)))
}

/// The message of an I/O error without the error number of the operating system.
pub fn describe(error: &io::Error) -> String {
    match error.kind() {
        ErrorKind::NotFound => "there is no such file".to_owned(),
        ErrorKind::PermissionDenied => "permission denied".to_owned(),
        ErrorKind::BrokenPipe => "its reader has closed it".to_owned(),
        _ => {
            let text = error.to_string();
            text.split_once(" (os error").map_or(text.as_str(), |(message, _)| message).to_owned()
        }
    }
}

fn described(error: &io::Error) -> Error {
    Error::msg(describe(error))
}

fn cannot_write(path: &Path) -> String {
    format!(
        "cannot write {}",
        if path == Path::new(destination::STDOUT) { "to standard output".into() } else { path.display().to_string() }
    )
}

impl Watched<'_> {
    fn noted<T>(&mut self, outcome: io::Result<T>) -> io::Result<T> {
        if let Err(error) = &outcome
            && error.kind() != ErrorKind::Interrupted
        {
            self.failure.get_or_insert_with(|| describe(error));
        }
        outcome
    }
}

impl Write for Watched<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let outcome = timed(|| self.file.write(bytes));
        self.noted(outcome)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for Watched<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let outcome = self.file.seek(to);
        self.noted(outcome)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_does_not_name_the_temporary_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("none/a.png");
        let expected = format!("cannot write {}: there is no such folder", path.display());
        assert_eq!(format!("{:#}", check_writable(&path).unwrap_err()), expected);
    }

    #[test]
    fn a_failed_write_leaves_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        std::fs::write(&path, "old").unwrap();
        let result = write_whole(&path, |file| {
            file.write_all(b"half")?;
            anyhow::bail!("no")
        });
        assert!(result.is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    /// A file that is open for reading only fails as a full disk does, whichever encoder writes to it.
    #[test]
    fn an_error_of_the_file_replaces_that_of_an_encoder() {
        let file = File::open(file!()).unwrap();
        let error =
            fill(&file, |out| out.write_all(&[0; 1 << 16]).map_err(|e| anyhow!("Format error decoding X: {e:?}: {e}")));
        assert_eq!(format!("{:#}", error.unwrap_err()), "Bad file descriptor");
    }
}
