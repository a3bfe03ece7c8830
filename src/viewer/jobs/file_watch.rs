//! Scene files that are read again when they change.

use std::fs;
use std::path::Path;
use std::time::{Duration, SystemTime};

use anyhow::Result;

use super::Cancel;
use crate::scene::Cancelled;

/// How often a file is looked at.
const POLL: Duration = Duration::from_millis(100);

/// When a file was changed, and its bytes; `None` if it is not there.
pub type Stamp = Option<(SystemTime, u64)>;

/// The stamp of a file.
pub fn stamp(path: &Path) -> Stamp {
    let data = fs::metadata(path).ok()?;
    Some((data.modified().ok()?, data.len()))
}

/// Waits until a file is there that is not as it was `seen`, and that nobody writes any more: two looks find the same.
///
/// # Errors
/// [`Cancelled`].
pub fn wait_for_change(path: &Path, seen: Stamp, cancel: &Cancel) -> Result<()> {
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
