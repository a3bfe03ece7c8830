//! Regular files, opened without ever waiting for the other end of a FIFO.

use std::fs::{File, OpenOptions};
use std::io::{self, Read};
use std::path::Path;

use anyhow::{Result, anyhow, bail, ensure};

use super::describe;

/// Largest file that is read whole. A list of half a million cameras is not larger.
const MOST_BYTES: u64 = 256 << 20;

/// Reads a whole regular file. Anything else is refused: reading a device may never end.
///
/// # Errors
/// A clause without the file's name if `path` is not a regular file, is larger than 256 MiB, or cannot be read.
pub fn read_whole(path: &Path) -> Result<Vec<u8>> {
    content(open_regular(path)?)
}

/// The content of an open file, from its position on.
pub(super) fn content(file: File) -> Result<Vec<u8>> {
    let cannot = |error| anyhow!("cannot be read: {}", describe(&error));
    let bytes = file.metadata().map_err(cannot)?.len();
    ensure!(bytes <= MOST_BYTES, "has {bytes} bytes, at most {MOST_BYTES} are read");
    let mut content = Vec::new();
    file.take(MOST_BYTES + 1).read_to_end(&mut content).map_err(cannot)?;
    ensure!(content.len() as u64 <= MOST_BYTES, "has more than {MOST_BYTES} bytes");
    Ok(content)
}

/// Opens for reading a file whose name the program has chosen, such as a record. Where others may write into the
/// folder, a symbolic link of that name could lead to any file, so it is not followed.
///
/// # Errors
/// A clause without the file's name if there is a link or anything else but a file, or the file cannot be opened.
pub fn read_own(path: &Path) -> Result<File> {
    open_own(path, File::options().read(true))
}

/// As [`read_own`], for reading and writing.
///
/// # Errors
/// Those of [`read_own`].
pub fn write_own(path: &Path) -> Result<File> {
    open_own(path, File::options().read(true).write(true))
}

/// As [`read_own`], for reading and writing at the end. A file that does not exist is made.
///
/// # Errors
/// Those of [`read_own`].
pub fn append_own(path: &Path) -> Result<File> {
    open_own(path, File::options().read(true).append(true).create(true))
}

pub(super) fn open_own(path: &Path, options: &mut OpenOptions) -> Result<File> {
    let cannot = |error| anyhow!("cannot be opened: {}", describe(&error));
    match std::fs::symlink_metadata(path) {
        Ok(data) if data.is_symlink() => bail!("is a symbolic link, which is not followed"),
        Ok(data) if !data.is_file() => bail!("is not a file"),
        _ => {}
    }
    // The link may be made after the check.
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(options, libc::O_NOFOLLOW);
    options.open(path).map_err(cannot)
}

/// Opens a regular file for reading. A folder, a FIFO or a device is refused before it is opened: opening a FIFO may
/// never return.
///
/// # Errors
/// A clause without the file's name if `path` is not a regular file or cannot be opened.
pub fn open_regular(path: &Path) -> Result<File> {
    let cannot = |error| anyhow!("cannot be opened: {}", describe(&error));
    ensure!(std::fs::metadata(path).map_err(cannot)?.is_file(), "is not a file");
    File::open(path).map_err(cannot)
}

/// The length of a file and the BLAKE3 hash of its content, as text. `check` is called between reads and may end it.
///
/// # Errors
/// That of `check`; a clause without the file's name if it cannot be read.
pub fn hash_of(path: &Path, check: impl Fn() -> Result<()>) -> Result<(u64, String)> {
    let (mut file, mut hasher) = (open_regular(path)?, blake3::Hasher::new());
    let mut buffer = vec![0; 1 << 20];
    loop {
        check()?;
        match file.read(&mut buffer) {
            Ok(0) => return Ok((hasher.count(), hasher.finalize().to_hex().to_string())),
            Ok(read) => _ = hasher.update(&buffer[..read]),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => bail!("cannot be read: {}", describe(&error)),
        }
    }
}

/// Reads bytes at a position. Any number of threads may read from a file at the same time.
///
/// # Errors
/// If the file ends first, or cannot be read.
#[cfg(unix)]
pub fn read_exact_at(file: &File, bytes: &mut [u8], position: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, position)
}

/// Reads bytes at a position. Any number of threads may read from a file at the same time.
///
/// # Errors
/// If the file ends first, or cannot be read.
#[cfg(windows)]
pub fn read_exact_at(file: &File, mut bytes: &mut [u8], mut position: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, bytes, position) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(count) => {
                bytes = &mut std::mem::take(&mut bytes)[count..];
                position += count as u64;
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Writes bytes at a position. Any number of threads may write to a file at the same time.
///
/// # Errors
/// If the file cannot be written.
#[cfg(unix)]
pub fn write_all_at(file: &File, bytes: &[u8], position: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::write_all_at(file, bytes, position)
}

/// Writes bytes at a position. Any number of threads may write to a file at the same time.
///
/// # Errors
/// If the file cannot be written.
#[cfg(windows)]
pub fn write_all_at(file: &File, mut bytes: &[u8], mut position: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_write(file, bytes, position) {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(count) => {
                bytes = &bytes[count..];
                position += count as u64;
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}
