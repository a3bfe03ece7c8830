//! The views of a bench: a camera file or a camera path.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Result, bail};
use glam::DVec3;

use crate::camera::{Camera, path};
use crate::cli::cameras::{EyeArgs, LensArgs, Numbered, SplitArg, TOWN_NEAR, town_cameras};
use crate::procedural::{Procedural, TownPath};
use crate::scene::Focus;

/// A camera path as an argument names it.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::cli) enum CameraPath {
    Orbit { zooms: bool },
    Turn,
    Town(TownPath),
    Keyframes(PathBuf),
}

impl FromStr for CameraPath {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        match text {
            "orbit" => Ok(Self::Orbit { zooms: false }),
            "orbit-zoom" => Ok(Self::Orbit { zooms: true }),
            "turn" => Ok(Self::Turn),
            _ => match TownPath::named(text) {
                Some(path) => Ok(Self::Town(path)),
                None if text.contains(['.', '/', '\\']) || Path::new(text).exists() => Ok(Self::Keyframes(text.into())),
                None => {
                    bail!("expected orbit, orbit-zoom, turn, street, roof, air or a file, and there is no such file")
                }
            },
        }
    }
}

/// The source of the views of every scene.
pub(in crate::cli) struct Cameras {
    /// Name in the report.
    pub name: String,
    source: Source,
    lens: LensArgs,
}

enum Source {
    Scripted(Script),
    Town(TownPath),
    File(Vec<Camera>),
    Keyframes(Vec<Camera>),
    Eye(EyeArgs),
}

/// Makes a path from the centre and the radius of a scene, the picture size and the number of views.
type Script = fn(DVec3, f64, [u32; 2], usize) -> Vec<Camera>;

impl Cameras {
    /// The views of a camera file.
    pub fn of_file(file: &Path, numbered: Numbered) -> Self {
        let cameras = numbered.cameras.into_iter().map(|(_, named)| named.camera).collect();
        Self { name: name_of(file), source: Source::File(cameras), lens: LensArgs::default() }
    }

    /// The views along a path. Cameras of a file whose size is nowhere stated get the size `default_px`.
    ///
    /// # Errors
    /// If a file cannot be read, or if `split` selects cameras and there is no file.
    pub fn along(split: &SplitArg, path: &CameraPath, default_px: [u32; 2], lens: &LensArgs) -> Result<Self> {
        let lens = lens.clone();
        if let CameraPath::Keyframes(file) = path {
            let read = split.read(file, Some(default_px), &lens)?.cameras.into_iter().map(|(_, named)| named.camera);
            return Ok(Self {
                name: format!("keyframes:{}", name_of(file)),
                source: Source::Keyframes(read.collect()),
                lens,
            });
        }
        split.check_no_file()?;
        let (name, script): (_, Script) = match path {
            CameraPath::Town(path) => {
                return Ok(Self { name: path.name().to_owned(), source: Source::Town(*path), lens });
            }
            CameraPath::Turn => ("turn", path::turn),
            CameraPath::Orbit { zooms: true } => ("orbit-zoom", |c, r, s, n| path::orbit(c, r, true, s, n)),
            _ => ("orbit", |c, r, s, n| path::orbit(c, r, false, s, n)),
        };
        Ok(Self { name: name.to_owned(), source: Source::Scripted(script), lens })
    }

    /// The view of a camera that is given by its place.
    ///
    /// # Errors
    /// If `split` selects cameras, which need a file.
    pub fn at(eye: EyeArgs, split: &SplitArg, lens: &LensArgs) -> Result<Self> {
        split.check_no_file()?;
        Ok(Self { name: "eye".to_owned(), source: Source::Eye(eye), lens: lens.clone() })
    }

    /// At most `frames` views of a scene at this size, and the largest distance of the near plane that they allow, in
    /// world units.
    ///
    /// # Errors
    /// If the path is one of the town, and the scene is not `town`.
    pub fn views(
        &self,
        (focus, town): (&dyn Fn() -> Focus, Option<Procedural>),
        size: [u32; 2],
        frames: usize,
    ) -> Result<(Vec<Camera>, f32)> {
        let resized = |cameras: &[Camera]| cameras.iter().map(|c| c.resized(size)).collect::<Vec<_>>();
        let (mut views, nearest) = match &self.source {
            Source::Town(path) => {
                let views = town_cameras(town, *path, size, frames)?;
                (views.into_iter().map(|named| named.camera).collect(), TOWN_NEAR)
            }
            Source::File(cameras) => (resized(&cameras[..frames.min(cameras.len())]), f32::INFINITY),
            Source::Keyframes(cameras) => (path::through(&resized(cameras), frames), f32::INFINITY),
            Source::Eye(eye) => {
                let (camera, nearest) = eye.camera(focus, size, &self.lens)?.unzip();
                (camera.into_iter().collect(), nearest.unwrap_or(f32::INFINITY))
            }
            Source::Scripted(script) => {
                let focus = focus();
                let views = script(DVec3::from(focus.centre), focus.radius, size, frames);
                (views, focus.radius as f32 / 100.0)
            }
        };
        if !matches!(self.source, Source::Eye(_)) {
            views.iter_mut().for_each(|camera| self.lens.apply(camera));
        }
        Ok((views, nearest))
    }
}

fn name_of(file: &Path) -> String {
    file.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
