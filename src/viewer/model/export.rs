//! The settings for writing pictures and the frames of a path.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::viewer::jobs::Cancel;

/// Size and names of the files to write, and the progress of a job that writes them.
pub struct Export {
    /// Width and height in pixels; `None` for those of the picture in the window.
    pub size: Option<[u32; 2]>,
    pub picture: String,
    /// An .exr of the picture also contains coverage and depth.
    pub has_layers: bool,
    /// The folder for the frames of a path, or the file of its video.
    pub film: String,
    /// The fraction written, 0 to 1; `None` while nothing is written.
    pub progress: Option<f64>,
    /// The reason why the last picture or film was not written.
    pub failure: Option<String>,
    /// Cancels the job that writes.
    pub cancel: Cancel,
    /// Files assigned to pictures, which may not exist yet.
    pub assigned: BTreeSet<PathBuf>,
}

impl Export {
    /// A file for the next picture: the name that is set, relative to the working folder, or that name with the next
    /// free number if the file exists.
    pub fn next_picture(&mut self) -> PathBuf {
        self.next(&PathBuf::from(&self.picture))
    }

    /// A file or an empty folder for the next film, named like [`next_picture`](Self::next_picture).
    pub fn next_film(&mut self) -> PathBuf {
        self.next(&PathBuf::from(&self.film))
    }

    /// The video or the empty folder of this name for a film.
    ///
    /// # Errors
    /// There is no name, or the folder is not empty.
    pub fn given_film(&mut self, file: PathBuf) -> Result<PathBuf, String> {
        let file = std::path::absolute(&file).map_err(|_| "a film needs a name".to_owned())?;
        if file.is_dir() && !is_empty(&file) {
            return Err(format!("{} is a folder that is not empty", file.display()));
        }
        self.assigned.insert(file.clone());
        Ok(file)
    }

    fn next(&mut self, wanted: &Path) -> PathBuf {
        let wanted = std::path::absolute(wanted).unwrap_or_else(|_| wanted.to_owned());
        let numbered = |number: u32| {
            let stem = wanted.file_stem().unwrap_or_default().to_string_lossy();
            let ending = wanted.extension().map_or_else(String::new, |ending| format!(".{}", ending.to_string_lossy()));
            wanted.with_file_name(format!("{stem}-{number}{ending}"))
        };
        let is_free =
            |file: &PathBuf| !self.assigned.contains(file) && (file.symlink_metadata().is_err() || is_empty(file));
        let mut names = std::iter::once(wanted.clone()).chain((2..).map(numbered));
        let file = names.find(is_free).unwrap_or(wanted.clone());
        self.assigned.insert(file.clone());
        file
    }
}

fn is_empty(folder: &Path) -> bool {
    folder.read_dir().is_ok_and(|mut all| all.next().is_none())
}

impl Default for Export {
    fn default() -> Self {
        Self {
            size: None,
            picture: "view.png".to_owned(),
            has_layers: false,
            film: "film".to_owned(),
            progress: None,
            failure: None,
            cancel: Cancel::default(),
            assigned: BTreeSet::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_picture_replaces_another() {
        let folder = tempfile::tempdir().unwrap();
        let picture = folder.path().join("a.b.png").display().to_string();
        let mut export = Export { picture, ..Export::default() };
        let mut next = || export.next_picture().file_name().unwrap().to_string_lossy().into_owned();
        std::fs::write(folder.path().join("a.b-2.png"), "").unwrap();
        // The first picture is not written yet when the second file is assigned.
        assert_eq!([next(), next(), next()], ["a.b.png", "a.b-3.png", "a.b-4.png"]);
        let file = Export::default().next_picture();
        assert!(file.is_absolute() && file.ends_with("view.png"), "{}", file.display());
        // An empty folder is taken.
        let film = folder.path().join("film");
        std::fs::create_dir(&film).unwrap();
        let mut export = Export { film: film.display().to_string(), ..Export::default() };
        assert_eq!(export.next_film(), film);
        std::fs::write(film.join("00000.png"), "").unwrap();
        assert_eq!(Export { assigned: BTreeSet::new(), ..export }.next_film(), folder.path().join("film-2"));
    }
}
