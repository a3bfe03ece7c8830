//! Regular files, opened without ever waiting for the other end of a FIFO.

use std::fs::File;
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
