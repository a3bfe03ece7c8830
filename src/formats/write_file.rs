//! Writes a scene to a file and reads it back, so that a damaged or lossy write is noticed.

use std::path::Path;

use anyhow::{Result, ensure};

use super::loss::Loss;
use super::read::read_back;
use super::sog::write_sog_folder;
use super::write::SceneFile;
use super::{FORMATS, Format, Recognition, Writer};
use crate::files::write_checked;
use crate::scene::{Gaussians, Scene, Watch};

/// A file that was written and read back.
pub struct WrittenFile {
    /// The name of its format.
    pub format: String,
    /// Its size in bytes; for a folder, that of all its files.
    pub bytes: u64,
    /// Differences that the format made.
    pub loss: Vec<Loss>,
}

/// Writes Gaussians that are [`SceneFile::arranged`] into a file or, for a SOG named by its `meta.json`, a folder, and
/// reads them back before they replace an older file. `progress` gets the fraction that is read back, 0 to 1.
///
/// # Errors
/// If the format cannot hold the scene, the file cannot be written, or is not what was written.
pub fn write_file(
    output: &Path,
    kind: SceneFile,
    gaussians: &Gaussians,
    is_antialiased: bool,
    progress: &dyn Fn(f64),
) -> Result<WrittenFile> {
    let read_again = |written: &Path| {
        let Scene { gaussians: found, format, .. } = read_back(written, &Watch::of_progress(progress))?;
        let (count, expected) = (found.len(), gaussians.len());
        ensure!(count == expected, "{count} of {expected} Gaussians could be read back");
        let bytes = if kind == SceneFile::SogFolder { all_bytes(written.parent())? } else { written.metadata()?.len() };
        Ok(WrittenFile { format, bytes, loss: Loss::between(gaussians, &found) })
    };
    if kind == SceneFile::SogFolder {
        let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        return write_sog_folder(gaussians, is_antialiased, folder, read_again);
    }
    // A format without a signature is recognized by its name.
    let format = FORMATS.iter().find(|format| format.write == Some(Writer::Scene(kind)));
    let named = format.filter(|format| format.recognition == Recognition::Ending);
    let ending = named.map_or_else(String::new, Format::label);
    write_checked(output, &ending, |file| kind.write(gaussians, is_antialiased, file), read_again)
}

/// The size of all files in a folder.
fn all_bytes(folder: Option<&Path>) -> Result<u64> {
    let files = std::fs::read_dir(folder.unwrap_or(Path::new(".")))?;
    files.map(|file| Ok(file?.metadata()?.len())).sum()
}
