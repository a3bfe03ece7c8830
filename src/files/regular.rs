//! Regular files, opened without ever waiting for the other end of a FIFO.

use std::fs::File;
use std::io;
use std::path::Path;

use anyhow::{Result, anyhow, ensure};

use super::describe;

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
