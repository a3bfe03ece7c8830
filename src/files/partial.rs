//! Files and folders that are not complete yet. They are removed when dropped, when a signal ends the program, and, if
//! the program was killed, by a later run.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tempfile::{Builder, NamedTempFile, TempDir};

/// What the names begin with: hidden, so that programs that read all files of a folder skip them.
const PREFIX: &str = ".smalto-";
/// What follows the random characters of the names.
const MARK: &str = ".part";

/// The age at which what a dead run left may be removed. File systems without locks do not tell whether the run lives.
const STALE: Duration = Duration::from_secs(60 * 60);

static UNFINISHED: Mutex<Unfinished> = Mutex::new(Unfinished { paths: BTreeSet::new(), swept: BTreeSet::new() });

struct Unfinished {
    /// What is to be removed when the program ends.
    paths: BTreeSet<PathBuf>,
    /// Folders from which the leavings of dead runs were removed.
    swept: BTreeSet<PathBuf>,
}

/// A file that is not complete yet.
pub(crate) struct Part {
    file: NamedTempFile,
    listed: Listed,
}

/// A folder of files that are not complete yet.
pub(crate) struct PartFolder {
    folder: TempDir,
    _listed: Listed,
    /// Holds the lock of the folder.
    _lock: Option<File>,
}

/// An entry of [`Unfinished::paths`] until dropped.
struct Listed(PathBuf);

impl Drop for Listed {
    fn drop(&mut self) {
        unfinished().paths.remove(&self.0);
    }
}

impl Part {
    /// A new file in `folder`, with a name that ends in `ending`. Only the owner may read it if it `is_private`;
    /// otherwise its mode is that of any new file.
    pub fn beside(folder: &Path, ending: &str, is_private: bool) -> io::Result<Self> {
        let mut list = unfinished();
        list.sweep(folder);
        let suffix = format!("{MARK}{ending}");
        let mut builder = Builder::new();
        builder.prefix(PREFIX).suffix(&suffix);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(fs::Permissions::from_mode(if is_private { 0o600 } else { 0o666 }));
        }
        #[cfg(not(unix))]
        let _ = is_private;
        let file = builder.tempfile_in(folder)?;
        super::is_locked(file.as_file());
        let listed = list.add(file.path());
        Ok(Self { file, listed })
    }

    pub fn path(&self) -> &Path {
        self.file.path()
    }

    pub fn file(&self) -> &File {
        self.file.as_file()
    }

    /// Renames the complete file. What was at `path` is replaced.
    pub fn persist(self, path: &Path) -> io::Result<()> {
        let Self { file, listed } = self;
        let renamed = file.persist(path);
        drop(listed);
        renamed.map(drop).map_err(|problem| problem.error)
    }
}

impl PartFolder {
    pub fn inside(folder: &Path) -> io::Result<Self> {
        let mut list = unfinished();
        list.sweep(folder);
        let folder = Builder::new().prefix(PREFIX).suffix(MARK).tempdir_in(folder)?;
        let lock = File::open(folder.path()).ok().filter(|folder| !super::is_locked(folder));
        let listed = list.add(folder.path());
        Ok(Self { folder, _listed: listed, _lock: lock })
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }
}

impl Unfinished {
    fn add(&mut self, path: &Path) -> Listed {
        self.paths.insert(path.to_owned());
        Listed(path.to_owned())
    }

    /// Removes what runs left in `folder` that were killed: it is old, and nobody holds its lock.
    fn sweep(&mut self, folder: &Path) {
        if !self.swept.insert(folder.to_owned()) {
            return;
        }
        let is_part = |name: &str| name.starts_with(PREFIX) && name.contains(MARK);
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            let Ok(data) = entry.metadata() else { continue };
            let is_stale = data.modified().is_ok_and(|at| at.elapsed().is_ok_and(|age| age > STALE));
            if !is_stale || !is_part(&entry.file_name().to_string_lossy()) || !(data.is_file() || data.is_dir()) {
                continue;
            }
            if File::open(entry.path()).is_ok_and(|file| !super::is_locked(&file)) {
                remove(&entry.path());
            }
        }
    }
}

fn remove(path: &Path) {
    // A failure leaves the file to the next run.
    _ = if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
}

fn unfinished() -> MutexGuard<'static, Unfinished> {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes all unfinished files of this process, before it ends. Until the returned guard is dropped, other threads
/// neither begin files nor notice that theirs are gone.
#[must_use]
pub fn remove_unfinished() -> impl Drop {
    let list = unfinished();
    list.paths.iter().for_each(|path| remove(path));
    list
}

/// Keeps signals from ending the program until dropped.
pub(crate) fn uninterrupted() -> impl Drop {
    unfinished()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a killed run left is removed; what may belong to a living one, or to somebody else, is not.
    #[test]
    fn leavings_of_dead_runs_are_swept() {
        let folder = tempfile::tempdir().unwrap();
        let make = |name: &str, age: Duration| {
            let path = folder.path().join(name);
            let file = File::create(&path).unwrap();
            file.set_modified(std::time::SystemTime::now() - age).unwrap();
            (path, file)
        };
        let (dead, _) = make(".smalto-aaaaaa.part.glb", 2 * STALE);
        let (living, locked) = make(".smalto-bbbbbb.part.glb", 2 * STALE);
        let (young, _) = make(".smalto-cccccc.part.glb", STALE / 2);
        let (record, _) = make(".smalto-run.jsonl", 2 * STALE);
        locked.lock().unwrap();
        let part = Part::beside(folder.path(), "", false).unwrap();
        let are_there = [&dead, &living, &young, &record].map(|path| path.exists());
        assert_eq!(are_there, [false, true, true, true]);
        // Once a folder and a process: pictures are many.
        let (later, _) = make(".smalto-dddddd.part.glb", 2 * STALE);
        drop(Part::beside(folder.path(), "", false).unwrap());
        assert!(later.exists());
        let own = part.path().to_owned();
        drop(part);
        assert!(!own.exists() && !unfinished().paths.contains(&own));
    }
}
