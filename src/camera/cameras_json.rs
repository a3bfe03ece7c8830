//! `cameras.json` of the original 3DGS: an array of camera-to-world poses with focal lengths.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use glam::{DMat3, DVec2, DVec3};
use serde::Deserialize;

use super::{Camera, MAX_POSITION, MAX_SIDE, centre};

/// A camera and the name of its photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedCamera {
    pub name: String,
    pub camera: Camera,
}

/// Beyond this no scene can be seen in 32-bit floats.
const MAX_FOCAL_PX: f64 = 1e9;

#[derive(Deserialize)]
struct Entry {
    #[serde(default)]
    id: Option<i64>,
    #[serde(default)]
    img_name: Option<String>,
    width: u32,
    height: u32,
    position: [f64; 3],
    /// Rows of camera to world.
    rotation: [[f64; 3]; 3],
    fx: f64,
    fy: f64,
}

/// How many folders above a scene's are searched for `cameras.json`: a model folder keeps its scenes two below.
const PARENTS: usize = 3;

/// The `cameras.json` beside a scene or in a folder above it.
pub fn find(scene: &Path) -> Option<PathBuf> {
    // Where the path says the scene is, then where it is: it may be a link.
    let places = [std::path::absolute(scene).ok(), scene.canonicalize().ok()];
    let folders = places.iter().flatten().flat_map(|place| place.ancestors().skip(1).take(1 + PARENTS));
    folders.map(|folder| folder.join("cameras.json")).find(|file| file.is_file())
}

/// Reads every camera of the file.
pub fn read(path: &Path) -> Result<Vec<NamedCamera>> {
    let text = fs::read_to_string(path).context("cannot be read")?;
    let entries: Vec<Entry> = serde_json::from_str(&text)
        .context("is not a cameras.json (an array of id, img_name, width, height, position, rotation, fx, fy)")?;
    ensure!(!entries.is_empty(), "holds no camera");
    entries.into_iter().enumerate().map(|(i, entry)| entry.camera(i).with_context(|| format!("camera {i}"))).collect()
}

impl Entry {
    fn camera(self, index: usize) -> Result<NamedCamera> {
        let size_px = [self.width, self.height];
        ensure!(
            size_px.iter().all(|side| (1..=MAX_SIDE).contains(side)),
            "its size {}x{} is not from 1 to {MAX_SIDE} pixels",
            self.width,
            self.height
        );
        ensure!(
            [self.fx, self.fy].iter().all(|f| *f > 0.0 && *f <= MAX_FOCAL_PX),
            "its focal lengths {} and {} are not over 0 and up to {MAX_FOCAL_PX:e} pixels",
            self.fx,
            self.fy
        );
        let position = DVec3::from(self.position);
        ensure!(
            position.abs().max_element() <= MAX_POSITION,
            "its position is not within {MAX_POSITION:e} of the origin"
        );
        // Rows of camera to world are the columns of world to camera.
        let rotation = DMat3::from_cols_array_2d(&self.rotation);
        let error = (rotation * rotation.transpose() - DMat3::IDENTITY)
            .to_cols_array()
            .iter()
            .fold(0.0, |m: f64, v| m.max(v.abs()));
        ensure!(error < 1e-3 && rotation.determinant() > 0.0, "its rotation is not a rotation matrix");
        let name = self.img_name.unwrap_or_else(|| self.id.map_or_else(|| index.to_string(), |id| id.to_string()));
        let focal_px = DVec2::new(self.fx, self.fy);
        Ok(NamedCamera { name, camera: Camera { position, rotation, focal_px, centre_px: centre(size_px), size_px } })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ONE: &str = r#"[{"id": 7, "img_name": "a", "width": 640, "height": 480, "position": [1, 2, 3],
        "rotation": [[0, 0, -1], [0, 1, 0], [1, 0, 0]], "fx": 500, "fy": 510}]"#;

    fn parse(text: &str) -> Result<Vec<NamedCamera>> {
        let file = tempfile::NamedTempFile::new()?;
        fs::write(file.path(), text)?;
        read(file.path())
    }

    #[test]
    fn cameras_json_rotation_rows_are_camera_to_world() {
        let camera = parse(ONE).unwrap().remove(0).camera;
        assert_eq!(camera.right(), DVec3::new(0.0, 0.0, 1.0));
        assert_eq!(camera.forward(), DVec3::new(-1.0, 0.0, 0.0));
        assert_eq!(camera.view(DVec3::new(0.0, 2.0, 3.0)), DVec3::new(0.0, 0.0, 1.0));
        assert_eq!(camera.focal_px, DVec2::new(500.0, 510.0));
    }

    #[test]
    fn cameras_json_says_what_is_wrong() {
        for (from, to, expected) in [
            ("[0, 0, -1]", "[0, 0, 1]", "not a rotation"),
            ("[0, 0, -1]", "[0, 0, -2]", "not a rotation"),
            ("640", "0", "from 1 to 65536"),
            ("640", "65537", "from 1 to 65536"),
            ("500", "1e10", "up to 1e9"),
            ("[1, 2, 3]", "[1, 2e31, 3]", "within 1e30"),
            ("500", "-500", "not over 0"),
            ("\"fx\": 500,", "", "missing field `fx`"),
            ("[{", "{", "not a cameras.json"),
        ] {
            let error = format!("{:#}", parse(&ONE.replace(from, to)).unwrap_err());
            assert!(error.contains(expected), "{error}");
        }
        assert!(format!("{:#}", parse("[]").unwrap_err()).contains("no camera"));
    }
}
