//! Reads images from files.

use std::fs::File;
use std::io::{BufReader, ErrorKind, Read, Seek};
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};
use exr::meta::MetaData;
use exr::prelude::{ReadChannels, ReadLayers};
use image::{ImageFormat, ImageReader, Limits};
use npyz::{NpyFile, Order};

use super::Pixels;

/// Largest allocation for decoding in bytes: a picture of 16384x16384 pixels of four floats.
const MOST_BYTES: u64 = 1 << 32;

impl Pixels {
    /// Reads a PNG (grey or colour, 8 or 16 bits), JPEG, OpenEXR or .npy file. The format is detected from the content.
    ///
    /// An array has the shape height, width or height, width, channels with one, three or four channels: floats are
    /// taken as they are, bytes are divided by 255. An image of one channel (depths, counts) becomes grey; NaN in it
    /// becomes 0 with coverage 0. The straight alpha of a PNG is multiplied in; without alpha, coverage is 1.
    ///
    /// # Errors
    /// A clause without the file's name if the file cannot be opened, has another format, or is damaged.
    pub fn read(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|error| match error.kind() {
            ErrorKind::NotFound => anyhow!("cannot be opened: there is no such file"),
            _ => anyhow!("cannot be opened: {error}"),
        })?;
        ensure!(file.metadata()?.is_file(), "is not a file");
        let mut reader = BufReader::new(file);
        let mut magic = Vec::new();
        reader.by_ref().take(8).read_to_end(&mut magic).context("cannot be read")?;
        reader.rewind()?;
        match &magic[..] {
            [] => bail!("the file is empty"),
            [0x89, b'P', b'N', b'G', ..] => Ok(decode(reader, ImageFormat::Png)?.premultiplied()),
            [0xff, 0xd8, 0xff, ..] => decode(reader, ImageFormat::Jpeg),
            [0x76, 0x2f, 0x31, 0x01, ..] => open_exr(reader),
            [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => array(reader),
            _ => bail!("not an image that smalto reads: expected PNG, JPEG, OpenEXR or .npy content"),
        }
    }

    fn premultiplied(mut self) -> Self {
        for [r, g, b, a] in &mut self.rgba {
            [*r, *g, *b] = [*r * *a, *g * *a, *b * *a];
        }
        self
    }
}

fn decode(file: BufReader<File>, format: ImageFormat) -> Result<Pixels> {
    let mut reader = ImageReader::with_format(file, format);
    let mut limits = Limits::default();
    limits.max_alloc = Some(MOST_BYTES);
    reader.limits(limits);
    let image = reader.decode().context("cannot be decoded")?;
    let size = [image.width(), image.height()];
    let rgba = match image.color().bytes_per_pixel() / image.color().channel_count() {
        1 => image.into_rgba8().pixels().map(|p| p.0.map(|v| f32::from(v) / 255.0)).collect(),
        2 => image.into_rgba16().pixels().map(|p| p.0.map(|v| f32::from(v) / 65535.0)).collect(),
        _ => image.into_rgba32f().pixels().map(|p| p.0).collect(),
    };
    Ok(Pixels { size, rgba })
}

/// Decodes an OpenEXR file of colours or of one channel.
fn open_exr(mut file: BufReader<File>) -> Result<Pixels> {
    let headers = MetaData::read_from_buffered(&mut file, false).context("cannot be decoded")?.headers;
    file.rewind()?;
    if headers.iter().any(|header| header.channels.list.len() != 1) {
        return decode(file, ImageFormat::OpenExr);
    }
    let bytes = headers.iter().map(|header| 4 * header.layer_size.area() as u64).sum::<u64>();
    ensure!(bytes <= MOST_BYTES, "takes {bytes} bytes, over {MOST_BYTES}");
    let layers = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let layer = layers.all_attributes().from_buffered(file).context("cannot be decoded")?.layer_data;
    let size = [layer.size.width(), layer.size.height()].map(|side| side as u32);
    let values = layer.channel_data.list[0].sample_data.values_as_f32();
    Ok(Pixels { size, rgba: values.map(grey).collect() })
}

fn array(file: BufReader<File>) -> Result<Pixels> {
    let array = NpyFile::new(file).context("is a damaged .npy file")?;
    let shape = array.shape().to_vec();
    let (height, width, channels) = match shape[..] {
        [height, width] => (height, width, 1),
        [height, width, channels @ (1 | 3 | 4)] => (height, width, channels),
        _ => bail!("is an array of shape {shape:?}, not of height, width and 1, 3 or 4 channels"),
    };
    let sides = u32::try_from(width).ok().zip(u32::try_from(height).ok()).filter(|(w, h)| *w > 0 && *h > 0);
    let (width, height) = sides.with_context(|| format!("is an array of shape {shape:?}, which is no picture"))?;
    ensure!(array.order() == Order::C, "is an array in Fortran order");
    let values = values(array)?;
    let pixel = |p: &[f32]| match *p {
        [value] => grey(value),
        _ => [p[0], p[1], p[2], p.get(3).copied().unwrap_or(1.0)],
    };
    Ok(Pixels { size: [width, height], rgba: values.chunks_exact(channels as usize).map(pixel).collect() })
}

/// A pixel of an image with one channel.
fn grey(value: f32) -> [f32; 4] {
    if value.is_nan() { [0.0; 4] } else { [value, value, value, 1.0] }
}

/// All elements as f32: floats as they are, bytes divided by 255.
fn values(array: NpyFile<BufReader<File>>) -> Result<Vec<f32>> {
    let damaged = "is a damaged .npy file";
    let array = match array.try_data::<f32>() {
        Ok(floats) => return floats.collect::<Result<_, _>>().context(damaged),
        Err(array) => array,
    };
    let array = match array.try_data::<f64>() {
        Ok(doubles) => return doubles.map(|v| Ok(v? as f32)).collect::<std::io::Result<_>>().context(damaged),
        Err(array) => array,
    };
    match array.try_data::<u8>() {
        Ok(bytes) => bytes.map(|v| Ok(f32::from(v?) / 255.0)).collect::<std::io::Result<_>>().context(damaged),
        Err(array) => bail!("is an array of {}, not of f4, f8 or u1", array.dtype().descr()),
    }
}

#[cfg(test)]
mod tests {
    use image::{DynamicImage, GrayAlphaImage, GrayImage, ImageBuffer, Luma, LumaA, Rgba};

    use super::super::{FileKind, Plane};
    use super::*;

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
        pixels.write(&folder.path().join(name), transparent).unwrap();
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
    fn npy_may_hold_doubles_or_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        save(&path, &[1, 1, 4], Order::C, &[0.1_f64, 2.0, -1.0, 0.5]);
        assert_eq!(Pixels::read(&path).unwrap().at(0, 0), [0.1, 2.0, -1.0, 0.5]);
        save(&path, &[2, 1, 3], Order::C, &[0_u8, 51, 255, 1, 2, 3]);
        let bytes = Pixels::read(&path).unwrap();
        assert_eq!((bytes.size, bytes.at(0, 0)), ([1, 2], [0.0, 0.2, 1.0, 1.0]));
    }

    #[test]
    fn one_channel_is_read_as_grey() {
        let folder = tempfile::tempdir().unwrap();
        let plane = Plane { size: [3, 2], values: vec![-2.0, f32::INFINITY, 0.0, f32::NAN, 1e-30, 17.3] };
        let mut grey: Vec<_> = plane.values.iter().map(|v| [*v, *v, *v, 1.0]).collect();
        grey[3] = [0.0; 4];
        for kind in [FileKind::Exr, FileKind::Npy] {
            let path = folder.path().join("a");
            plane.write_as(kind, &path).unwrap();
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
        save(&path, &[1, 1, 3], Order::Fortran, &[0.0_f32; 3]);
        assert_eq!(problem(), "is an array in Fortran order");
        save(&path, &[1, 1, 3], Order::C, &[0_i32; 3]);
        assert_eq!(problem(), "is an array of '<i4', not of f4, f8 or u1");
        // Truncated files.
        save(&path, &[4, 4, 3], Order::C, &[0.0_f32; 48]);
        let part = std::fs::read(&path).unwrap();
        assert!(of_bytes(&part[..part.len() - 1]).starts_with("is a damaged .npy file"));
        floats().write(&folder.path().join("a.exr"), true).unwrap();
        let part = std::fs::read(folder.path().join("a.exr")).unwrap();
        assert!(of_bytes(&part[..part.len() / 2]).starts_with("cannot be decoded"));
    }
}
