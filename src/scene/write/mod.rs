//! Scenes to files, in the axes and the encoding of every format.

mod compressed_ply;
mod gltf;
mod ply;
mod rows;
mod sog;
mod splat;
mod spz;

use std::io::{Seek, Write};
use std::path::Path;

use anyhow::{Result, bail};
use rayon::prelude::*;

use self::rows::to_byte;
use super::{Gaussians, morton};
use crate::host_memory::OutOfMemory;

/// The files that a scene can be written to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneFile {
    /// Of the original 3DGS: 32-bit floats.
    Ply,
    /// Of PlayCanvas: 16 bytes a Gaussian, and one for each coefficient past degree 0.
    CompressedPly,
    /// 32 bytes a Gaussian, without view-dependent colour.
    Splat,
    /// Version 3 is one gzip stream, 4 a zstd stream for every attribute.
    Spz { version: u32 },
    /// Textures of PlayCanvas in one archive, with a palette of spherical harmonics.
    Sog,
    /// The same in a folder, whose `meta.json` it is called by.
    SogFolder,
    /// Binary glTF with KHR_gaussian_splatting: 32-bit floats.
    Glb,
}

impl SceneFile {
    /// The one that this file name asks for.
    pub fn of(path: &Path) -> Result<Self> {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        Ok(match name {
            _ if name.ends_with(".compressed.ply") => Self::CompressedPly,
            _ if name.ends_with(".ply") => Self::Ply,
            _ if name.ends_with(".splat") => Self::Splat,
            _ if name.ends_with(".spz") => Self::Spz { version: 4 },
            _ if name.ends_with(".sog") => Self::Sog,
            _ if name == "meta.json" => Self::SogFolder,
            _ if name.ends_with(".glb") => Self::Glb,
            _ => bail!(
                "{}: scenes are written as .ply, .compressed.ply, .splat, .spz, .sog, meta.json (of SOG) or .glb",
                path.display()
            ),
        })
    }

    /// What its Gaussians become: in the order of the format, without those that would be fully transparent in it, and
    /// of the degrees of spherical harmonics that it has. What is written of these is read in their order.
    pub fn arranged(self, gaussians: &Gaussians) -> Result<Gaussians, OutOfMemory> {
        let mut kept: Vec<u32> = (0..gaussians.len() as u32).collect();
        if self.has_opacities_in_bytes() {
            kept.retain(|i| to_byte(f64::from(gaussians.opacities()[*i as usize])) > 0);
        }
        match self {
            // Neighbours share the bounds of a chunk, and are alike beside one another in a texture.
            Self::CompressedPly | Self::Sog | Self::SogFolder => morton::sort(gaussians.means(), &mut kept),
            // What is seen most comes first, for those who draw what has arrived.
            Self::Splat => kept.par_sort_by(|a, b| {
                let [a, b] = [a, b].map(|i| importance(gaussians, *i as usize));
                b.total_cmp(&a)
            }),
            Self::Ply | Self::Spz { .. } | Self::Glb => {}
        }
        let arranged = gaussians.selected(&kept)?;
        Ok(if self == Self::Splat { arranged.of_degree(0) } else { arranged })
    }

    fn has_opacities_in_bytes(self) -> bool {
        !matches!(self, Self::Ply | Self::Glb)
    }

    /// Writes a scene that is [`SceneFile::arranged`]: the same bytes for the same Gaussians, on any number of cores. A SOG
    /// in a folder is written by [`write_sog_folder`], and here as an archive.
    pub fn write(self, gaussians: &Gaussians, is_antialiased: bool, out: &mut (impl Write + Seek)) -> Result<()> {
        match self {
            Self::Ply => ply::write(gaussians, is_antialiased, out),
            Self::CompressedPly => compressed_ply::write(gaussians, is_antialiased, out),
            Self::Splat => splat::write(gaussians, out),
            Self::Spz { version } => spz::write(gaussians, is_antialiased, version, out),
            Self::Sog | Self::SogFolder => sog::write(gaussians, is_antialiased, out),
            Self::Glb => gltf::write(gaussians, out),
        }
    }

    /// Whether the file can say that the scene is drawn with the antialiasing of Mip-Splatting.
    pub fn says_antialiased(self) -> bool {
        !matches!(self, Self::Splat | Self::Glb)
    }
}

/// Volume times opacity.
fn importance(gaussians: &Gaussians, index: usize) -> f32 {
    gaussians.scales()[index].iter().product::<f32>() * gaussians.opacities()[index]
}

/// Writes a scene that is [`SceneFile::arranged`] as SOG 2 into a folder: its textures, and `meta.json` last.
///
/// # Errors
/// If the folder cannot be made, or a file in it not be written.
pub fn write_sog_folder(gaussians: &Gaussians, is_antialiased: bool, folder: &Path) -> Result<()> {
    sog::write_folder(gaussians, is_antialiased, folder)
}
