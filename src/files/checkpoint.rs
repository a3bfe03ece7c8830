//! Checkpoints: a folder beside an output in which long work keeps its intermediate files, so that another run can
//! resume it.

use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Error, Result, anyhow};

use super::destination::{Destination, keep_attributes};
use super::regular::{content, open_own};
use super::{cannot_write, described, lock, read_own};

/// A folder of unfinished work, locked against other runs. It remains if the program ends before the work is done, or
/// fails after the state of the work was saved.
pub struct Checkpoint {
    folder: PathBuf,
    /// The name of the file without which the others are of no use.
    state: &'static str,
    /// The output, and its metadata if there is one already.
    output: PathBuf,
    old: Option<fs::Metadata>,
    lock: File,
}

/// The file that marks a folder of unfinished work.
const MARK: &str = "unfinished";

/// True if a folder was made for unfinished work. Other folders are never cleared.
fn is_own(folder: &Path) -> bool {
    let is_folder = folder.symlink_metadata().is_ok_and(|data| data.is_dir());
    let is_empty = || fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_none());
    is_folder && (folder.join(MARK).is_file() || is_empty())
}

impl Checkpoint {
    /// Opens or makes the checkpoint of `output`. Its folder is removed on drop unless it has the file `state`.
    ///
    /// # Errors
    /// If `output` is not a regular file, may not be replaced, or another run works on it.
    pub fn beside(output: &Path, state: &'static str) -> Result<Self> {
        let opened = || -> Result<Self> {
            let Destination::File { path, old } = Destination::of(output)? else {
                return Err(anyhow!("it is no regular file, and this format is not written in one piece"));
            };
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let folder = path.with_file_name(format!(".{name}.unfinished"));
            match fs::create_dir(&folder) {
                Ok(()) => _ = File::create(folder.join(MARK)).map_err(|error| described(&error))?,
                Err(error) => match error.kind() {
                    ErrorKind::AlreadyExists if is_own(&folder) => {}
                    ErrorKind::AlreadyExists => {
                        return Err(anyhow!("{} is in the way: remove or rename it", folder.display()));
                    }
                    ErrorKind::NotFound => return Err(Error::msg("there is no such folder")),
                    _ => return Err(described(&error)),
                },
            }
            let lock_of = File::open(&folder).map_err(|error| described(&error))?;
            lock(&lock_of)?;
            Ok(Self { folder, state, output: path, old, lock: lock_of })
        };
        opened().map_err(|problem| problem.context(cannot_write(output)))
    }

    /// Reads a file that an earlier run saved, if it exists.
    pub fn read(&self, name: &str) -> Option<Vec<u8>> {
        read_own(&self.folder.join(name)).and_then(content).ok()
    }

    /// Saves a small file atomically.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn save(&self, name: &str, content: &[u8]) -> Result<()> {
        let part = format!("{name}.new");
        let mut file = self.open(&part, File::options().write(true).create(true).truncate(true))?;
        let written = file.write_all(content).and_then(|()| {
            file.sync_data()?;
            fs::rename(self.folder.join(part), self.folder.join(name))
        });
        written.map_err(|error| self.failed(&error))
    }

    /// Opens a file for reading and writing: as an earlier run left it, or empty.
    ///
    /// # Errors
    /// If it cannot be opened or made.
    pub fn file(&self, name: &str) -> Result<File> {
        self.open(name, File::options().read(true).write(true).create(true).truncate(false))
    }

    fn open(&self, name: &str, options: &mut OpenOptions) -> Result<File> {
        let path = self.folder.join(name);
        open_own(&path, options).with_context(|| path.display().to_string()).with_context(|| cannot_write(&self.output))
    }

    /// Removes a file, if it exists.
    pub fn remove(&self, name: &str) {
        // A file that cannot be removed is removed with the folder.
        _ = fs::remove_file(self.folder.join(name));
    }

    /// Removes all files.
    ///
    /// # Errors
    /// If one of them cannot be removed.
    pub fn clear(&self) -> Result<()> {
        let entries = fs::read_dir(&self.folder).map_err(|error| self.failed(&error))?;
        for entry in entries {
            let removed = entry.and_then(|entry| match entry.file_name() == MARK {
                true => Ok(()),
                false => fs::remove_file(entry.path()),
            });
            removed.map_err(|error| self.failed(&error))?;
        }
        Ok(())
    }

    /// Replaces the output by the complete file `name`, and removes the folder. A file that is replaced keeps its mode
    /// and, where permitted, its owner.
    ///
    /// # Errors
    /// If the output cannot be written.
    pub fn finish(self, name: &str) -> Result<()> {
        let file = self.open(name, File::options().read(true))?;
        let finished = || -> io::Result<()> {
            let part = self.folder.join(name);
            if let Some(old) = &self.old {
                keep_attributes(&file, old)?;
            }
            file.sync_all()?;
            fs::rename(part, &self.output)
        };
        finished().map_err(|error| self.failed(&error))?;
        self.remove(self.state);
        Ok(())
    }

    /// The path of the output.
    pub fn output(&self) -> &Path {
        &self.output
    }

    /// The path of a file of the checkpoint.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// The error of a failed write to the output.
    pub fn failed(&self, error: &io::Error) -> Error {
        described(error).context(cannot_write(&self.output))
    }
}

impl Drop for Checkpoint {
    fn drop(&mut self) {
        if !self.folder.join(self.state).exists() {
            // If this fails, the next run removes the folder.
            _ = fs::remove_dir_all(&self.folder);
        }
        // A program that another thread starts in this moment holds a copy of the file until it has begun.
        _ = self.lock.unlock();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A started program holds copies of all files until it has begun.
    #[test]
    fn unfinished_work_is_free_although_its_lock_has_a_copy() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("a.smalto");
        let checkpoint = Checkpoint::beside(&output, "state").unwrap();
        assert!(Checkpoint::beside(&output, "state").is_err());
        checkpoint.save("state", b"1").unwrap();
        let copy = checkpoint.lock.try_clone().unwrap();
        drop(checkpoint);
        assert_eq!(Checkpoint::beside(&output, "state").unwrap().read("state").unwrap(), b"1");
        drop(copy);
    }
}
