//! What a window keeps for the next one: the files that were opened, and how the panels looked.

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
}

/// What is kept, in a file of JSON.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Kept {
    /// Files of scenes, the last that was opened first.
    pub recent: Vec<PathBuf>,
    pub tab: Tab,
    /// The panels are dark letters on a light ground.
    pub is_light: bool,
    /// The cameras of the file are drawn over the picture.
    pub shows_cameras: bool,
    /// The axes and a grid are drawn over the picture.
    pub shows_guides: bool,
}

/// Most files that are kept.
const RECENT: usize = 8;

impl Kept {
    /// The place of the file; `None` without a folder for it.
    pub fn default_file() -> Option<PathBuf> {
        Some(dirs::state_dir().or_else(dirs::data_local_dir)?.join("smalto").join("viewer.json"))
    }

    /// What the file keeps; nothing if there is none, or it cannot be understood.
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

    /// Notes that a scene was opened.
    pub fn note(&mut self, scene: &Path) {
        let Ok(scene) = std::path::absolute(scene) else { return };
        self.recent.retain(|recent| *recent != scene);
        self.recent.insert(0, scene);
        self.recent.truncate(RECENT);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_is_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("state").join("viewer.json");
        assert_eq!(Kept::read(&file), Kept::default());
        let mut kept = Kept { tab: Tab::Inside, is_light: true, ..Kept::default() };
        (0..RECENT + 3).for_each(|i| kept.note(Path::new(&format!("/scenes/{i}.ply"))));
        kept.note(Path::new("/scenes/9.ply"));
        let recent: Vec<_> = kept.recent.iter().map(|path| path.file_stem().unwrap().to_str().unwrap()).collect();
        assert_eq!(recent, ["9", "10", "8", "7", "6", "5", "4", "3"]);
        kept.write(&file).unwrap();
        assert_eq!(Kept::read(&file), kept);
        std::fs::write(&file, r#"{"tab": "no such page"}"#).unwrap();
        assert_eq!(Kept::read(&file), Kept::default());
    }
}
