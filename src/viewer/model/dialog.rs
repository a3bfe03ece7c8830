//! Dialogs in which the user selects files to open or to save.

use std::path::PathBuf;

use egui::Align2;
use egui_file_dialog::{DialogState, FileDialog};

use crate::formats::{FORMATS, Format, labels};

/// The kind of file to save.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SaveTarget {
    /// A project.
    Project,
    /// The scenes, joined in one file.
    Scene,
}

/// The file dialogs, open or closed.
pub struct Dialog {
    open: FileDialog,
    save: FileDialog,
    target: SaveTarget,
}

/// The file that the user chose, and its purpose.
pub enum DialogResult {
    Open(PathBuf),
    Save(SaveTarget, PathBuf),
}

impl Default for Dialog {
    fn default() -> Self {
        let all = [&scenes()[..], &CAMERAS, &PICTURES].concat();
        let open = FileDialog::new()
            .title("Open scenes, cameras or a picture to compare with")
            .add_file_filter_extensions("All that can be opened", all)
            .add_file_filter_extensions("Scenes", scenes())
            .add_file_filter_extensions("Cameras and projects", CAMERAS.to_vec())
            .add_file_filter_extensions("Pictures", PICTURES.to_vec())
            .default_file_filter("All that can be opened")
            .anchor(Align2::CENTER_CENTER, [0.0, 0.0])
            .as_modal(true);
        let save = FileDialog::new()
            .allow_path_edit_to_save_file_without_extension(true)
            .anchor(Align2::CENTER_CENTER, [0.0, 0.0])
            .as_modal(true);
        Self { open, save, target: SaveTarget::Project }
    }
}

impl Dialog {
    /// Shows the dialog for files to open.
    pub fn open_files(&mut self) {
        self.open.pick_multiple();
    }

    /// Shows the dialog for the file to save.
    pub fn save_file(&mut self, target: SaveTarget) {
        let (title, name) = match target {
            SaveTarget::Project => ("Save a project: NAME.project.json".to_owned(), "scene.project.json"),
            SaveTarget::Scene => (format!("Save the scene: {}", labels(Format::is_written_file)), "edited.ply"),
        };
        self.target = target;
        self.save.config_mut().title = Some(title);
        self.save.config_mut().default_file_name = name.to_owned();
        self.save.save_file();
    }

    pub fn is_open(&self) -> bool {
        [&self.open, &self.save].iter().any(|dialog| *dialog.state() == DialogState::Open)
    }

    /// Lays the open dialogs out. Returns the chosen files, once.
    pub fn show(&mut self, context: &egui::Context) -> Vec<DialogResult> {
        self.open.update(context);
        self.save.update(context);
        let open = self.open.take_picked_multiple().unwrap_or_default().into_iter().map(DialogResult::Open);
        let target = self.target;
        open.chain(self.save.take_picked().map(|file| DialogResult::Save(target, file))).collect()
    }
}

/// The extensions of camera files and projects, and of pictures.
pub const CAMERAS: [&str; 3] = ["json", "bin", "txt"];
pub const PICTURES: [&str; 5] = ["png", "exr", "npy", "jpg", "jpeg"];

/// The last extensions of all scene files.
fn scenes() -> Vec<&'static str> {
    let mut all: Vec<&str> = FORMATS.iter().map(|format| format.name.rsplit('.').next().unwrap_or_default()).collect();
    all.sort_unstable();
    all.dedup();
    all
}
