//! The photographs of cameras: pictures in a folder, found by the names of the cameras.

use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow, ensure};

use crate::camera::NamedCamera;
use crate::files::describe;

/// File extensions of photographs.
const ENDINGS: [&str; 5] = ["jpg", "jpeg", "png", "exr", "npy"];

/// Levels of subfolders in which photographs are searched.
const DEPTH: u32 = 4;

/// Folders above a camera file whose subfolder `images` is searched.
const LEVELS_UP: usize = 3;

/// The photographs in a folder and its subfolders.
#[derive(Debug)]
pub struct Photographs {
    pub folder: PathBuf,
    /// Files by path in the folder, without extension.
    files: BTreeMap<PathBuf, PathBuf>,
    /// Files by name without folder and extension; `None` if the name is ambiguous.
    by_name: BTreeMap<OsString, Option<PathBuf>>,
}

/// The path without the extension of a photograph.
fn stem(path: &Path) -> PathBuf {
    if is_photograph(path) { path.with_extension("") } else { path.to_owned() }
}

/// True if a file has the extension of a photograph.
pub fn is_photograph(path: &Path) -> bool {
    let has = |ending: &OsStr| ENDINGS.iter().any(|known| ending.eq_ignore_ascii_case(known));
    path.extension().is_some_and(has)
}

/// True if the folder itself contains photographs.
pub fn holds_photographs(folder: &Path) -> bool {
    let files = folder.read_dir().into_iter().flatten().flatten();
    files.map(|entry| entry.path()).any(|file| is_photograph(&file) && file.is_file())
}

/// Index of the camera with the name of the file; `None` if there is none, or several.
pub fn camera_of(file: &Path, cameras: &[NamedCamera]) -> Option<usize> {
    let name = stem(Path::new(file.file_name()?));
    let is_it = |camera: &NamedCamera| stem(Path::new(&camera.name)).file_name() == Some(name.as_os_str());
    let mut found = cameras.iter().enumerate().filter(|(_, camera)| is_it(camera));
    found.next().map(|(index, _)| index).filter(|_| found.next().is_none())
}

impl Photographs {
    /// Finds the photographs in a folder and its subfolders.
    ///
    /// # Errors
    /// The folder cannot be read, or contains no photographs. The sentence does not name the folder.
    pub fn read(folder: &Path) -> Result<Self> {
        let mut found = Self { folder: folder.to_owned(), files: BTreeMap::new(), by_name: BTreeMap::new() };
        found.add(Path::new(""), DEPTH)?;
        ensure!(!found.files.is_empty(), "holds no photographs");
        Ok(found)
    }

    /// Finds photographs in a folder `images` beside a camera file, the layout of COLMAP and many data sets.
    pub fn beside(cameras: &Path) -> Option<Self> {
        let folders = cameras.ancestors().skip(usize::from(cameras.is_file())).take(LEVELS_UP);
        folders.map(|folder| folder.join("images")).find_map(|folder| Self::read(&folder).ok())
    }

    fn add(&mut self, below: &Path, depth: u32) -> Result<()> {
        let entries = self.folder.join(below).read_dir();
        let entries = entries.map_err(|problem| anyhow!("cannot be read: {}", describe(&problem)))?;
        for entry in entries.flatten() {
            let name = below.join(entry.file_name());
            // Links to folders are not followed: they may form a cycle.
            if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                if depth > 0 {
                    self.add(&name, depth - 1)?;
                }
            } else if is_photograph(&name) {
                let (stem, file) = (name.with_extension(""), self.folder.join(&name));
                let own = stem.file_name().unwrap_or_default().to_owned();
                self.by_name.entry(own).and_modify(|several| *several = None).or_insert_with(|| Some(file.clone()));
                self.files.insert(stem, file);
            }
        }
        Ok(())
    }

    /// The photograph of a camera: by name and folder, or else by an unambiguous name.
    pub fn of(&self, camera: &NamedCamera) -> Option<&Path> {
        let wanted = stem(Path::new(&camera.name));
        let by_name = || self.by_name.get(wanted.file_name()?)?.as_ref();
        self.files.get(&wanted).or_else(by_name).map(PathBuf::as_path)
    }

    /// Number of cameras that have a photograph.
    pub fn count_of(&self, cameras: &[NamedCamera]) -> usize {
        cameras.iter().filter(|camera| self.of(camera).is_some()).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;

    fn camera(name: &str) -> NamedCamera {
        NamedCamera::new(name.to_owned(), Camera::framing(glam::DVec3::ZERO, 1.0, [8, 8]))
    }

    #[test]
    fn photographs_are_found_by_the_names_of_cameras() {
        let folder = tempfile::tempdir().unwrap();
        let images = folder.path().join("images");
        for file in ["a.JPG", "b.0001.png", "left/c.png", "right/c.png", "left/d.png", "notes.txt"] {
            let file = images.join(file);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            std::fs::write(file, "").unwrap();
        }
        let sparse = folder.path().join("sparse/0");
        std::fs::create_dir_all(&sparse).unwrap();
        let photographs = Photographs::beside(&sparse).unwrap();
        let of = |name: &str| {
            let file = photographs.of(&camera(name))?;
            Some(file.strip_prefix(&images).unwrap().display().to_string())
        };
        for (name, file) in [
            ("a.jpg", Some("a.JPG")),
            ("a", Some("a.JPG")),
            ("b.0001", Some("b.0001.png")),
            ("b.0002", None),
            ("left/c.jpg", Some("left/c.png")),
            ("c.png", None),
            ("d", Some("left/d.png")),
            ("notes", None),
        ] {
            assert_eq!(of(name).as_deref(), file, "{name}");
        }
        assert_eq!(photographs.count_of(&[camera("a"), camera("x"), camera("d")]), 2);
        let cameras = [camera("x/a.png"), camera("left/c"), camera("right/c")];
        assert_eq!(camera_of(Path::new("/tmp/a.jpg"), &cameras), Some(0));
        assert_eq!(camera_of(Path::new("c.png"), &cameras), None, "two cameras have that name");
        assert!(Photographs::read(&sparse).is_err() && !holds_photographs(&sparse) && holds_photographs(&images));
    }
}
