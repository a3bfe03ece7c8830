//! The state kept from one window to the next: recent files, and the appearance of the panels.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::Result;
use serde::{Deserialize, Serialize};

use crate::files::{make_folder, read_whole, write_whole};

/// A page of the panel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Tab {
    #[default]
    Scene,
    Quality,
    Inside,
    Compare,
    Path,
    Edit,
}

impl Tab {
    /// Every page with its title, in their order.
    pub const ALL: [(Self, &str); 6] = [
        (Self::Scene, "Scene"),
        (Self::Quality, "Quality"),
        (Self::Inside, "Inside"),
        (Self::Compare, "Compare"),
        (Self::Path, "Path"),
        (Self::Edit, "Edit"),
    ];

    pub fn title(self) -> &'static str {
        Self::ALL[self as usize].1
    }
}

/// The state kept from one window to the next, in a JSON file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RecentState {
    /// Files of scenes, the most recent first.
    #[serde(rename = "recent")]
    pub files: Vec<PathBuf>,
    pub tab: Tab,
    /// A page that is open beside the others.
    pub beside: Option<Tab>,
    /// The panels have dark text on a light ground.
    pub is_light: bool,
    /// The cameras of the file are drawn over the picture.
    pub shows_cameras: bool,
    /// The axes and a grid are drawn over the picture.
    pub shows_guides: bool,
    /// Sections of the panels that are closed, by their titles.
    pub closed: BTreeSet<String>,
    /// Width and height of the last window in pixels, unless it filled the screen.
    pub size: Option<[u32; 2]>,
}

/// Most recent files.
const MAX_FILES: usize = 8;

impl RecentState {
    /// Path of the file; `None` without a folder for it.
    pub fn default_file() -> Option<PathBuf> {
        Some(dirs::state_dir().or_else(dirs::data_local_dir)?.join("smalto").join("viewer.json"))
    }

    /// Reads the file. Returns the default state if it is missing or cannot be parsed.
    pub fn read(file: &Path) -> Self {
        read_whole(file).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default()
    }

    /// Writes the file, and its folder.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn write(&self, file: &Path) -> Result<()> {
        file.parent().map_or(Ok(()), make_folder)?;
        write_whole(file, |writer| Ok(serde_json::to_writer_pretty(writer, self)?))
    }

    /// Keeps the open page open beside the others, of which the first is opened.
    pub fn keep_beside(&mut self) {
        self.beside = Some(self.tab);
        self.tab = if self.tab == Tab::Scene { Tab::Quality } else { Tab::Scene };
    }

    /// Adds a scene file, as the most recent one.
    pub fn add(&mut self, scene: &Path) {
        let Ok(scene) = std::path::absolute(scene) else { return };
        self.files.retain(|file| *file != scene);
        self.files.insert(0, scene);
        self.files.truncate(MAX_FILES);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_state_is_read_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("state").join("viewer.json");
        assert_eq!(RecentState::read(&file), RecentState::default());
        let closed = BTreeSet::from(["Memory".to_owned()]);
        let mut state =
            RecentState { tab: Tab::Inside, is_light: true, closed, size: Some([640, 480]), ..RecentState::default() };
        (0..MAX_FILES + 3).for_each(|i| state.add(Path::new(&format!("/scenes/{i}.ply"))));
        state.add(Path::new("/scenes/9.ply"));
        let recent: Vec<_> = state.files.iter().map(|path| path.file_stem().unwrap().to_str().unwrap()).collect();
        assert_eq!(recent, ["9", "10", "8", "7", "6", "5", "4", "3"]);
        state.write(&file).unwrap();
        assert_eq!(RecentState::read(&file), state);
        std::fs::write(&file, r#"{"tab": "no such page"}"#).unwrap();
        assert_eq!(RecentState::read(&file), RecentState::default());
    }
}
