//! Finds camera files beside a scene and reads them.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use serde_json::{Map, Value};

use super::cameras_json::without_byte_order_mark;
use super::{CameraFile, cameras_json, colmap, nerfstudio_path, transforms_json};
use crate::files::read_whole;

/// Number of folders above that of a scene that are searched: a model folder holds its scenes two levels below.
const PARENTS: usize = 3;

/// The files of a Blender data set, in the order in which their cameras are joined.
const BLENDER_SETS: [&str; 3] = ["transforms_train.json", "transforms_val.json", "transforms_test.json"];

/// Finds the cameras of a scene in its folder, or else in the nearest of three folders above it: a `cameras.json`, a
/// `transforms.json`, a folder `sparse` with a model of COLMAP, or the folder itself if it holds
/// `transforms_train.json` and the like, the files of a Blender data set.
pub fn find(scene: &Path) -> Option<PathBuf> {
    // The folders of the path as given, then those of its target: it may be a link.
    let places = [std::path::absolute(scene).ok(), scene.canonicalize().ok()];
    let mut folders = places.iter().flatten().flat_map(|place| place.ancestors().skip(1).take(1 + PARENTS));
    let set = |folder: &Path| Some(folder.to_owned()).filter(|folder| blender_sets(folder).next().is_some());
    folders.find_map(|folder| in_folder(folder).or_else(|| set(folder)))
}

fn in_folder(folder: &Path) -> Option<PathBuf> {
    let mut files = ["cameras.json", "transforms.json"].map(|name| folder.join(name)).into_iter();
    let sparse = || Some(folder.join("sparse")).filter(|sparse| colmap::is_model(sparse));
    files.find(|file| file.is_file()).or_else(sparse)
}

/// The files of a Blender data set that are in this folder.
fn blender_sets(folder: &Path) -> impl Iterator<Item = PathBuf> + '_ {
    BLENDER_SETS.iter().map(|name| folder.join(name)).filter(|file| file.is_file())
}

/// Reads all cameras of a file: a `cameras.json` of the original 3DGS, a `transforms.json` of nerfstudio, instant-ngp
/// or the Blender data sets, a `camera_path.json` of nerfstudio, or a file of a sparse model of COLMAP. In a folder,
/// the first of these is read.
///
/// # Errors
/// One sentence without the file's name if it is none of them, is damaged, or holds a camera that no picture can be
/// drawn with.
pub fn read(path: &Path) -> Result<CameraFile> {
    read_at(path, None)
}

/// As [`read`]. Cameras of a `transforms.json` with an angle of view get the size `default_px` where neither the file
/// nor a photograph states one: Blender data sets do not.
///
/// # Errors
/// Those of [`read`].
pub fn read_at(path: &Path, default_px: Option<[u32; 2]>) -> Result<CameraFile> {
    let read = if path.is_dir() { read_folder(path, default_px) } else { read_file(path, default_px) }?;
    ensure!(!read.cameras.is_empty(), "holds no camera");
    Ok(read)
}

fn read_folder(folder: &Path, default_px: Option<[u32; 2]>) -> Result<CameraFile> {
    if let Some(read) = colmap::read_folder(folder) {
        return read;
    }
    if let Some(path) = in_folder(folder) {
        return read_at(&path, default_px)
            .with_context(|| path.file_name().unwrap_or_default().to_string_lossy().into_owned());
    }
    let named = |file: &Path| file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let all = blender_sets(folder).map(|file| read_file(&file, default_px).with_context(|| named(&file)));
    let all = all.reduce(|all, next| Ok(all?.and(next?)));
    all.context("is a folder with neither cameras.json, transforms.json nor a sparse model of COLMAP")?
}

fn read_file(path: &Path, default_px: Option<[u32; 2]>) -> Result<CameraFile> {
    if let Some(read) = colmap::read_file(path) {
        return read;
    }
    let text = read_whole(path)?;
    ensure!(!text.is_empty(), "the file is empty");
    let text = without_byte_order_mark(&text);
    match text.iter().find(|byte| !byte.is_ascii_whitespace()) {
        Some(b'[') => {
            let timed = cameras_json::parse(text)?;
            Ok(CameraFile { cameras: timed.into_iter().map(|(camera, _)| camera).collect(), ..CameraFile::default() })
        }
        Some(b'{') => {
            let file: Map<String, Value> = serde_json::from_slice(text).context("is not JSON")?;
            if nerfstudio_path::is_path(&file) {
                let (timeline, _) = nerfstudio_path::parse(file)?;
                return Ok(CameraFile { cameras: timeline.named(), ..CameraFile::default() });
            }
            transforms_json::parse(&file, path, default_px)
        }
        _ => bail!(
            "is not a camera file that smalto reads: expected cameras.json, transforms.json, or images.bin or .txt of \
             COLMAP, found bytes {:02x?}",
            &text[..text.len().min(4)]
        ),
    }
}
