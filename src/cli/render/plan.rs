//! The plan of a run: its cameras and files, checked before anything is drawn.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::Args;
use super::camera_list::{SelectedCamera, select_cameras};
use super::outputs::{Names, Output, Outputs, Shot, safe_stem};
use super::video::{self, Video};
use crate::camera::{Camera, NamedCamera, path};
use crate::cli::cameras::{Fps, TOWN_NEAR, named_or_found, town_cameras};
use crate::cli::scenes::SceneFile;
use crate::cli::{Usage, remark, size_text};
use crate::files::{check_writable, make_folder};
use crate::measure::bench::views_hash;
use crate::pixels::FileKind;
use crate::procedural::TownPath;
use crate::scene::Focus;

/// Largest width and height for the reference, in pixels. It needs 64 bytes per pixel.
const REFERENCE_SIDE: u32 = 16384;

/// The pictures of a run, and the largest allowed distance of the near plane.
pub(super) struct Plan {
    pub shots: Vec<Shot>,
    pub outputs: Outputs,
    pub nearest: f32,
    /// The command that makes a video of them, with `--video`. A shard is no video.
    pub command: Option<String>,
    /// The video that is written instead of pictures.
    pub video: Option<Video>,
    /// BLAKE3 of the cameras of the whole run, and of the names of its files.
    pub cameras_hash: String,
    pub files_hash: String,
    /// The file that the scene was read from, if it was read and is a single file.
    pub source: Option<Source>,
}

/// The file that a scene was read from, and what it said besides its Gaussians.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Source {
    pub file: SceneFile,
    pub is_antialiased: bool,
}

/// The plan of a run, or of its shard. The scene is asked for only if cameras are made from it.
pub(super) fn plan(args: &Args, focus: &dyn Fn() -> Result<Focus>) -> Result<Plan> {
    let Cameras { mut selected, is_list, nearest, fps } = cameras(args, focus)?;
    if !args.eye.is_given()? {
        selected.iter_mut().for_each(|selected| args.lens.apply(&mut selected.camera));
    }
    let file = video::file(args)?;
    let several = is_list || args.video.is_some();
    let outputs = if file.is_some() { Outputs::none() } else { Outputs::of(args, several)? };
    check_together(args, &outputs, several)?;
    let shots =
        selected.into_iter().enumerate().map(|(number, selected)| shot(args, &outputs, several, number, selected));
    let shots = shots.collect::<Result<Vec<_>>>()?;
    check_shots(args, &shots)?;
    let video = file.map(|file| Video::new(args, file, &shots, fps.clone())).transpose()?;
    let is_printed = args.video.is_some() && video.is_none();
    let command = is_printed.then(|| video::command(args, &outputs, &shots, &fps)).transpose()?;
    let views: Vec<Camera> = shots.iter().map(|shot| shot.camera.clone()).collect();
    let (cameras_hash, files_hash) = (views_hash(&views), files_hash(&outputs, &shots));
    let (all, command) = (shots.len(), command.filter(|_| args.shard.is_none()));
    let shots = match args.shard {
        Some(shard) => shard.part(shots),
        None => shots,
    };
    if let Some(shard) = args.shard.filter(|_| shots.is_empty()) {
        remark(&format!("note: --shard {shard} has nothing to do: the number of cameras is {all}"));
    }
    Ok(Plan { shots, outputs, nearest, command, video, cameras_hash, files_hash, source: None })
}

/// BLAKE3 of the names of all files.
fn files_hash(outputs: &Outputs, shots: &[Shot]) -> String {
    let mut files = blake3::Hasher::new();
    for output in shots.iter().flat_map(|shot| &shot.outputs) {
        let name = output.within(outputs.folder().unwrap_or(Path::new("")));
        files.update(name.as_os_str().as_encoded_bytes()).update(&[0]);
    }
    files.finalize().to_hex().to_string()
}

impl Plan {
    /// The files of all pictures.
    pub fn files(&self) -> impl Iterator<Item = &Output> + Clone {
        self.shots.iter().flat_map(|shot| &shot.outputs)
    }

    /// Creates the folders of files. The folder of a single file that the user names must exist.
    pub fn make_folders(&self) -> Result<()> {
        let Some(folder) = self.outputs.folder() else { return Ok(()) };
        let certificates = self.shots.iter().filter_map(|shot| shot.certificate.as_deref());
        let files = self.files().map(|output| output.path.as_path()).chain(certificates);
        let folders: BTreeSet<&Path> = files.filter_map(Path::parent).chain([folder]).collect();
        folders.into_iter().try_for_each(make_folder)
    }
}

/// The cameras of a run.
struct Cameras {
    selected: Vec<SelectedCamera>,
    /// A list of cameras was asked for, even if it holds only one.
    is_list: bool,
    /// Largest allowed distance of the near plane.
    nearest: f32,
    /// Frames per second of a video.
    fps: Fps,
}

fn cameras(args: &Args, focus: &dyn Fn() -> Result<Focus>) -> Result<Cameras> {
    let size = args.size.unwrap_or([1280, 720]);
    if let Some((frames, fps)) = args.film.read(&args.scene, size)? {
        let frame = |(index, named): (usize, NamedCamera)| SelectedCamera::named(index, &named);
        let selected = frames.into_iter().enumerate().map(frame).collect();
        let nearest = args.scene.town()?.map_or(f32::INFINITY, |_| TOWN_NEAR);
        return Ok(Cameras { selected, is_list: true, nearest, fps });
    }
    let fps = args.film.fps();
    if let Some(count) = args.film.orbit() {
        let focus = focus()?;
        let views = path::orbit(DVec3::from(focus.centre), focus.radius, false, size, count);
        let view = |(index, camera)| SelectedCamera { index, name: None, camera };
        let selected = views.into_iter().enumerate().map(view).collect();
        return Ok(Cameras { selected, is_list: true, nearest: focus.radius as f32 / 100.0, fps });
    }
    let alone = |camera, nearest| Cameras {
        selected: vec![SelectedCamera { index: 0, name: None, camera }],
        is_list: false,
        nearest,
        fps: fps.clone(),
    };
    if args.eye.is_given()? {
        let focus = focus()?;
        let (camera, nearest) = args.eye.camera(|| focus, size, &args.lens)?.context("a camera is given")?;
        args.split.check_no_file()?;
        return Ok(alone(camera, nearest));
    }
    if let Some((_, all)) = named_or_found(args.cameras.as_deref(), &args.scene, &args.split, args.size, &args.lens)? {
        let (selected, is_list) = match &args.camera {
            Some(wanted) => select_cameras(&all, wanted)?,
            None => {
                (all.cameras.iter().take(1).map(|(index, named)| SelectedCamera::named(*index, named)).collect(), false)
            }
        };
        return Ok(Cameras { selected, is_list, nearest: f32::INFINITY, fps });
    }
    args.split.check_no_file()?;
    if let Some(camera) = &args.camera {
        return Err(Usage(format!(
            "--camera {camera} needs a camera file: no --cameras, and none found next to the scene or above it"
        ))
        .into());
    }
    if let Some(town) = args.scene.town()?.filter(|_| args.place.is_none())
        && let Some(first) = town_cameras(Some(town), TownPath::Street, size, 1)?.pop()
    {
        return Ok(alone(first.camera, TOWN_NEAR));
    }
    let focus = focus()?;
    let camera = Camera::framing(focus.centre.into(), focus.radius, size);
    let near = camera.framed_near(focus.centre.into());
    Ok(alone(camera, near))
}

fn shot(args: &Args, outputs: &Outputs, several: bool, number: usize, selected: SelectedCamera) -> Result<Shot> {
    let SelectedCamera { index, name, camera } = selected;
    let stem = match (args.names.unwrap_or(Names::Index), &name) {
        // The frames of a video are numbered without gaps.
        (Names::Index, _) => format!("{:05}", if args.video.is_some() { number } else { index }),
        (Names::Image, Some(name)) => {
            safe_stem(name).map_err(|problem| Usage(format!("--names image: camera {index}: {problem}")))?
        }
        (Names::Image, None) => return Err(Usage("--names image needs a camera file".to_owned()).into()),
    };
    let certificate = match &args.certificate {
        Some(folder) if several || folder.is_dir() => Some(folder.join(format!("{stem}.exr"))),
        file => file.clone(),
    };
    let camera = args.size.map_or_else(|| camera.clone(), |size| camera.resized(size));
    Ok(Shot { index, name, camera, outputs: outputs.files(&stem), certificate })
}

/// Fails if arguments exclude each other.
fn check_together(args: &Args, outputs: &Outputs, several: bool) -> Result<()> {
    let refuse = |why: String| Err(Usage(why).into());
    if several && args.dump.is_some() {
        return refuse("--dump writes the buffers of a single picture, not of several".to_owned());
    }
    if let Some(layer) = outputs.depths().next() {
        let name = layer.name();
        if args.place.is_some() {
            return refuse(format!("--place cannot be combined with --layers {name}"));
        }
        if args.dump.is_some() {
            return refuse(format!("--dump cannot be combined with --layers {name}"));
        }
        if args.certificate.is_some() {
            return refuse(format!("--certificate cannot be combined with --layers {name}"));
        }
    }
    check_certificate(args, several)
}

/// Fails if the certificate is not a file of floats. Most bounds are smaller than a step of 8 bits.
fn check_certificate(args: &Args, several: bool) -> Result<()> {
    let Some(file) = args.certificate.as_ref().filter(|file| !several && !file.is_dir()) else {
        return Ok(());
    };
    match FileKind::of(file) {
        Ok(kind) if kind.holds_floats() => Ok(check_writable(file)?),
        _ => Err(Usage(format!("--certificate {}: expected a name that ends in .exr or .npy", file.display())).into()),
    }
}

/// Fails if a picture is too large, or two outputs would be written to the same file.
fn check_shots(args: &Args, shots: &[Shot]) -> Result<()> {
    let is_large = |shot: &&Shot| shot.camera.size_px.into_iter().max() > Some(REFERENCE_SIDE);
    if let Some(shot) = shots.iter().find(is_large).filter(|_| args.reference) {
        let size = size_text(shot.camera.size_px);
        return Err(Usage(format!("--reference draws up to {REFERENCE_SIDE} pixels a side, not {size}")).into());
    }
    let mut pictures = BTreeMap::new();
    for shot in shots {
        for path in shot.outputs.iter().map(|output| &output.path) {
            if let Some(other) = pictures.insert(path, shot.index) {
                let (index, path) = (shot.index, path.display());
                return Err(Usage(format!("cameras {other} and {index} would both be written to {path}")).into());
            }
        }
    }
    let written_twice = |certificate: &&PathBuf| pictures.contains_key(certificate);
    if let Some(file) = shots.iter().filter_map(|shot| shot.certificate.as_ref()).find(written_twice) {
        return Err(Usage(format!("picture and certificate would both be written to {}", file.display())).into());
    }
    Ok(())
}
