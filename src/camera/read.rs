//! Finds camera files beside a scene and reads them.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};

use super::{CameraFile, cameras_json, colmap, transforms_json};
use crate::files::read_whole;

/// Number of folders above that of a scene that are searched: a model folder holds its scenes two levels below.
const PARENTS: usize = 3;

/// Finds the camera file of a scene in its folder, or else in the nearest of three folders above it: a `cameras.json`,
/// a `transforms.json`, or a folder `sparse` with a model of COLMAP.
pub fn find(scene: &Path) -> Option<PathBuf> {
    // The folders of the path as given, then those of its target: it may be a link.
    let places = [std::path::absolute(scene).ok(), scene.canonicalize().ok()];
    let mut folders = places.iter().flatten().flat_map(|place| place.ancestors().skip(1).take(1 + PARENTS));
    folders.find_map(in_folder)
}

fn in_folder(folder: &Path) -> Option<PathBuf> {
    let mut files = ["cameras.json", "transforms.json"].map(|name| folder.join(name)).into_iter();
    let sparse = || Some(folder.join("sparse")).filter(|sparse| colmap::is_model(sparse));
    files.find(|file| file.is_file()).or_else(sparse)
}

/// Reads all cameras of a file: a `cameras.json` of the original 3DGS, a `transforms.json` of nerfstudio, instant-ngp
/// or the Blender data sets, or a file of a sparse model of COLMAP. In a folder, the first of these is read.
///
/// # Errors
/// One sentence without the file's name if it is none of them, is damaged, or holds a camera that no picture can be
/// drawn with.
pub fn read(path: &Path) -> Result<CameraFile> {
    let read = if path.is_dir() { read_folder(path) } else { read_file(path) }?;
    ensure!(!read.cameras.is_empty(), "holds no camera");
    Ok(read)
}

fn read_folder(folder: &Path) -> Result<CameraFile> {
    if let Some(read) = colmap::read_folder(folder) {
        return read;
    }
    if let Some(path) = in_folder(folder) {
        return read(&path).with_context(|| path.file_name().unwrap_or_default().to_string_lossy().into_owned());
    }
    let parts = ["transforms_train.json", "transforms_val.json", "transforms_test.json"];
    let there = parts.iter().filter(|name| folder.join(name).is_file());
    let read = there.map(|name| read_file(&folder.join(name)).with_context(|| (*name).to_owned()));
    let all = read.reduce(|all, next| Ok(all?.and(next?)));
    all.context("is a folder with neither cameras.json, transforms.json nor a sparse model of COLMAP")?
}

fn read_file(path: &Path) -> Result<CameraFile> {
    if let Some(read) = colmap::read_file(path) {
        return read;
    }
    let text = read_whole(path)?;
    ensure!(!text.is_empty(), "the file is empty");
    match text.iter().find(|byte| !byte.is_ascii_whitespace()) {
        Some(b'[') => {
            let timed = cameras_json::parse(&text)?;
            Ok(CameraFile { cameras: timed.into_iter().map(|(camera, _)| camera).collect(), ..CameraFile::default() })
        }
        Some(b'{') => transforms_json::parse(&text, path),
        _ => bail!(
            "is not a camera file that smalto reads: expected cameras.json, transforms.json, or images.bin or .txt of \
             COLMAP, found bytes {:02x?}",
            &text[..text.len().min(4)]
        ),
    }
}
