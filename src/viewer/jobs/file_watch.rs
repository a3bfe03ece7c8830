//! Waiting for changes of scene files, to read them again.

use std::fs;
use std::path::Path;
use std::time::{Duration, SystemTime};

use anyhow::Result;

use super::Cancel;
use crate::scene::Cancelled;

/// Interval between polls of a file.
const POLL: Duration = Duration::from_millis(100);

/// Time of the last change of a file, and its size in bytes; `None` if it does not exist.
pub type FileStamp = Option<(SystemTime, u64)>;

/// The stamp of a file.
pub fn stamp(path: &Path) -> FileStamp {
    let data = fs::metadata(path).ok()?;
    Some((data.modified().ok()?, data.len()))
}

/// Waits until the file differs from `seen` and is stable: two successive polls agree.
///
/// # Errors
/// [`Cancelled`].
pub fn wait_for_change(path: &Path, seen: FileStamp, cancel: &Cancel) -> Result<()> {
    let mut before = seen;
    while !cancel.is_cancelled() {
        std::thread::sleep(POLL);
        let now = stamp(path);
        if now.is_some() && now != seen && now == before {
            return Ok(());
        }
        before = now;
    }
    Err(Cancelled.into())
}
