//! Images to files.

use std::path::Path;

use anyhow::{Result, bail};
use image::codecs::openexr::OpenExrEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use npyz::WriterBuilder;

use super::Pixels;
use crate::files::write_whole;

/// The files that an image can be written to, each named by its extension.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FileKind {
    /// 8 bits a channel.
    Png,
    /// 32-bit floats as they are, alpha multiplied in.
    Exr,
    /// The same as an array of rows of pixels of three or four floats.
    Npy,
}

impl FileKind {
    /// The kind that this file name asks for.
    pub fn of(path: &Path) -> Result<Self> {
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        match extension.to_str() {
            Some("png") => Ok(Self::Png),
            Some("exr") => Ok(Self::Exr),
            Some("npy") => Ok(Self::Npy),
            _ => bail!("{}: pictures are written as .png, .exr or .npy", path.display()),
        }
    }
}

impl Pixels {
    /// Writes the kind of file that the extension names, with an alpha channel if `transparent`.
    pub fn write(&self, path: &Path, transparent: bool) -> Result<()> {
        match FileKind::of(path)? {
            FileKind::Png => self.write_png(path, transparent),
            FileKind::Exr => self.write_exr(path, transparent),
            FileKind::Npy => self.write_npy(path, transparent),
        }
    }

    /// Writes an 8-bit PNG, with a straight alpha channel if `transparent`.
    pub fn write_png(&self, path: &Path, transparent: bool) -> Result<()> {
        let (bytes, kind) = if transparent {
            (self.to_rgba8(), ExtendedColorType::Rgba8)
        } else {
            (self.to_rgb8(), ExtendedColorType::Rgb8)
        };
        write_bytes(path, self.size, &bytes, kind)
    }

    /// Writes an OpenEXR file of 32-bit floats, with an alpha channel if `transparent`.
    pub fn write_exr(&self, path: &Path, transparent: bool) -> Result<()> {
        let kind = if transparent { ExtendedColorType::Rgba32F } else { ExtendedColorType::Rgb32F };
        let floats = self.floats(transparent);
        write_whole(path, |file| {
            let [width, height] = self.size;
            Ok(OpenExrEncoder::new(file).write_image(bytemuck::cast_slice(&floats), width, height, kind)?)
        })
    }

    /// Writes a NumPy array of 32-bit floats: height, width, and three or, if `transparent`, four channels.
    pub fn write_npy(&self, path: &Path, transparent: bool) -> Result<()> {
        let [width, height] = self.size.map(u64::from);
        let shape = [height, width, if transparent { 4 } else { 3 }];
        write_whole(path, |file| {
            let mut array = npyz::WriteOptions::new().default_dtype().shape(&shape).writer(file).begin_nd()?;
            array.extend(self.floats(transparent))?;
            Ok(array.finish()?)
        })
    }

    /// Channel by channel, pixel by pixel.
    fn floats(&self, transparent: bool) -> Vec<f32> {
        let channels = if transparent { 4 } else { 3 };
        self.rgba.iter().flat_map(|p| &p[..channels]).copied().collect()
    }
}

/// Writes a PNG of pixels that are in 8 bits already: red, green, blue and alpha.
pub fn write_rgba8(path: &Path, size: [u32; 2], pixels: &[[u8; 4]]) -> Result<()> {
    write_bytes(path, size, bytemuck::cast_slice(pixels), ExtendedColorType::Rgba8)
}

fn write_bytes(path: &Path, [width, height]: [u32; 2], bytes: &[u8], kind: ExtendedColorType) -> Result<()> {
    write_whole(path, |file| Ok(PngEncoder::new(file).write_image(bytes, width, height, kind)?))
}
