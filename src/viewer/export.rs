//! The settings for writing pictures and the frames of a path.

use std::collections::BTreeSet;
use std::path::PathBuf;

/// Size and names of the files to write, and the progress of a job that writes them.
pub struct Export {
    /// Width and height in pixels; `None` for those of the picture in the window.
    pub size: Option<[u32; 2]>,
    pub picture: String,
    /// The folder for the frames of a path.
    pub folder: String,
    /// The fraction written, 0 to 1; `None` while nothing is written.
    pub progress: Option<f64>,
    /// The files of pictures that are being written.
    pub given: BTreeSet<PathBuf>,
}

impl Export {
    /// A file for the next picture, in the working folder if it names no other: the name that is set or, where there is
    /// a file already, that name with the next number that is free.
    pub fn next_picture(&mut self) -> PathBuf {
        let wanted = PathBuf::from(&self.picture);
        let wanted = std::path::absolute(&wanted).unwrap_or(wanted);
        let numbered = |number: u32| {
            let stem = wanted.file_stem().unwrap_or_default().to_string_lossy();
            let ending = wanted.extension().map_or_else(String::new, |ending| format!(".{}", ending.to_string_lossy()));
            wanted.with_file_name(format!("{stem}-{number}{ending}"))
        };
        let is_free = |file: &PathBuf| !self.given.contains(file) && file.symlink_metadata().is_err();
        let mut names = std::iter::once(wanted.clone()).chain((2..).map(numbered));
        let file = names.find(is_free).unwrap_or(wanted);
        self.given.insert(file.clone());
        file
    }
}

impl Default for Export {
    fn default() -> Self {
        Self {
            size: None,
            picture: "view.png".to_owned(),
            folder: "film".to_owned(),
            progress: None,
            given: BTreeSet::new(),
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
        // The first is not written yet when the second is asked for.
        assert_eq!([next(), next(), next()], ["a.b.png", "a.b-3.png", "a.b-4.png"]);
        let file = Export::default().next_picture();
        assert!(file.is_absolute() && file.ends_with("view.png"), "{}", file.display());
    }
}
