//! The dialog that asks for files.

use std::path::PathBuf;

use egui_file_dialog::{DialogState, FileDialog};

/// A dialog, open or closed.
pub struct Dialog {
    files: FileDialog,
}

const SCENES: [&str; 9] = ["ply", "spz", "sog", "splat", "ksplat", "glb", "gltf", "smalto", "json"];

impl Default for Dialog {
    fn default() -> Self {
        let files = FileDialog::new()
            .title("Open scenes, cameras or a picture to compare with")
            .add_file_filter_extensions("Scenes", SCENES.to_vec())
            .default_file_filter("Scenes")
            .allow_path_edit_to_save_file_without_extension(true)
            .as_modal(true);
        Self { files }
    }
}

impl Dialog {
    /// Asks for files to open.
    pub fn ask(&mut self) {
        self.files.pick_multiple();
    }

    pub fn is_open(&self) -> bool {
        *self.files.state() == DialogState::Open
    }

    /// Lays the dialog out, if it is open. Returns the files that were chosen, once.
    pub fn show(&mut self, context: &egui::Context) -> Vec<PathBuf> {
        self.files.update(context);
        self.files.take_picked_multiple().unwrap_or_default()
    }
}
