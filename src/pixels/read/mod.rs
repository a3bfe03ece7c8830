//! Reads images from files.
//!
//! - `npy` - images as NumPy arrays; this file reads the other formats

mod npy;

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use bytemuck::Pod;
use exr::math::Vec2;
use exr::meta::MetaData;
use exr::prelude::{ReadChannels, ReadLayers};
use image::codecs::jpeg::JpegDecoder;
use image::codecs::openexr::OpenExrDecoder;
use image::codecs::png::PngDecoder;
use image::{ImageDecoder, Limits};

use crate::files::open_regular;
use crate::host_memory::{OutOfMemory, check_free, host_vec, host_zeros};
use crate::pixels::Pixels;

/// Most pixels of a picture: those of 16384x16384.
const MOST_PIXELS: u64 = 1 << 28;

/// Bytes per pixel that decoders use besides their output: coefficients of a progressive JPEG with four components in
/// 16 bits, or the floats of an OpenEXR file.
const DECODER_BYTES: u64 = 16;

/// Most bytes of samples that a byte of an OpenEXR file can hold, rounded up: its compressions reach about a thousand.
const MOST_EXPANSION: u64 = 4096;

/// Pixels of an OpenEXR image that need not be in proportion to its file: most of them may lie outside of its data.
const SMALL: u64 = 1 << 22;

/// Most bytes that the parts of a PNG besides its pixels may have when they are unpacked, such as a colour profile.
const MOST_EXTRA_BYTES: u64 = 1 << 28;

/// An image of a file, and which channels the file has.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// The image. See [`Pixels::read`] for what becomes of grey, alpha and missing depths.
    pub pixels: Pixels,
    /// The kind of its channels, apart from alpha.
    pub channels: Channels,
    /// The file has an alpha channel.
    pub has_alpha: bool,
}

/// The channels of a picture file, apart from alpha.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channels {
    /// One channel of floats. They may be depths or counts, and need not lie between 0 and 1.
    Numbers,
    /// One channel of integers from black to white.
    Grey,
    /// Red, green and blue.
    Colours,
}

impl Picture {
    /// Reads a picture file as [`Pixels::read`] does.
    ///
    /// # Errors
    /// Those of [`Pixels::read`].
    pub fn read(path: &Path) -> Result<Self> {
        let mut reader = BufReader::new(open_regular(path)?);
        let mut magic = Vec::new();
        reader.by_ref().take(8).read_to_end(&mut magic).context("cannot be read")?;
        reader.rewind()?;
        match &magic[..] {
            [] => bail!("the file is empty"),
            [0x89, b'P', b'N', b'G', ..] => Ok(png(reader)?.premultiplied()),
            [0xff, 0xd8, 0xff, ..] => decode(JpegDecoder::new(reader).context(UNDECODABLE)?),
            [0x76, 0x2f, 0x31, 0x01, ..] => open_exr(reader),
            [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => npy::read(reader),
            _ => bail!("not an image that smalto reads: expected PNG, JPEG, OpenEXR or .npy content"),
        }
    }

    fn premultiplied(mut self) -> Self {
        for [r, g, b, a] in &mut self.pixels.rgba {
            [*r, *g, *b] = [*r * *a, *g * *a, *b * *a];
        }
        self
    }
}

impl Pixels {
    /// Reads a PNG (grey or colour, up to 16 bits), JPEG, OpenEXR or .npy file. The format is detected from the
    /// content.
    ///
    /// An array has the shape height, width or height, width, channels with one, three or four channels: floats are
    /// taken as they are, bytes are divided by 255. An image of one channel (depths, counts) becomes grey; NaN in it
    /// becomes 0 with coverage 0. The straight alpha of a PNG is multiplied in; without alpha, coverage is 1.
    ///
    /// # Errors
    /// A clause without the file's name if the file cannot be opened, has another format, or is damaged.
    /// [`OutOfMemory`] if its header states more than 2^28 pixels, or more than the host has memory for.
    pub fn read(path: &Path) -> Result<Self> {
        Picture::read(path).map(|picture| picture.pixels)
    }
}

const UNDECODABLE: &str = "cannot be decoded";

/// Fails if an image of this size is too large, before anything is decoded. `sample_bytes` is the size of a decoded
/// pixel.
fn check_room([width, height]: [u32; 2], sample_bytes: u64) -> Result<(), OutOfMemory> {
    let pixels = u64::from(width) * u64::from(height);
    let (name, bytes) = (format!("{width}x{height} pixels"), pixels.saturating_mul(16 + sample_bytes + DECODER_BYTES));
    if pixels > MOST_PIXELS {
        let reason = format!("pictures have up to {MOST_PIXELS} pixels (16384x16384)");
        return Err(OutOfMemory { name, bytes: Some(bytes), reason });
    }
    check_free(bytes, &name)
}

fn png(file: BufReader<File>) -> Result<Picture> {
    let mut limits = Limits::default();
    limits.max_alloc = Some(MOST_EXTRA_BYTES);
    decode(PngDecoder::with_limits(file, limits).context(UNDECODABLE)?)
}

fn decode(decoder: impl ImageDecoder) -> Result<Picture> {
    let (width, height) = decoder.dimensions();
    let (size, color) = ([width, height], decoder.color_type());
    let count = usize::from(color.channel_count());
    check_room(size, color.bytes_per_pixel().into())?;
    let rgba = match usize::from(color.bytes_per_pixel()) / count {
        1 => coloured(&samples::<u8>(decoder)?, count, |v| f32::from(*v) / 255.0),
        2 => coloured(&samples::<u16>(decoder)?, count, |v| f32::from(*v) / 65535.0),
        _ => coloured(&samples::<f32>(decoder)?, count, |v| *v),
    }?;
    let channels = if color.has_color() { Channels::Colours } else { Channels::Grey };
    Ok(Picture { pixels: Pixels { size, rgba }, channels, has_alpha: color.has_alpha() })
}

/// All samples of an image whose samples are of the type `T`, one pixel after another.
fn samples<T: Pod>(decoder: impl ImageDecoder) -> Result<Vec<T>> {
    let mut samples = host_zeros(usize::try_from(decoder.total_bytes())? / size_of::<T>(), "a picture")?;
    decoder.read_image(bytemuck::cast_slice_mut(&mut samples)).context(UNDECODABLE)?;
    Ok(samples)
}

/// Pixels of grey, grey and alpha, colour, or colour and alpha, by the number of `channels`.
fn coloured<T>(samples: &[T], channels: usize, value: impl Fn(&T) -> f32) -> Result<Vec<[f32; 4]>, OutOfMemory> {
    let mut rgba = host_vec(samples.len() / channels, "a picture")?;
    rgba.extend(samples.chunks_exact(channels).map(|pixel| match pixel {
        [grey] => self::grey(value(grey)),
        [grey, alpha] => [value(grey), value(grey), value(grey), value(alpha)],
        [r, g, b, rest @ ..] => [value(r), value(g), value(b), rest.first().map_or(1.0, &value)],
        [] => [0.0; 4],
    }));
    Ok(rgba)
}

/// Decodes an OpenEXR file of colours or of one channel.
fn open_exr(mut file: BufReader<File>) -> Result<Picture> {
    let headers = MetaData::read_from_buffered(&mut file, false).context(UNDECODABLE)?.headers;
    file.rewind()?;
    let length = file.get_ref().metadata()?.len();
    for header in &headers {
        // The image that is made has the size of the display window, which may be larger than that of the data.
        for Vec2(width, height) in [header.layer_size, header.shared_attributes.display_window.size] {
            let pixels = (width as u64).saturating_mul(height as u64);
            let bytes = pixels.saturating_mul(2 * header.channels.list.len() as u64);
            let is_possible = pixels <= SMALL || bytes <= length.saturating_mul(MOST_EXPANSION);
            ensure!(is_possible, "its {length} bytes cannot hold {width}x{height} pixels");
        }
    }
    if headers.iter().any(|header| header.channels.list.len() != 1) {
        return decode(OpenExrDecoder::new(file).context(UNDECODABLE)?);
    }
    for header in &headers {
        check_room([header.layer_size.width(), header.layer_size.height()].map(|side| side as u32), 4)?;
    }
    let layers = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let layer = layers.all_attributes().from_buffered(file).context(UNDECODABLE)?.layer_data;
    let size = [layer.size.width(), layer.size.height()].map(|side| side as u32);
    let mut rgba = host_vec(layer.size.area(), "a picture")?;
    rgba.extend(layer.channel_data.list[0].sample_data.values_as_f32().map(grey));
    Ok(Picture { pixels: Pixels { size, rgba }, channels: Channels::Numbers, has_alpha: false })
}

/// A pixel of an image with one channel.
fn grey(value: f32) -> [f32; 4] {
    if value.is_nan() { [0.0; 4] } else { [value, value, value, 1.0] }
}

#[cfg(test)]
mod tests {
    use image::{DynamicImage, GrayAlphaImage, GrayImage, ImageBuffer, Luma, LumaA, Rgba};

    use npyz::Order;

    use super::*;
    use crate::pixels::{Alpha, Compression, FileKind, Plane};

    /// Values that 8 bits cannot hold, among them NaN, infinity and -0.
    fn floats() -> Pixels {
        let value = |i: u32| [i as f32 * 0.37 - 0.5, 1.0 / (i + 3) as f32, f32::MIN_POSITIVE, (i % 3) as f32 / 2.0];
        let mut pixels = Pixels { size: [5, 3], rgba: (0..15).map(value).collect() };
        pixels.rgba[4] = [f32::NAN, f32::INFINITY, -0.0, 1.0];
        pixels
    }

    fn bits(pixels: &Pixels) -> Vec<[u32; 4]> {
        pixels.rgba.iter().map(|p| p.map(f32::to_bits)).collect()
    }

    fn written(pixels: &Pixels, name: &str, transparent: bool) -> Pixels {
        let folder = tempfile::tempdir().unwrap();
        pixels.write(folder.path().join(name), Alpha::of(transparent)).unwrap();
        // The name does not matter.
        std::fs::rename(folder.path().join(name), folder.path().join("picture")).unwrap();
        Pixels::read(&folder.path().join("picture")).unwrap()
    }

    #[test]
    fn exr_and_npy_keep_every_bit_of_floats() {
        let pixels = floats();
        let opaque = Pixels { rgba: pixels.rgba.iter().map(|p| [p[0], p[1], p[2], 1.0]).collect(), ..pixels.clone() };
        for name in ["a.exr", "a.NPY"] {
            let back = written(&pixels, name, true);
            assert_eq!((back.size, bits(&back)), (pixels.size, bits(&pixels)), "{name}");
            assert_eq!(bits(&written(&pixels, name, false)), bits(&opaque), "{name} without alpha");
        }
    }

    #[test]
    fn png_keeps_8_bit_values() {
        let pixels = Pixels { size: [256, 1], rgba: (0..256).map(|i| [i as f32 / 255.0, 0.0, 1.0, 1.0]).collect() };
        assert_eq!(written(&pixels, "a.png", false), pixels);
        // The file has straight alpha, memory premultiplied alpha: two 8-bit roundings lie between them.
        let half = Pixels { size: [1, 1], rgba: vec![[0.25, 0.5, 0.0, 0.5]] };
        let back = written(&half, "a.png", true).at(0, 0);
        assert!(back.iter().zip(half.at(0, 0)).all(|(x, y)| (x - y).abs() < 1.0 / 255.0), "{back:?}");
    }

    #[test]
    fn png_may_be_grey_or_have_16_bits() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let read = |image: DynamicImage| {
            image.save(&path).unwrap();
            Pixels::read(&path).unwrap().at(0, 0)
        };
        assert_eq!(read(GrayImage::from_pixel(1, 1, Luma([51])).into()), [0.2, 0.2, 0.2, 1.0]);
        assert_eq!(read(ImageBuffer::from_pixel(1, 1, Luma([13107_u16])).into()), [0.2, 0.2, 0.2, 1.0]);
        let [r, _, b, a] = read(ImageBuffer::from_pixel(1, 1, Rgba([65535_u16, 0, 13107, 13107])).into());
        assert_eq!([r, b, a], [0.2, 0.2 * 0.2, 0.2]);
        assert_eq!(read(GrayAlphaImage::from_pixel(1, 1, LumaA([255, 51])).into()), [0.2; 4]);
    }

    fn save<T: npyz::AutoSerialize + Copy>(path: &Path, shape: &[u64], order: Order, values: &[T]) {
        use npyz::WriterBuilder;
        let file = File::create(path).unwrap();
        let mut array =
            npyz::WriteOptions::new().default_dtype().shape(shape).order(order).writer(file).begin_nd().unwrap();
        array.extend(values.iter().copied()).unwrap();
        array.finish().unwrap();
    }

    #[test]
    fn npy_may_hold_halves_doubles_or_bytes_in_either_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        save(&path, &[1, 1, 4], Order::C, &[0.1_f64, 2.0, -1.0, 0.5]);
        assert_eq!(Pixels::read(&path).unwrap().at(0, 0), [0.1, 2.0, -1.0, 0.5]);
        save(&path, &[2, 1, 3], Order::C, &[0_u8, 51, 255, 1, 2, 3]);
        let bytes = Pixels::read(&path).unwrap();
        assert_eq!((bytes.size, bytes.at(0, 0)), ([1, 2], [0.0, 0.2, 1.0, 1.0]));
        save(&path, &[1, 1, 3], Order::C, &[0.5, -2.0, 65504.0].map(half::f16::from_f32));
        assert_eq!(Pixels::read(&path).unwrap().at(0, 0), [0.5, -2.0, 65504.0, 1.0]);
        // Two rows of three pixels of four channels; value 100 y + 10 x + channel.
        let value = |y: u8, x: u8, channel: u8| f32::from(100 * y + 10 * x + channel);
        let by_pixel: Vec<f32> = (0..24).map(|i| value(i / 12, i / 4 % 3, i % 4)).collect();
        let by_channel: Vec<f32> = (0..24).map(|i| value(i % 2, i / 2 % 3, i / 6)).collect();
        save(&path, &[2, 3, 4], Order::C, &by_pixel);
        let expected = Pixels::read(&path).unwrap();
        save(&path, &[2, 3, 4], Order::Fortran, &by_channel);
        assert_eq!((Pixels::read(&path).unwrap(), expected.at(2, 1)[1]), (expected.clone(), 121.0));
        save(&path, &[2, 3], Order::Fortran, &[0.0_f32, 3.0, 1.0, 4.0, 2.0, 5.0]);
        let plane: Vec<f32> = Pixels::read(&path).unwrap().rgba.iter().map(|p| p[0]).collect();
        assert_eq!(plane, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    }

    #[test]
    fn one_channel_is_read_as_grey() {
        let folder = tempfile::tempdir().unwrap();
        let plane = Plane { size: [3, 2], values: vec![-2.0, f32::INFINITY, 0.0, f32::NAN, 1e-30, 17.3] };
        let mut grey: Vec<_> = plane.values.iter().map(|v| [*v, *v, *v, 1.0]).collect();
        grey[3] = [0.0; 4];
        for kind in [FileKind::Exr, FileKind::Npy] {
            let path = folder.path().join("a");
            plane.write_as(kind, Compression::Fast, &path).unwrap();
            assert_eq!(Pixels::read(&path).unwrap(), Pixels { size: [3, 2], rgba: grey.clone() });
        }
        let path = folder.path().join("a.npy");
        save(&path, &[2, 3, 1], Order::C, &plane.values);
        assert_eq!(Pixels::read(&path).unwrap().rgba, grey);
    }

    #[test]
    fn files_that_are_not_images_are_refused_in_a_sentence() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let problem = || format!("{:#}", Pixels::read(&path).unwrap_err());
        assert_eq!(problem(), "cannot be opened: there is no such file");
        let of_bytes = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            problem()
        };
        assert_eq!(of_bytes(b""), "the file is empty");
        assert!(of_bytes(b"GIF89a").starts_with("not an image that smalto reads"));
        for magic in [&b"\x89PNG\r\n\x1a\n"[..], b"\x76\x2f\x31\x01\0\0\0\0", b"\x93NUMPY\x01\x00"] {
            let problem = of_bytes(magic);
            assert!(problem.starts_with("cannot be decoded") || problem.starts_with("is a damaged .npy"), "{problem}");
        }
        save(&path, &[4, 2, 2], Order::C, &[0.0_f32; 16]);
        assert_eq!(problem(), "is an array of shape [4, 2, 2], not of height, width and 1, 3 or 4 channels");
        save(&path, &[0, 4, 3], Order::C, &[0.0_f32; 0]);
        assert_eq!(problem(), "is an array of shape [0, 4, 3], which is no picture");
        save(&path, &[1, 1, 3], Order::C, &[0_i32; 3]);
        assert_eq!(problem(), "is an array of '<i4', not of f2, f4, f8 or u1");
        // Truncated files.
        save(&path, &[4, 4, 3], Order::C, &[0.0_f32; 48]);
        let part = std::fs::read(&path).unwrap();
        assert!(of_bytes(&part[..part.len() - 1]).starts_with("is a damaged .npy file"));
        floats().write(folder.path().join("a.exr"), Alpha::Transparent).unwrap();
        let part = std::fs::read(folder.path().join("a.exr")).unwrap();
        assert!(of_bytes(&part[..part.len() / 2]).starts_with("cannot be decoded"));
    }
}
