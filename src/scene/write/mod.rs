//! Scenes to files.

mod sog;

use std::io::{Seek, Write};
use std::path::Path;

use anyhow::Result;

use super::Gaussians;

/// Writes a scene as SOG 2 in a zip archive (.sog). Neighbours in the scene should be neighbours in space: they make textures
/// that compress well. The same bytes for the same Gaussians, on any number of threads.
///
/// # Errors
/// If `out` cannot be written.
pub fn write_sog(gaussians: &Gaussians, is_antialiased: bool, out: &mut (impl Write + Seek)) -> Result<()> {
    sog::write(gaussians, is_antialiased, out)
}

/// The same in a folder: its textures, and `meta.json` last.
///
/// # Errors
/// If the folder cannot be made, or a file in it not be written.
pub fn write_sog_folder(gaussians: &Gaussians, is_antialiased: bool, folder: &Path) -> Result<()> {
    sog::write_folder(gaussians, is_antialiased, folder)
}
