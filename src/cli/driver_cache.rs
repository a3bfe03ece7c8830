//! The folder in which Mesa's drivers cache shaders. They map a file of it into memory, so that where its blocks cannot
//! be allocated, SIGBUS ends the program without a word.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use super::remark;
use crate::files::is_full;

/// Turns the drivers' cache off.
const OFF: &str = "MESA_SHADER_CACHE_DISABLE";

/// A change of the environment that the drivers need.
#[derive(Debug, PartialEq)]
enum Change {
    /// `XDG_CACHE_HOME` is not an absolute path and thus has no meaning by the specification of these folders. Mesa
    /// would make it in the working folder.
    WithoutCacheHome,
    /// There is no room in this folder.
    WithoutCache(PathBuf),
}

/// Starts the program again where the drivers need another environment: a process with threads cannot safely change its
/// own. Must be called before anything is read or written.
#[cfg(unix)]
pub(super) fn suit_environment() {
    use std::os::unix::process::CommandExt;

    let get = |name: &str| std::env::var_os(name);
    let Some(change) = needed(get, dirs::home_dir(), is_full) else { return };
    let Ok(program) = std::env::current_exe() else { return };
    let mut again = std::process::Command::new(program);
    let mut arguments = std::env::args_os();
    if let Some(name) = arguments.next() {
        again.arg0(name);
    }
    again.args(arguments);
    match change {
        Change::WithoutCacheHome => again.env_remove("XDG_CACHE_HOME"),
        Change::WithoutCache(folder) => {
            let folder = folder.display();
            remark(&format!("note: there is no free space in {folder}: drivers cache no shaders ({OFF}=true)"));
            again.env(OFF, "true")
        }
    };
    // A failure leaves the environment as it is.
    _ = again.exec();
}

#[cfg(not(unix))]
pub(super) fn suit_environment() {}

fn needed(
    get: impl Fn(&str) -> Option<OsString>,
    home: Option<PathBuf>,
    is_full: impl Fn(&Path) -> bool,
) -> Option<Change> {
    let path = |name: &str| get(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let cache_home = path("XDG_CACHE_HOME");
    if cache_home.as_ref().is_some_and(|folder| folder.is_relative()) {
        return Some(Change::WithoutCacheHome);
    }
    if get(OFF).is_some() {
        return None;
    }
    let folder = path("MESA_SHADER_CACHE_DIR").or(cache_home).or_else(|| Some(home?.join(".cache")))?;
    let existing = folder.ancestors().find(|folder| folder.is_dir())?;
    is_full(existing).then(|| Change::WithoutCache(folder.clone()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_environment_changes_for_a_full_or_relative_cache_folder_only() {
        let folder = tempfile::tempdir().unwrap();
        let (full, other) = (folder.path().join("full"), folder.path().join("other"));
        std::fs::create_dir_all(&full).unwrap();
        std::fs::create_dir_all(&other).unwrap();
        let needed = |values: &[(&str, &Path)]| {
            let get = |name: &str| values.iter().find(|(key, _)| *key == name).map(|(_, value)| value.into());
            needed(get, Some(folder.path().to_owned()), |folder| folder.starts_with(&full))
        };
        let inside = full.join("not/yet/made");
        assert_eq!(needed(&[]), None);
        assert_eq!(needed(&[("XDG_CACHE_HOME", &other)]), None);
        assert_eq!(needed(&[("XDG_CACHE_HOME", &inside)]), Some(Change::WithoutCache(inside.clone())));
        assert_eq!(needed(&[("XDG_CACHE_HOME", &full), ("MESA_SHADER_CACHE_DIR", &other)]), None);
        assert_eq!(needed(&[("XDG_CACHE_HOME", &full), (OFF, "true".as_ref())]), None);
        assert_eq!(needed(&[("XDG_CACHE_HOME", "relative".as_ref())]), Some(Change::WithoutCacheHome));
    }
}
