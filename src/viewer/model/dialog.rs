//! The dialogs that ask for files.

use std::path::PathBuf;

use egui_file_dialog::{DialogState, FileDialog};

/// What a file is saved for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Saved {
    /// What the window shows, to go on with.
    Project,
    /// The scenes, as one file.
    Scene,
}

/// The dialogs that ask for files, open or closed.
pub struct Dialog {
    files: FileDialog,
    place: FileDialog,
    saved: Saved,
}

/// What was chosen.
pub enum Chosen {
    Open(PathBuf),
    Save(Saved, PathBuf),
}

const SCENES: [&str; 9] = ["ply", "spz", "sog", "splat", "ksplat", "glb", "gltf", "smalto", "json"];

impl Default for Dialog {
    fn default() -> Self {
        let files = FileDialog::new()
            .title("Open scenes, cameras or a picture to compare with")
            .add_file_filter_extensions("Scenes", SCENES.to_vec())
            .default_file_filter("Scenes")
            .as_modal(true);
        let place = FileDialog::new().allow_path_edit_to_save_file_without_extension(true).as_modal(true);
        Self { files, place, saved: Saved::Project }
    }
}

impl Dialog {
    /// Asks for files to open.
    pub fn ask(&mut self) {
        self.files.pick_multiple();
    }

    /// Asks where to save something.
    pub fn ask_where(&mut self, saved: Saved) {
        let (title, name) = match saved {
            Saved::Project => ("Save a project: NAME.project.json", "scene.project.json"),
            Saved::Scene => {
                ("Save the scene: .ply, .compressed.ply, .spz, .sog, .splat, .glb or .smalto", "edited.ply")
            }
        };
        self.saved = saved;
        self.place.config_mut().title = Some(title.to_owned());
        self.place.config_mut().default_file_name = name.to_owned();
        self.place.save_file();
    }

    pub fn is_open(&self) -> bool {
        [&self.files, &self.place].iter().any(|dialog| *dialog.state() == DialogState::Open)
    }

    /// Lays the dialogs out, if they are open. Returns what was chosen, once.
    pub fn show(&mut self, context: &egui::Context) -> Vec<Chosen> {
        self.files.update(context);
        self.place.update(context);
        let open = self.files.take_picked_multiple().unwrap_or_default().into_iter().map(Chosen::Open);
        let saved = self.saved;
        open.chain(self.place.take_picked().map(|file| Chosen::Save(saved, file))).collect()
    }
}
