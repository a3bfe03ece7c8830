//! Files and folders that are not complete yet. They are removed when dropped, when a signal ends the program, and, if
//! the program was killed, by a later run.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tempfile::{Builder, NamedTempFile, TempDir};

/// Prefix of the names: hidden, so that programs that read all files of a folder skip them.
const PREFIX: &str = ".smalto-";
/// Suffix of the names, after the random characters.
const MARK: &str = ".part";

/// The age at which files of a dead run may be removed. On file systems without locks, a running one looks dead.
const STALE: Duration = Duration::from_secs(60 * 60);

static UNFINISHED: Mutex<Unfinished> = Mutex::new(Unfinished { paths: BTreeSet::new(), cleared: BTreeSet::new() });

struct Unfinished {
    /// Files and folders to remove when the program ends.
    paths: BTreeSet<PathBuf>,
    /// Folders that were cleared of files of dead runs.
    cleared: BTreeSet<PathBuf>,
}

/// A file that is not complete yet.
pub(crate) struct PartialFile {
    file: NamedTempFile,
    registered: Registered,
}

/// A folder of files that are not complete yet.
pub(crate) struct PartialFolder {
    folder: TempDir,
    _registered: Registered,
    /// Holds the lock of the folder.
    _lock: Option<File>,
}

/// An entry of [`Unfinished::paths`] until dropped.
struct Registered(PathBuf);

impl Drop for Registered {
    fn drop(&mut self) {
        unfinished().paths.remove(&self.0);
    }
}

impl PartialFile {
    /// A new file in `folder`, with a name that ends in `ending`. Only the owner may read it if it `is_private`;
    /// otherwise its mode is that of any new file.
    pub fn beside(folder: &Path, ending: &str, is_private: bool) -> io::Result<Self> {
        let mut list = unfinished();
        list.clear_stale(folder);
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
        let registered = list.add(file.path());
        Ok(Self { file, registered })
    }

    pub fn path(&self) -> &Path {
        self.file.path()
    }

    pub fn file(&self) -> &File {
        self.file.as_file()
    }

    /// Renames the complete file to `path`, which is replaced.
    pub fn persist(self, path: &Path) -> io::Result<()> {
        let Self { file, registered } = self;
        let renamed = file.persist(path);
        drop(registered);
        renamed.map(drop).map_err(|problem| problem.error)
    }
}

impl PartialFolder {
    pub fn inside(folder: &Path) -> io::Result<Self> {
        let mut list = unfinished();
        list.clear_stale(folder);
        let folder = Builder::new().prefix(PREFIX).suffix(MARK).tempdir_in(folder)?;
        let lock = File::open(folder.path()).ok().filter(|folder| !super::is_locked(folder));
        let registered = list.add(folder.path());
        Ok(Self { folder, _registered: registered, _lock: lock })
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }
}

impl Unfinished {
    fn add(&mut self, path: &Path) -> Registered {
        self.paths.insert(path.to_owned());
        Registered(path.to_owned())
    }

    /// Removes the partial files of killed runs in `folder`: those that are old and not locked.
    fn clear_stale(&mut self, folder: &Path) {
        if !self.cleared.insert(folder.to_owned()) {
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

    /// Files that may belong to a running process or to another program are not removed.
    #[test]
    fn partial_files_of_killed_runs_are_removed() {
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
        let part = PartialFile::beside(folder.path(), "", false).unwrap();
        let exist = [&dead, &living, &young, &record].map(|path| path.exists());
        assert_eq!(exist, [false, true, true, true]);
        // Once a folder and a process: pictures are many.
        let (later, _) = make(".smalto-dddddd.part.glb", 2 * STALE);
        drop(PartialFile::beside(folder.path(), "", false).unwrap());
        assert!(later.exists());
        let own = part.path().to_owned();
        drop(part);
        assert!(!own.exists() && !unfinished().paths.contains(&own));
    }
}
