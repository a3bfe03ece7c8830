//! Sparse models of COLMAP: `cameras` and `images`, as .bin or .txt. World to camera, axes right, down, forward.
//!
//! - `binary` - reads `cameras.bin` and `images.bin`
//! - `text` - reads `cameras.txt` and `images.txt`
//! - `models` - camera models, and the meaning of their parameters
//! - `photograph` - a posed photograph

mod binary;
mod models;
mod photograph;
mod text;

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use self::models::Intrinsics;
use self::photograph::Photograph;
use crate::camera::CameraFile;

/// The two files of a model.
struct Files {
    cameras: PathBuf,
    images: PathBuf,
    is_binary: bool,
}

impl Files {
    fn with_ending(folder: &Path, ending: &str) -> Self {
        let [cameras, images] = ["cameras", "images"].map(|name| folder.join(name).with_extension(ending));
        Self { cameras, images, is_binary: ending == "bin" }
    }

    /// The files of a model in this folder, if it has them.
    fn of(folder: &Path) -> Option<Self> {
        let both = ["bin", "txt"].map(|ending| Self::with_ending(folder, ending));
        both.into_iter().find(|files| files.cameras.is_file() && files.images.is_file())
    }

    fn read(&self) -> Result<CameraFile> {
        let read_cameras = if self.is_binary { binary::cameras } else { text::cameras };
        let read_images = if self.is_binary { binary::images } else { text::images };
        let named = |file: &Path| file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let cameras = read_cameras(&self.cameras).with_context(|| named(&self.cameras))?;
        let (mut photographs, announced) = read_images(&self.images).with_context(|| named(&self.images))?;
        // By their bytes, as the original 3DGS sorts them.
        photographs.sort_by(|a, b| a.name.cmp(&b.name));
        let count = photographs.len();
        let mut file = assembled(&cameras, photographs).with_context(|| named(&self.images))?;
        if let Some(announced) = announced.filter(|announced| *announced != count) {
            let images = named(&self.images);
            file.notices.push(format!("{images} states {announced} photographs but holds {count}"));
        }
        Ok(file)
    }
}

/// True if the folder is a model or holds models.
pub(super) fn is_model(folder: &Path) -> bool {
    !models_of(folder).is_empty()
}

/// Reads the model of a folder, or the one with the most photographs of the models in it. `None` if there is none.
pub(super) fn read_folder(folder: &Path) -> Option<Result<CameraFile>> {
    let models = models_of(folder);
    if models.len() <= 1 {
        return models.first().map(|(_, files)| files.read());
    }
    Some(largest(&models))
}

/// Reads the model that a file belongs to. `None` if its name is not that of a file of a model.
pub(super) fn read_file(path: &Path) -> Option<Result<CameraFile>> {
    let [stem, ending] = [path.file_stem()?.to_str()?, path.extension()?.to_str()?];
    let is_one = ["cameras", "images"].contains(&stem) && ["bin", "txt"].contains(&ending);
    is_one.then(|| Files::with_ending(path.parent().unwrap_or(Path::new("")), ending).read())
}

/// The models of a folder with their numbers. COLMAP makes a numbered folder for each.
fn models_of(folder: &Path) -> Vec<(u64, Files)> {
    if let Some(files) = Files::of(folder) {
        return vec![(0, files)];
    }
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let numbered = entries.filter_map(|entry| Some((entry.file_name()?.to_str()?.parse::<u64>().ok()?, entry)));
    let mut models: Vec<_> = numbered.filter_map(|(number, entry)| Some((number, Files::of(&entry)?))).collect();
    models.sort_by_key(|(number, _)| *number);
    models
}

fn largest(models: &[(u64, Files)]) -> Result<CameraFile> {
    let mut best: Option<(u64, CameraFile)> = None;
    for (number, files) in models {
        let read = files.read().with_context(|| format!("model {number}"))?;
        if best.as_ref().is_none_or(|(_, best)| read.cameras.len() > best.cameras.len()) {
            best = Some((*number, read));
        }
    }
    let (number, mut best) = best.context("there is no model")?;
    let (count, photographs) = (models.len(), best.cameras.len());
    best.notices.push(format!("model {number} with {photographs} photographs is used, the largest of {count} models"));
    Ok(best)
}

fn assembled(cameras: &HashMap<u32, Intrinsics>, photographs: Vec<Photograph>) -> Result<CameraFile> {
    let mut named = Vec::with_capacity(photographs.len());
    for photograph in photographs {
        let camera = photograph.seen_with(cameras);
        named.push(camera.with_context(|| photograph.name.escape_debug().to_string())?);
    }
    Ok(CameraFile { cameras: named, ..CameraFile::default() })
}
