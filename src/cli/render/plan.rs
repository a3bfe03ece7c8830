//! The plan of a run: its cameras and files, checked before anything is drawn.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use glam::DVec3;

use super::outputs::{Names, Outputs, Shot, safe_stem};
use super::{Args, video};
use crate::camera::{Camera, NamedCamera};
use crate::cli::{Usage, named_or_found, size_text};
use crate::files::check_writable;
use crate::pixels::FileKind;
use crate::scene::{Focus, Gaussians};

/// Largest width and height for the reference, in pixels. It needs 64 bytes per pixel.
const REFERENCE_SIDE: u32 = 16384;

/// The pictures of a run, and the largest allowed distance of the near plane.
pub(super) struct Plan {
    pub shots: Vec<Shot>,
    pub outputs: Outputs,
    pub nearest: f32,
    /// The command that makes a video of them, with `--video`.
    pub video: Option<String>,
}

/// A camera on the command line.
struct Chosen {
    /// Position in the file.
    index: usize,
    /// `None` for the automatic camera.
    name: Option<String>,
    camera: Camera,
}

pub(super) fn plan(args: &Args, gaussians: &Gaussians) -> Result<Plan> {
    if args.film.fps().is_some() && !args.video && !args.film.has_path() {
        return Err(Usage("--fps needs --video or --path".to_owned()).into());
    }
    let cameras = cameras(args)?;
    let mut nearest = f32::INFINITY;
    let (chosen, is_list) = match (&cameras, &args.camera) {
        (None, None) => {
            let (camera, distance) = automatic(gaussians, args.size);
            nearest = distance as f32 / 100.0;
            (vec![Chosen { index: 0, name: None, camera }], false)
        }
        (None, Some(camera)) => {
            return Err(Usage(format!(
                "--camera {camera} needs a camera file: no --cameras, and none found next to the scene or above it"
            ))
            .into());
        }
        (Some(all), None) if args.film.has_path() => choose(all, "all")?,
        (Some(all), wanted) => choose(all, wanted.as_deref().unwrap_or("0"))?,
    };
    let several = is_list || args.video;
    let outputs = Outputs::of(args, several)?;
    check_together(args, &outputs, several)?;
    let shots = chosen.into_iter().enumerate().map(|(number, chosen)| shot(args, &outputs, several, number, chosen));
    let shots = shots.collect::<Result<Vec<_>>>()?;
    check_shots(args, &shots)?;
    let video = args.video.then(|| video::command(args, &outputs, &shots)).transpose()?;
    make_folders(&outputs, &shots, several)?;
    Ok(Plan { shots, outputs, nearest, video })
}

fn cameras(args: &Args) -> Result<Option<Vec<NamedCamera>>> {
    if let Some(frames) = args.film.read()? {
        return Ok(Some(frames));
    }
    match named_or_found(args.cameras.as_deref(), &args.scene) {
        Some(file) => Ok(Some(args.split.read(&file)?)),
        None => Ok(args.split.check_no_file().map(|()| None)?),
    }
}

/// The cameras that `wanted` names. The second value is true if `wanted` is a list, a range or `all`.
fn choose(cameras: &[NamedCamera], wanted: &str) -> Result<(Vec<Chosen>, bool)> {
    let chosen =
        |index: usize| Chosen { index, name: Some(cameras[index].name.clone()), camera: cameras[index].camera.clone() };
    if wanted == "all" {
        return Ok(((0..cameras.len()).map(chosen).collect(), true));
    }
    // An image name may contain commas.
    if let Some(index) = position(cameras, wanted) {
        return Ok((vec![chosen(index)], false));
    }
    let mut found = Vec::new();
    for item in wanted.split(',') {
        let ends = item.split_once("..").and_then(|(a, b)| Some([a.parse::<usize>().ok()?, b.parse().ok()?]));
        let last = cameras.len() - 1;
        match (position(cameras, item), ends) {
            (Some(index), _) => found.push(chosen(index)),
            (None, Some([from, to])) if from <= to && to <= last => found.extend((from..=to).map(chosen)),
            (None, Some([from, to])) if from > to => {
                return Err(Usage(format!("--camera {item} is empty: {from} is greater than {to}")).into());
            }
            _ => {
                return Err(Usage(format!(
                    "there is no camera {item}: they are 0 to {last}, from '{}' to '{}'",
                    cameras[0].name, cameras[last].name
                ))
                .into());
            }
        }
    }
    Ok((found, true))
}

fn position(cameras: &[NamedCamera], wanted: &str) -> Option<usize> {
    // A number with leading zeros, such as 0007, is a name.
    let by_position = wanted.parse().ok().filter(|index: &usize| *index < cameras.len() && index.to_string() == wanted);
    by_position.or_else(|| cameras.iter().position(|c| c.name == wanted))
}

/// A camera that shows the whole scene, and its distance to the centre of the scene.
fn automatic(gaussians: &Gaussians, size: Option<[u32; 2]>) -> (Camera, f64) {
    let focus = Focus::of(gaussians);
    let centre = DVec3::from(focus.centre);
    let camera = Camera::framing(centre, focus.radius, size.unwrap_or([1280, 720]));
    let distance = camera.position.distance(centre);
    (camera, distance)
}

fn shot(args: &Args, outputs: &Outputs, several: bool, number: usize, chosen: Chosen) -> Result<Shot> {
    let Chosen { index, name, camera } = chosen;
    let stem = match (args.names.unwrap_or(Names::Index), name) {
        // The frames of a video are numbered without gaps.
        (Names::Index, _) => format!("{:05}", if args.video { number } else { index }),
        (Names::Image, Some(name)) => {
            safe_stem(&name).map_err(|problem| Usage(format!("--names image: camera {index}: {problem}")))?
        }
        (Names::Image, None) => return Err(Usage("--names image needs a camera file".to_owned()).into()),
    };
    let certificate = match &args.certificate {
        Some(folder) if several || folder.is_dir() => Some(folder.join(format!("{stem}.exr"))),
        file => file.clone(),
    };
    let camera = args.size.map_or_else(|| camera.clone(), |size| camera.resized(size));
    Ok(Shot { index, camera, outputs: outputs.files(&stem), certificate })
}

/// Fails if arguments exclude each other.
fn check_together(args: &Args, outputs: &Outputs, several: bool) -> Result<()> {
    let refuse = |why: String| Err(Usage(why).into());
    if several && args.dump.is_some() {
        return refuse("--dump writes the buffers of a single picture, not of several".to_owned());
    }
    if let Some(layer) = outputs.depths().next() {
        let name = layer.name();
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

/// Creates the folders of outputs. The folder of a single file that the user names must exist.
fn make_folders(outputs: &Outputs, shots: &[Shot], several: bool) -> Result<()> {
    let in_folder = shots.iter().filter(|_| outputs.folder().is_some()).flat_map(|shot| &shot.outputs);
    let certificates = shots.iter().filter(|_| several).filter_map(|shot| shot.certificate.as_deref());
    let files = in_folder.map(|output| output.path.as_path()).chain(certificates);
    let folders: BTreeSet<&Path> = files.filter_map(Path::parent).collect();
    for folder in folders {
        fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    Ok(())
}
