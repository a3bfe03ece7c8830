//! Temporary files without a name: content that arrives from a pipe and must be read at any position, and trials.

use std::fs::File;
use std::io::{self, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Error, Result, ensure};

use super::describe;

/// A temporary file in the system's folder of temporary files. On Linux it never has a name, so that nothing of it
/// remains, however the program ends.
pub struct Scratch {
    #[cfg(target_os = "linux")]
    file: File,
    #[cfg(not(target_os = "linux"))]
    part: super::partial::PartialFile,
}

impl Scratch {
    /// Copies all that `from` holds, if the file system then keeps a tenth of its free space.
    ///
    /// # Errors
    /// A clause without a name if `from` is longer, or the copy fails.
    pub fn of(from: &mut dyn Read) -> Result<Self> {
        let folder = std::env::temp_dir();
        let failed = |error: io::Error| {
            Error::msg(format!("cannot be copied to a temporary file in {}: {}", folder.display(), describe(&error)))
        };
        #[cfg(target_os = "linux")]
        let scratch = Self { file: tempfile::tempfile_in(&folder).map_err(failed)? };
        #[cfg(not(target_os = "linux"))]
        let scratch = Self { part: super::partial::PartialFile::beside(&folder, "", true).map_err(failed)? };
        let limit = free_bytes(scratch.file()).map_err(failed)? / 10 * 9;
        let copied = io::copy(&mut from.take(limit.saturating_add(1)), &mut scratch.file()).map_err(failed)?;
        ensure!(
            copied <= limit,
            "is longer than {limit} bytes, nine tenths of the free space in {}, where it is copied to; TMPDIR names \
             another folder",
            folder.display()
        );
        Ok(scratch)
    }

    fn file(&self) -> &File {
        #[cfg(target_os = "linux")]
        return &self.file;
        #[cfg(not(target_os = "linux"))]
        self.part.file()
    }

    /// A path that opens the file while this exists.
    pub fn path(&self) -> PathBuf {
        #[cfg(target_os = "linux")]
        return format!("/proc/self/fd/{}", std::os::fd::AsRawFd::as_raw_fd(&self.file)).into();
        #[cfg(not(target_os = "linux"))]
        self.part.path().to_owned()
    }
}

/// True if a few megabytes cannot be written into a folder because its file system, or the user's quota, is full.
pub fn is_full(folder: &Path) -> bool {
    // Mesa's index of shaders has 1.3 MB.
    const BYTES: usize = 2 << 20;
    let written = tempfile::tempfile_in(folder).and_then(|mut file| file.write_all(&vec![0; BYTES]));
    written.is_err_and(|error| matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded))
}

/// The bytes that this user may still write to the file system of a file.
#[cfg(unix)]
fn free_bytes(file: &File) -> io::Result<u64> {
    let found = rustix::fs::fstatvfs(file)?;
    Ok(found.f_bavail.saturating_mul(found.f_frsize))
}

#[cfg(not(unix))]
fn free_bytes(_: &File) -> io::Result<u64> {
    Ok(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_copy_is_read_by_its_path_and_has_no_name() {
        let scratch = Scratch::of(&mut &b"content"[..]).unwrap();
        assert_eq!(std::fs::read(scratch.path()).unwrap(), b"content");
        #[cfg(target_os = "linux")]
        assert!(std::fs::read_link(scratch.path()).unwrap().to_string_lossy().ends_with("(deleted)"));
    }
}
