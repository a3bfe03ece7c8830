//! Writes scenes to files, in the axes and the encoding of each format.

use std::io::Write;
use std::path::Path;

use anyhow::{Result, bail};
use rayon::prelude::*;

use super::rows::to_byte;
use super::sog::LOD_META;
use super::{Format, Writer, gltf, ply, sog, splat, spz, written_labels};
use crate::host_memory::OutOfMemory;
use crate::scene::{Gaussians, MAX_SH_DEGREE, USUAL_SH_DEGREE, morton};

/// The file formats that a scene can be written to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneFile {
    /// PLY of the original 3DGS: 32-bit floats.
    Ply,
    /// Compressed PLY of PlayCanvas: 16 bytes per Gaussian, and one per coefficient of degrees 1 and up.
    CompressedPly,
    /// `.splat`: 32 bytes per Gaussian, without view-dependent colour.
    Splat,
    /// SPZ. Version 3 is one gzip stream, 4 has a zstd stream per attribute.
    Spz { version: u32 },
    /// SOG of PlayCanvas: textures in one archive, with a palette of spherical harmonics.
    Sog,
    /// SOG in a folder, named by its `meta.json`.
    SogFolder,
    /// Binary glTF with KHR_gaussian_splatting: 32-bit floats.
    Glb,
}

impl SceneFile {
    /// The format that a file name stands for.
    ///
    /// # Errors
    /// If the name has no known extension and is not `meta.json`, or is that of a page file.
    pub fn of(path: &Path) -> Result<Self> {
        match Writer::of(path)? {
            Writer::Scene(file) => Ok(file),
            Writer::Pages => bail!("{}: a page file is written by `smalto convert`", path.display()),
        }
    }

    /// The Gaussians as the format holds them: in its order and up to its SH degree, without Gaussians that it would
    /// make fully transparent. A reader returns them in this order.
    ///
    /// # Errors
    /// [`OutOfMemory`] if the copy cannot be allocated.
    pub fn arranged(self, gaussians: &Gaussians) -> Result<Gaussians, OutOfMemory> {
        let mut kept: Vec<u32> = (0..gaussians.len() as u32).collect();
        if self.has_opacities_in_bytes() {
            kept.retain(|i| to_byte(f64::from(gaussians.opacities()[*i as usize])) > 0);
        }
        match self {
            // Neighbours share the bounds of a chunk, and similar neighbours compress well in a texture.
            Self::CompressedPly | Self::Sog | Self::SogFolder => morton::sort(gaussians.means(), &mut kept),
            // The most visible Gaussians come first, for viewers that draw while loading.
            Self::Splat => kept.par_sort_by(|a, b| {
                let [a, b] = [a, b].map(|i| importance(gaussians, *i as usize));
                b.total_cmp(&a)
            }),
            Self::Ply | Self::Spz { .. } | Self::Glb => {}
        }
        Ok(gaussians.selected(&kept)?.of_degree(self.most_sh_degree()))
    }

    /// The highest SH degree that the format holds.
    pub fn most_sh_degree(self) -> u32 {
        match self {
            Self::Ply | Self::Spz { version: 4 } => MAX_SH_DEGREE,
            Self::Splat => 0,
            // Readers of SPZ 3 that are older than SPZ 4 refuse higher degrees.
            Self::Spz { .. } | Self::CompressedPly | Self::Sog | Self::SogFolder | Self::Glb => USUAL_SH_DEGREE,
        }
    }

    fn has_opacities_in_bytes(self) -> bool {
        !matches!(self, Self::Ply | Self::Glb)
    }

    /// Writes a scene that is [`SceneFile::arranged`]. The same Gaussians give the same bytes on any number of cores.
    /// Both kinds of SOG are written as an archive; [`write_file`](super::write_file) writes a folder.
    ///
    /// # Errors
    /// If the format cannot hold the scene, or `out` fails.
    pub fn write(self, gaussians: &Gaussians, is_antialiased: bool, out: &mut impl Write) -> Result<()> {
        match self {
            Self::Ply => ply::write(gaussians, is_antialiased, out),
            Self::CompressedPly => ply::compressed_write::write(gaussians, is_antialiased, out),
            Self::Splat => splat::write(gaussians, out),
            Self::Spz { version } => spz::write(gaussians, is_antialiased, version, out),
            Self::Sog | Self::SogFolder => sog::write(gaussians, is_antialiased, out),
            Self::Glb => gltf::write(gaussians, out),
        }
    }

    /// The natural logarithms of the least and the largest scale that the format holds, if it has a range of its own.
    pub fn log_scales(self) -> Option<[f32; 2]> {
        match self {
            Self::Spz { .. } => Some([-10.0, 255.0 / 16.0 - 10.0]),
            Self::CompressedPly => Some([-20.0, 20.0]),
            Self::Ply | Self::Splat | Self::Sog | Self::SogFolder | Self::Glb => None,
        }
    }

    /// True if the format can state that the scene is drawn with the antialiasing of Mip-Splatting.
    pub fn says_antialiased(self) -> bool {
        !matches!(self, Self::Splat | Self::Glb)
    }
}

impl Writer {
    /// The form in which a file of this name is written.
    ///
    /// # Errors
    /// If the name has no known extension and is not `meta.json`.
    pub fn of(path: &Path) -> Result<Self> {
        if let Some(writer) = Format::of_name(path).and_then(|format| format.write) {
            return Ok(writer);
        }
        if path.file_name().is_some_and(|name| name.eq_ignore_ascii_case(LOD_META)) {
            bail!("{}: a streamed SOG is written by `smalto lod`", path.display());
        }
        bail!("{}: scenes are written as {}", path.display(), written_labels())
    }
}

/// Volume times opacity.
fn importance(gaussians: &Gaussians, index: usize) -> f32 {
    gaussians.scales()[index].iter().product::<f32>() * gaussians.opacities()[index]
}
