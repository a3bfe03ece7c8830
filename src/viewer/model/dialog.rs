//! Dialogs in which the user selects files to open or to save.

use std::path::PathBuf;

use egui_file_dialog::{DialogState, FileDialog};

use crate::formats::{FORMATS, Format, labels};

/// The content of a file to save.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Saved {
    /// The state of the window, to resume work from.
    Project,
    /// The scenes joined in one file.
    Scene,
}

/// Dialogs for selecting files, open or closed.
pub struct Dialog {
    files: FileDialog,
    place: FileDialog,
    saved: Saved,
}

/// A file that the user selected.
pub enum Chosen {
    Open(PathBuf),
    Save(Saved, PathBuf),
}

impl Default for Dialog {
    fn default() -> Self {
        let files = FileDialog::new()
            .title("Open scenes, cameras or a picture to compare with")
            .add_file_filter_extensions("Scenes", extensions())
            .default_file_filter("Scenes")
            .as_modal(true);
        let place = FileDialog::new().allow_path_edit_to_save_file_without_extension(true).as_modal(true);
        Self { files, place, saved: Saved::Project }
    }
}

impl Dialog {
    /// Opens the dialog for files to open.
    pub fn ask(&mut self) {
        self.files.pick_multiple();
    }

    /// Opens the dialog for a file to save.
    pub fn ask_where(&mut self, saved: Saved) {
        let (title, name) = match saved {
            Saved::Project => ("Save a project: NAME.project.json".to_owned(), "scene.project.json"),
            Saved::Scene => (format!("Save the scene: {}", labels(Format::is_written_file)), "edited.ply"),
        };
        self.saved = saved;
        self.place.config_mut().title = Some(title);
        self.place.config_mut().default_file_name = name.to_owned();
        self.place.save_file();
    }

    pub fn is_open(&self) -> bool {
        [&self.files, &self.place].iter().any(|dialog| *dialog.state() == DialogState::Open)
    }

    /// Draws open dialogs. Returns each selected file once.
    pub fn show(&mut self, context: &egui::Context) -> Vec<Chosen> {
        self.files.update(context);
        self.place.update(context);
        let open = self.files.take_picked_multiple().unwrap_or_default().into_iter().map(Chosen::Open);
        let saved = self.saved;
        open.chain(self.place.take_picked().map(|file| Chosen::Save(saved, file))).collect()
    }
}

/// The last extensions of all scene files.
fn extensions() -> Vec<&'static str> {
    let mut all: Vec<&str> = FORMATS.iter().map(|format| format.name.rsplit('.').next().unwrap_or_default()).collect();
    all.sort_unstable();
    all.dedup();
    all
}
