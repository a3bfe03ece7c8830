//! Writes images to files.

use std::path::Path;

use anyhow::{Result, bail};
use exr::prelude::{Encoding, Image, Layer, LayerAttributes, SpecificChannels, Vec2, WritableImage};
use image::codecs::openexr::OpenExrEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use npyz::WriterBuilder;
use serde::Serialize;

use super::{Pixels, Plane};
use crate::files::write_whole;

/// The file formats that an image can be written to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum FileKind {
    /// PNG with 8 bits per channel.
    Png,
    /// PNG with 16 bits per channel.
    Png16,
    /// OpenEXR of 32-bit floats, with premultiplied alpha.
    Exr,
    /// NumPy array of 32-bit floats, with premultiplied alpha: height, width, three or four channels.
    Npy,
}

impl FileKind {
    /// The format that the extension of a file name stands for: `.png` (8 bits), `.exr` or `.npy`.
    ///
    /// # Errors
    /// If the name has another extension, or none.
    pub fn of(path: &Path) -> Result<Self> {
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        match extension.to_str() {
            Some("png") => Ok(Self::Png),
            Some("exr") => Ok(Self::Exr),
            Some("npy") => Ok(Self::Npy),
            _ => bail!("{}: pictures are written as .png, .exr or .npy", path.display()),
        }
    }

    /// The file name extension, without its dot.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Png | Self::Png16 => "png",
            Self::Exr => "exr",
            Self::Npy => "npy",
        }
    }

    /// True if the format holds floats of any size, false if only values from 0 to 1.
    pub fn holds_floats(self) -> bool {
        matches!(self, Self::Exr | Self::Npy)
    }
}

impl Pixels {
    /// Writes a file of the format that its extension stands for, with an alpha channel if `transparent`.
    ///
    /// # Errors
    /// If the extension is unknown or the file cannot be written.
    pub fn write(&self, path: &Path, transparent: bool) -> Result<()> {
        self.write_as(FileKind::of(path)?, path, transparent)
    }

    /// Writes a file of this format, with an alpha channel if `transparent`.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_as(&self, kind: FileKind, path: &Path, transparent: bool) -> Result<()> {
        match kind {
            FileKind::Png => self.write_png(path, transparent),
            FileKind::Png16 => self.write_png16(path, transparent),
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

    /// Writes a 16-bit PNG, with a straight alpha channel if `transparent`.
    pub fn write_png16(&self, path: &Path, transparent: bool) -> Result<()> {
        let (words, kind) = if transparent {
            (self.to_rgba16(), ExtendedColorType::Rgba16)
        } else {
            (self.to_rgb16(), ExtendedColorType::Rgb16)
        };
        write_bytes(path, self.size, bytemuck::cast_slice(&words), kind)
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
        write_array(path, &[height, width, if transparent { 4 } else { 3 }], self.floats(transparent))
    }

    /// Three or four floats per pixel, one pixel after another.
    fn floats(&self, transparent: bool) -> Vec<f32> {
        let channels = if transparent { 4 } else { 3 };
        self.rgba.iter().flat_map(|p| &p[..channels]).copied().collect()
    }
}

impl Plane {
    /// Writes a file of this format: a grey PNG in which 1 is white, an OpenEXR file with one channel `Y` of 32-bit
    /// floats, or a NumPy array of 32-bit floats with the shape height, width.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_as(&self, kind: FileKind, path: &Path) -> Result<()> {
        let [height, width] = [self.size[1], self.size[0]].map(u64::from);
        match kind {
            FileKind::Png => write_bytes(path, self.size, &self.to_grey8(), ExtendedColorType::L8),
            FileKind::Png16 => {
                write_bytes(path, self.size, bytemuck::cast_slice(&self.to_grey16()), ExtendedColorType::L16)
            }
            FileKind::Exr => self.write_exr(path),
            FileKind::Npy => write_array(path, &[height, width], self.values.iter().copied()),
        }
    }

    fn write_exr(&self, path: &Path) -> Result<()> {
        let [width, height] = self.size.map(|side| side as usize);
        let value = |at: Vec2<usize>| (self.values[at.1 * width + at.0],);
        let channels = SpecificChannels::build().with_channel("Y").with_pixel_fn(value);
        let layer = Layer::new((width, height), LayerAttributes::default(), Encoding::SMALL_LOSSLESS, channels);
        write_whole(path, |file| Ok(Image::from_layer(layer).write().to_buffered(file)?))
    }
}

/// Writes a PNG from 8-bit pixels of red, green, blue and straight alpha.
///
/// # Errors
/// If the file cannot be written.
pub fn write_rgba8(path: &Path, size: [u32; 2], pixels: &[[u8; 4]]) -> Result<()> {
    write_bytes(path, size, bytemuck::cast_slice(pixels), ExtendedColorType::Rgba8)
}

fn write_bytes(path: &Path, [width, height]: [u32; 2], bytes: &[u8], kind: ExtendedColorType) -> Result<()> {
    write_whole(path, |file| Ok(PngEncoder::new(file).write_image(bytes, width, height, kind)?))
}

fn write_array(path: &Path, shape: &[u64], floats: impl IntoIterator<Item = f32>) -> Result<()> {
    write_whole(path, |file| {
        let mut array = npyz::WriteOptions::new().default_dtype().shape(shape).writer(file).begin_nd()?;
        array.extend(floats)?;
        Ok(array.finish()?)
    })
}
