//! `cameras.json` of the original 3DGS: an array of camera-to-world poses with focal lengths. smalto adds
//! optional members: the principal point, the lens, the time of a key, whether it rests. Other programs ignore them.

use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use glam::{DMat3, DVec2, DVec3};
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;

use super::{Camera, Lens, NamedCamera, centre};
use crate::files::write_whole;

/// The members of a camera that error messages list.
const MEMBERS: &str = "id, img_name, width, height, position, rotation, fx, fy";

#[derive(Deserialize, Serialize)]
pub(super) struct Entry {
    #[serde(default)]
    id: Option<i64>,
    #[serde(default)]
    img_name: Option<String>,
    #[serde(deserialize_with = "whole")]
    width: u32,
    #[serde(deserialize_with = "whole")]
    height: u32,
    position: [f64; 3],
    /// Camera to world, rows.
    rotation: [[f64; 3]; 3],
    fx: f64,
    fy: f64,
    /// The principal point in pixels; by default the middle of the image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    cx: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    cy: Option<f64>,
    /// By default, the camera is a pinhole.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    lens: Option<NamedLens>,
    /// The time of a key of a [`Timeline`](super::Timeline).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    seconds: Option<f64>,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    rests: bool,
}

/// The arguments of [`Lens::named`].
#[derive(Deserialize, Serialize)]
struct NamedLens {
    model: String,
    #[serde(default)]
    parameters: Vec<f64>,
}

/// What a path knows of a camera.
#[derive(Clone, Copy, Default)]
pub(super) struct Moment {
    pub seconds: Option<f64>,
    pub rests: bool,
}

/// A number of pixels. Some programs write it like 640.0.
fn whole<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
    let number = f64::deserialize(deserializer)?;
    // Numbers beyond 32 bits become too large ones, which are refused later.
    if number.fract() == 0.0 && number >= 0.0 {
        Ok(number as u32)
    } else {
        Err(D::Error::custom(format!("{number:?} is not a whole number of pixels")))
    }
}

/// All cameras of the file, each with its moment of a path.
pub(super) fn parse(text: &[u8]) -> Result<Vec<(NamedCamera, Moment)>> {
    let entries: Vec<Entry> = serde_json::from_slice(without_byte_order_mark(text))
        .with_context(|| format!("is not a cameras.json (an array of {MEMBERS})"))?;
    ensure!(!entries.is_empty(), "holds no camera");
    let timed = |(i, entry): (usize, Entry)| {
        let moment = Moment { seconds: entry.seconds, rests: entry.rests };
        Ok((entry.camera(i).with_context(|| format!("camera {i}"))?, moment))
    };
    entries.into_iter().enumerate().map(timed).collect()
}

/// Writes a file that [`read`](super::read) reads as exactly these cameras. The write is atomic.
///
/// # Errors
/// If there is no camera, or the file cannot be written.
pub fn write(path: &Path, cameras: &[NamedCamera]) -> Result<()> {
    let entry = |(i, named): (usize, &NamedCamera)| Entry::of(i, &named.name, &named.camera, Moment::default());
    write_entries(path, cameras.iter().enumerate().map(entry))
}

pub(super) fn write_entries(path: &Path, entries: impl ExactSizeIterator<Item = Entry>) -> Result<()> {
    ensure!(entries.len() > 0, "cannot write {}: there is no camera", path.display());
    write_whole(path, |file| {
        // One camera per line.
        for (i, entry) in entries.enumerate() {
            file.write_all(if i == 0 { b"[\n" } else { b",\n" })?;
            serde_json::to_writer(&mut *file, &entry)?;
        }
        Ok(file.write_all(b"\n]\n")?)
    })
}

/// The camera as an entry of a `cameras.json`. [`from_json`] makes the same camera of it, bit for bit.
pub fn to_json(camera: &Camera) -> String {
    let entry = Entry::of(0, "view", camera, Moment::default());
    serde_json::to_string(&entry).expect("numbers and a name can be written as JSON")
}

/// The camera of an entry of a `cameras.json`, or of the first entry of an array.
///
/// # Errors
/// A sentence on what is wrong if `text` is neither, or no picture can be drawn with the camera.
pub fn from_json(text: &str) -> Result<Camera> {
    let value: Value = serde_json::from_slice(without_byte_order_mark(text.as_bytes())).context("it is not JSON")?;
    let first = match value {
        Value::Array(all) => all.into_iter().next().context("it holds no camera")?,
        one => one,
    };
    let entry: Entry = serde_json::from_value(first).with_context(|| format!("it is not a camera ({MEMBERS})"))?;
    Ok(entry.camera(0)?.camera)
}

impl Entry {
    pub fn of(index: usize, name: &str, camera: &Camera, Moment { seconds, rests }: Moment) -> Self {
        let Camera { position, rotation, focal_px, centre_px, size_px, lens } = camera;
        let centred = centre(*size_px);
        Self {
            id: i64::try_from(index).ok(),
            img_name: Some(name.to_owned()),
            width: size_px[0],
            height: size_px[1],
            position: position.to_array(),
            rotation: rotation.to_cols_array_2d(),
            fx: focal_px.x,
            fy: focal_px.y,
            cx: (centre_px.x != centred.x).then_some(centre_px.x),
            cy: (centre_px.y != centred.y).then_some(centre_px.y),
            lens: lens
                .as_ref()
                .map(|lens| NamedLens { model: lens.model().to_owned(), parameters: lens.parameters().to_vec() }),
            seconds,
            rests,
        }
    }

    fn camera(self, index: usize) -> Result<NamedCamera> {
        let size_px = [self.width, self.height];
        let middle = centre(size_px);
        let named = |NamedLens { model, parameters }| Lens::named(&model, &parameters);
        let lens = self.lens.map(named).transpose().context("its lens")?.flatten();
        let camera = Camera {
            position: DVec3::from(self.position),
            // Rows of camera to world are the columns of world to camera.
            rotation: DMat3::from_cols_array_2d(&self.rotation),
            focal_px: DVec2::new(self.fx, self.fy),
            centre_px: DVec2::new(self.cx.unwrap_or(middle.x), self.cy.unwrap_or(middle.y)),
            size_px,
            lens: lens.map(Arc::new),
        };
        let name = self.img_name.unwrap_or_else(|| self.id.map_or_else(|| index.to_string(), |id| id.to_string()));
        Ok(NamedCamera::new(name, camera.checked()?))
    }
}

/// The text without a byte order mark, which some editors write before UTF-8.
pub(super) fn without_byte_order_mark(text: &[u8]) -> &[u8] {
    text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::camera::read;

    const ONE: &str = r#"[{"id": 7, "img_name": "a", "width": 640, "height": 480, "position": [1, 2, 3],
        "rotation": [[0, 0, -1], [0, 1, 0], [1, 0, 0]], "fx": 500, "fy": 510}]"#;

    fn parse(text: &str) -> Result<Vec<NamedCamera>> {
        let file = tempfile::NamedTempFile::new()?;
        fs::write(file.path(), text)?;
        Ok(read(file.path())?.cameras)
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
            ("640", "640.5", "640.5 is not a whole number of pixels"),
            ("640", "-640", "-640.0 is not a whole number of pixels"),
            ("640", "1e300", "from 1 to 65536"),
            ("640", "0", "from 1 to 65536"),
            ("640", "65537", "from 1 to 65536"),
            ("500", "1e10", "up to 1e9"),
            ("\"fx\"", "\"cy\": -2e9, \"fx\"", "principal point"),
            ("[1, 2, 3]", "[1, 2e31, 3]", "within 1e30"),
            ("500", "-500", "not over 0"),
            ("\"fx\": 500,", "", "missing field `fx`"),
            (
                "\"fx\"",
                "\"lens\": {\"model\": \"OPENCV\"}, \"fx\"",
                "OPENCV has 4 lens parameters (k1, k2, p1, p2), it has 0",
            ),
            (
                "\"fx\"",
                "\"lens\": {\"model\": \"ROUND\"}, \"fx\"",
                "camera 0: its lens: its camera model ROUND is not known",
            ),
            ("\"fx\"", "\"lens\": {\"parameters\": []}, \"fx\"", "missing field `model`"),
            ("\"fx\"", "\"lens\": \"FISHEYE\", \"fx\"", "expected struct NamedLens"),
            ("[{", "[", "not a cameras.json"),
        ] {
            let error = format!("{:#}", parse(&ONE.replace(from, to)).unwrap_err());
            assert!(error.contains(expected), "{error}");
        }
        assert!(format!("{:#}", parse("[]").unwrap_err()).contains("no camera"));
    }

    #[test]
    fn cameras_json_takes_a_principal_point_and_knows_the_centre() {
        let centre = |text: &str| parse(text).unwrap().remove(0).camera.centre_px;
        assert_eq!(centre(ONE), DVec2::new(320.0, 240.0));
        assert_eq!(centre(&ONE.replace("\"fx\"", "\"cx\": 301.5, \"fx\"")), DVec2::new(301.5, 240.0));
        assert_eq!(centre(&ONE.replace("\"fx\"", "\"cx\": 1, \"cy\": -2, \"fx\"")), DVec2::new(1.0, -2.0));
    }

    /// Cameras with numbers of every magnitude, most of them long in decimal.
    fn random_cameras() -> Vec<NamedCamera> {
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let one = |i: usize| {
            let place = |v: f64| (v - 0.5) * 10_f64.powi(i as i32 % 25 - 12);
            let [position, target] = [(); 2].map(|()| DVec3::new(place(random()), place(random()), place(random())));
            let camera = Camera::looking_at(position, target, [1 + i as u32, 1000], 0.1 + 2.0 * random());
            let centre_px =
                if i.is_multiple_of(2) { camera.centre_px } else { DVec2::new(random() * 999.0, -random()) };
            let name = format!("view \"{i}\"\n");
            let parameters = [(); 4].map(|()| place(random()).clamp(-0.1, 0.1));
            let lens = match i % 3 {
                0 => None,
                1 => Lens::named("OPENCV_FISHEYE", &parameters).unwrap().map(Arc::new),
                _ => Lens::named("EQUIRECTANGULAR", &[]).unwrap().map(Arc::new),
            };
            NamedCamera::new(name, Camera { centre_px, focal_px: camera.focal_px * random(), lens, ..camera })
        };
        (0..1000).map(one).collect()
    }

    #[test]
    fn cameras_go_through_text_and_files_without_losing_a_bit() {
        let cameras = random_cameras();
        for NamedCamera { camera, .. } in &cameras {
            assert_eq!(from_json(&to_json(camera)).unwrap(), *camera);
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cameras.json");
        write(&path, &cameras).unwrap();
        assert_eq!(read(&path).unwrap().cameras, cameras);
        let text = fs::read_to_string(&path).unwrap();
        assert_eq!(from_json(&text).unwrap(), cameras[0].camera, "the first of an array");
        assert_eq!(text.lines().count(), 1002, "a camera a line");
        let first = text.lines().nth(1).unwrap();
        assert!(!first.contains("cx") && !first.contains("lens"), "what has a default need not be said");
        assert!(write(&path, &[]).unwrap_err().to_string().contains("no camera"));
    }

    #[test]
    fn a_copied_view_is_a_camera_file_in_brackets() {
        let camera = parse(ONE).unwrap().remove(0).camera;
        let copied = to_json(&camera);
        assert_eq!(parse(&format!("[{copied}]")).unwrap()[0].camera, camera);
        for (text, expected) in [
            ("a view", "not JSON"),
            ("[]", "no camera"),
            ("7", "not a camera"),
            ("{\"id\": 7}", "missing field `width`"),
            (&copied.replace("500", "-500"), "not over 0"),
        ] {
            assert!(format!("{:#}", from_json(text).unwrap_err()).contains(expected), "{text}");
        }
    }
}
