//! Writes images to files.

use std::path::Path;

use anyhow::{Result, bail};
use exr::image::write::channels::WritableChannels;
use exr::prelude::{
    Blocks, Compression as ExrCompression, Encoding, Image, Layer, LayerAttributes, LineOrder, SpecificChannels, Vec2,
    WritableImage,
};
use image::ExtendedColorType;
use npyz::WriterBuilder;
use serde::Serialize;

use super::compression::Compression;
use super::{Pixels, Plane, png};
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

/// The alpha channel of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Alpha {
    /// The file has no alpha channel.
    Opaque,
    /// The file has an alpha channel with the coverage of each pixel.
    Transparent,
}

impl Alpha {
    /// [`Alpha::Transparent`] if the background of the picture is transparent.
    pub fn of(is_transparent: bool) -> Self {
        if is_transparent { Self::Transparent } else { Self::Opaque }
    }
}

impl Compression {
    fn of_exr(self) -> Encoding {
        let compression = match self {
            Self::Fast => ExrCompression::Uncompressed,
            Self::Small => ExrCompression::PIZ,
        };
        Encoding { compression, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing }
    }
}

/// Pixels as integers, row by row without gaps, as PNG files hold them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Integers {
    /// Red, green and blue in 8 bits each.
    Rgb8,
    /// Red, green and blue in 16 bits each.
    Rgb16,
    /// Coverage in 8 bits.
    Grey8,
    /// Coverage in 16 bits.
    Grey16,
}

impl Integers {
    fn colour_type(self) -> ExtendedColorType {
        match self {
            Self::Rgb8 => ExtendedColorType::Rgb8,
            Self::Rgb16 => ExtendedColorType::Rgb16,
            Self::Grey8 => ExtendedColorType::L8,
            Self::Grey16 => ExtendedColorType::L16,
        }
    }

    /// The bytes of a picture of this size.
    pub fn bytes(self, size: [u32; 2]) -> u64 {
        u64::from(self.colour_type().bits_per_pixel()) / 8 * u64::from(size[0]) * u64::from(size[1])
    }

    /// The words of a picture of this size, the last one filled up.
    pub fn words(self, size: [u32; 2]) -> usize {
        self.bytes(size).div_ceil(4) as usize
    }

    /// Writes a PNG of such pixels, from consecutive parts of whole rows. Integers of 16 bits have the byte order of
    /// this machine.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(self, path: &Path, size: [u32; 2], parts: &[&[u8]], compression: Compression) -> Result<()> {
        write_parts(path, size, parts, self.colour_type(), compression)
    }
}

impl Pixels {
    /// Writes a file of the format that its extension stands for: `.png` (8 bits), `.exr` or `.npy`.
    ///
    /// # Errors
    /// If the extension is unknown or the file cannot be written.
    pub fn write(&self, path: impl AsRef<Path>, alpha: Alpha) -> Result<()> {
        let path = path.as_ref();
        self.write_as(FileKind::of(path)?, Compression::Fast, path, alpha)
    }

    /// Writes a file of this format.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_as(&self, kind: FileKind, compression: Compression, path: &Path, alpha: Alpha) -> Result<()> {
        let png = |bytes: &[u8], kind| write_parts(path, self.size, &[bytes], kind, compression);
        match (kind, alpha) {
            (FileKind::Png, Alpha::Opaque) => png(&self.to_rgb8(), ExtendedColorType::Rgb8),
            (FileKind::Png, Alpha::Transparent) => png(&self.to_rgba8(), ExtendedColorType::Rgba8),
            (FileKind::Png16, Alpha::Opaque) => png(bytemuck::cast_slice(&self.to_rgb16()), ExtendedColorType::Rgb16),
            (FileKind::Png16, Alpha::Transparent) => {
                png(bytemuck::cast_slice(&self.to_rgba16()), ExtendedColorType::Rgba16)
            }
            (FileKind::Exr, _) => self.write_exr(compression, path, alpha),
            (FileKind::Npy, _) => self.write_npy(path, alpha),
        }
    }

    /// The bytes of a PNG file with 8 bits per channel.
    ///
    /// # Errors
    /// If PNG cannot hold pictures of this size.
    pub fn to_png(&self, alpha: Alpha) -> Result<Vec<u8>> {
        if alpha == Alpha::Opaque {
            return png_of_rgb8(self.size, &self.to_rgb8());
        }
        let mut file = Vec::new();
        png::write(&mut file, self.size, &[&self.to_rgba8()], ExtendedColorType::Rgba8, Compression::Fast)?;
        Ok(file)
    }

    fn write_exr(&self, compression: Compression, path: &Path, alpha: Alpha) -> Result<()> {
        let width = self.size[0] as usize;
        let pixel = |at: Vec2<usize>| self.rgba[at.1 * width + at.0];
        let colours = |[red, green, blue, _]: [f32; 4]| (red, green, blue);
        if alpha == Alpha::Transparent {
            let channels = SpecificChannels::rgba(|at| <(f32, f32, f32, f32)>::from(pixel(at)));
            write_whole(path, |file| Ok(exr(self.size, compression, channels).write().to_buffered(file)?))
        } else {
            let channels = SpecificChannels::rgb(|at| colours(pixel(at)));
            write_whole(path, |file| Ok(exr(self.size, compression, channels).write().to_buffered(file)?))
        }
    }

    /// Writes an OpenEXR file with the channels R, G, B, A and Z: colour over the background as in memory, coverage,
    /// and `depth`, which has the size of the image.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_with_depth(&self, depth: &Plane, path: &Path) -> Result<()> {
        let width = self.size[0] as usize;
        let value = |at: Vec2<usize>| {
            let place = at.1 * width + at.0;
            let [red, green, blue, alpha] = self.rgba[place];
            (red, green, blue, alpha, depth.values[place])
        };
        let channels = SpecificChannels::build().with_channel("R").with_channel("G").with_channel("B");
        let channels = channels.with_channel("A").with_channel("Z").with_pixel_fn(value);
        let image = exr(self.size, Compression::Fast, channels);
        write_whole(path, |file| Ok(image.write().to_buffered(file)?))
    }

    /// Writes an array of height, width, and three or, with alpha, four channels.
    fn write_npy(&self, path: &Path, alpha: Alpha) -> Result<()> {
        let [width, height] = self.size.map(u64::from);
        let channels = if alpha == Alpha::Transparent { 4 } else { 3 };
        let floats = self.rgba.iter().flat_map(|pixel| &pixel[..channels]).copied();
        write_array(path, &[height, width, channels as u64], floats)
    }
}

impl Plane {
    /// Writes a file of this format: a grey PNG in which 1 is white, an OpenEXR file with one channel `Y` of 32-bit
    /// floats, or a NumPy array of 32-bit floats with the shape height, width.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_as(&self, kind: FileKind, compression: Compression, path: &Path) -> Result<()> {
        let [height, width] = [self.size[1], self.size[0]].map(u64::from);
        match kind {
            FileKind::Png => Integers::Grey8.write(path, self.size, &[&self.to_grey8()], compression),
            FileKind::Png16 => {
                Integers::Grey16.write(path, self.size, &[bytemuck::cast_slice(&self.to_grey16())], compression)
            }
            FileKind::Exr => {
                let width = self.size[0] as usize;
                let value = |at: Vec2<usize>| (self.values[at.1 * width + at.0],);
                let channels = SpecificChannels::build().with_channel("Y").with_pixel_fn(value);
                write_whole(path, |file| Ok(exr(self.size, compression, channels).write().to_buffered(file)?))
            }
            FileKind::Npy => write_array(path, &[height, width], self.values.iter().copied()),
        }
    }
}

/// The bytes of the PNG file of 8-bit pixels of red, green and blue.
///
/// # Errors
/// If PNG cannot hold pictures of this size.
pub fn png_of_rgb8(size: [u32; 2], pixels: &[u8]) -> Result<Vec<u8>> {
    let mut file = Vec::new();
    png::write(&mut file, size, &[pixels], ExtendedColorType::Rgb8, Compression::Fast)?;
    Ok(file)
}

/// Writes a PNG from 8-bit pixels of red, green, blue and straight alpha.
///
/// # Errors
/// If the file cannot be written.
pub fn write_rgba8(path: &Path, size: [u32; 2], pixels: &[[u8; 4]]) -> Result<()> {
    write_parts(path, size, &[bytemuck::cast_slice(pixels)], ExtendedColorType::Rgba8, Compression::Fast)
}

fn write_parts(
    path: &Path,
    size: [u32; 2],
    parts: &[&[u8]],
    kind: ExtendedColorType,
    compression: Compression,
) -> Result<()> {
    write_whole(path, |file| png::write(file, size, parts, kind, compression))
}

/// An image of one layer, to be written as OpenEXR.
fn exr<'c, C: WritableChannels<'c> + 'c>(size: [u32; 2], compression: Compression, channels: C) -> Image<Layer<C>> {
    let size = size.map(|side| side as usize);
    Image::from_layer(Layer::new((size[0], size[1]), LayerAttributes::default(), compression.of_exr(), channels))
}

fn write_array(path: &Path, shape: &[u64], floats: impl IntoIterator<Item = f32>) -> Result<()> {
    write_whole(path, |file| {
        let mut array = npyz::WriteOptions::new().default_dtype().shape(shape).writer(file).begin_nd()?;
        array.extend(floats)?;
        Ok(array.finish()?)
    })
}
