//! Files that a scene file names: they lie in its folder or below it.

use std::path::{Component, Path, PathBuf};

use anyhow::{Result, ensure};

/// The path of a file that a scene in `folder` names, like `a.bin`, `./a.bin` or `b/../a.bin`.
///
/// # Errors
/// If it is absolute, empty or leads out of the folder.
pub(crate) fn inside(folder: &Path, name: &str) -> Result<PathBuf> {
    let mut parts = Vec::new();
    let is_below = Path::new(name).components().all(|part| match part {
        Component::Normal(part) => {
            parts.push(part);
            true
        }
        Component::CurDir => true,
        Component::ParentDir => parts.pop().is_some(),
        Component::RootDir | Component::Prefix(_) => false,
    });
    // A backslash separates folders on one system only.
    let is_named = is_below && !parts.is_empty() && !name.contains('\\');
    ensure!(is_named, "'{name}' is not the name of a file in the folder of the scene");
    Ok(folder.join(parts.iter().collect::<PathBuf>()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_in_the_folder() {
        let inside = |name| inside(Path::new("a"), name).ok();
        for name in ["b", "./b", "c/../b", "c/d/../../b", "./c/./../b"] {
            assert_eq!(inside(name), Some(PathBuf::from("a/b")), "{name}");
        }
        for name in ["", ".", "..", "../b", "c/../../b", "/b", "c/..", "..\\b"] {
            assert_eq!(inside(name), None, "{name}");
        }
    }
}
