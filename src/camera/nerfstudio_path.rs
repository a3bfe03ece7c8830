//! `camera_path.json` of nerfstudio's viewer: the frames of a film, one camera each.
//!
//! The members are those that nerfstudio reads: `get_path_from_json` in nerfstudio/cameras/camera_paths.py, and
//! `seconds` in nerfstudio/scripts/render.py.

use anyhow::{Context, Result, bail, ensure};
use glam::{DMat3, DVec2, DVec3};
use serde::Deserialize;
use serde_json::{Map, Value};

use super::timeline::{Key, MAX_SECONDS, RESOLUTION, Timeline};
use super::{Camera, MAX_SIDE, centre};

/// The file. Its keyframes, from which the frames were made, are not needed.
#[derive(Deserialize)]
struct Written {
    camera_path: Vec<Frame>,
    /// Pixels.
    render_width: f64,
    render_height: f64,
    /// Length of the film.
    seconds: f64,
    /// `perspective` if it is missing.
    camera_type: Option<String>,
}

#[derive(Deserialize)]
struct Frame {
    /// Rows of 4 numbers. Axes of OpenGL: right, up, back.
    camera_to_world: [f64; 16],
    /// The vertical field of view in degrees.
    fov: f64,
}

/// True if the members of a file are those of a camera path.
pub(super) fn is_path(file: &Map<String, Value>) -> bool {
    file.contains_key("camera_path")
}

/// A key for each frame of a file, and the frames per second. As nerfstudio draws them, the frames share the length of
/// the film equally, and the first is at 0.
///
/// # Errors
/// If it is no such file, or holds a camera that no picture can be drawn with.
pub(super) fn parse(file: Map<String, Value>) -> Result<(Timeline, f64)> {
    let Written { camera_path, render_width, render_height, seconds, camera_type } =
        serde_json::from_value(Value::Object(file)).context("is not a camera path of nerfstudio")?;
    if let Some(other) = camera_type.as_deref().filter(|kind| *kind != "perspective") {
        bail!("its camera_type {} is not supported, only perspective", other.escape_debug());
    }
    ensure!(!camera_path.is_empty(), "holds no camera");
    let sides = [render_width, render_height];
    let is_side = |side: &f64| side.fract() == 0.0 && (1.0..=f64::from(MAX_SIDE)).contains(side);
    let [w, h] = sides;
    ensure!(sides.iter().all(is_side), "its size {w:?}x{h:?} is not of whole numbers from 1 to {MAX_SIDE}");
    let (size_px, count) = (sides.map(|side| side as u32), camera_path.len() as f64);
    let is_length = seconds <= MAX_SECONDS && seconds / count >= RESOLUTION;
    ensure!(is_length, "its length of {seconds:?} s is no time for {count} frames");
    let key = |(i, frame): (usize, &Frame)| {
        let camera = frame.camera(size_px).with_context(|| format!("camera {i}"))?;
        Ok(Key { seconds: seconds * i as f64 / count, camera, rests: false })
    };
    let keys = camera_path.iter().enumerate().map(key).collect::<Result<_>>()?;
    Ok((Timeline { keys }, count / seconds))
}

impl Frame {
    fn camera(&self, size_px: [u32; 2]) -> Result<Camera> {
        let Self { camera_to_world: m, fov } = self;
        ensure!(*fov > 0.0 && *fov < 180.0, "its fov {fov:?} is not between 0 and 180 degrees");
        ensure!(m[12..] == [0.0, 0.0, 0.0, 1.0], "the last row of its camera_to_world is not 0, 0, 0, 1");
        let column = |i: usize| DVec3::new(m[i], m[4 + i], m[8 + i]);
        let rotation = DMat3::from_cols(column(0), -column(1), -column(2)).transpose();
        let focal = f64::from(size_px[1]) / 2.0 / (fov.to_radians() / 2.0).tan();
        Camera {
            position: column(3),
            rotation,
            focal_px: DVec2::splat(focal),
            centre_px: centre(size_px),
            size_px,
            lens: None,
        }
        .checked()
    }
}
