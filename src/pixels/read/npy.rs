//! Pictures as NumPy arrays.

use std::fs::File;
use std::io::{BufReader, Read, Seek};

use anyhow::{Context, Result, bail, ensure};
use half::f16;
use npyz::{NpyFile, Order};

use super::{Channels, Picture, check_room, coloured};
use crate::host_memory::{OutOfMemory, host_vec};
use crate::pixels::Pixels;

const DAMAGED: &str = "is a damaged .npy file";

/// Longest header that is read. That of a picture has about 100 bytes.
const MOST_HEADER_BYTES: u64 = 1 << 20;

/// Reads an array of the shape height, width or height, width, channels with one, three or four channels.
pub(super) fn read(mut file: BufReader<File>) -> Result<Picture> {
    check_header(&mut file)?;
    let bytes = file.get_ref().metadata().context("cannot be read")?.len();
    let array = NpyFile::new(file).context(DAMAGED)?;
    let (shape, order) = (array.shape().to_vec(), array.order());
    let (height, width, channels) = match shape[..] {
        [height, width] => (height, width, 1),
        [height, width, channels @ (1 | 3 | 4)] => (height, width, channels),
        _ => bail!("is an array of shape {shape:?}, not of height, width and 1, 3 or 4 channels"),
    };
    let sides = u32::try_from(width).ok().zip(u32::try_from(height).ok()).filter(|(w, h)| *w > 0 && *h > 0);
    let size = sides.map(|(w, h)| [w, h]);
    let size = size.with_context(|| format!("is an array of shape {shape:?}, which is no picture"))?;
    let sample_bytes = array.dtype().num_bytes().unwrap_or(0);
    ensure!(u128::from(width * height) * u128::from(channels) * sample_bytes as u128 <= u128::from(bytes), DAMAGED);
    // Two lists of values while they are brought into the order of pixels.
    check_room(size, 8 * channels)?;
    let values = values(array)?;
    let values = match order {
        Order::C => values,
        Order::Fortran => by_pixel(&values, size, channels as usize)?,
    };
    let kind = match channels {
        1 if sample_bytes == 1 => Channels::Grey,
        1 => Channels::Numbers,
        _ => Channels::Colours,
    };
    let rgba = coloured(&values, channels as usize, |value| *value)?;
    Ok(Picture { pixels: Pixels { size, rgba }, channels: kind, has_alpha: channels == 4 })
}

/// Fails if the header has another length than such a file can have: its buffer is allocated before it is read.
fn check_header(file: &mut BufReader<File>) -> Result<()> {
    let mut start = Vec::new();
    file.by_ref().take(12).read_to_end(&mut start).context("cannot be read")?;
    file.rewind()?;
    let length = match start[..] {
        [.., 1, _, low, high, _, _] if start.len() == 12 => u64::from(u16::from_le_bytes([low, high])),
        [.., a, b, c, d] if start.len() == 12 => u64::from(u32::from_le_bytes([a, b, c, d])),
        _ => bail!(DAMAGED),
    };
    ensure!(length <= MOST_HEADER_BYTES, DAMAGED);
    Ok(())
}

/// All elements as f32, in the order of the file: floats as they are, bytes divided by 255.
fn values(array: NpyFile<BufReader<File>>) -> Result<Vec<f32>> {
    let count = array.shape().iter().product::<u64>() as usize;
    let array = match array.try_data::<f32>() {
        Ok(floats) => return collected(floats, count),
        Err(array) => array,
    };
    let array = match array.try_data::<f64>() {
        Ok(doubles) => return collected(doubles.map(|v| Ok(v? as f32)), count),
        Err(array) => array,
    };
    let array = match array.try_data::<f16>() {
        Ok(halves) => return collected(halves.map(|v| Ok(v?.to_f32())), count),
        Err(array) => array,
    };
    match array.try_data::<u8>() {
        Ok(bytes) => collected(bytes.map(|v| Ok(f32::from(v?) / 255.0)), count),
        Err(array) => bail!("is an array of {}, not of f2, f4, f8 or u1", array.dtype().descr()),
    }
}

fn collected(elements: impl Iterator<Item = std::io::Result<f32>>, count: usize) -> Result<Vec<f32>> {
    let mut values = host_vec(count, "a picture")?;
    for element in elements {
        values.push(element.context(DAMAGED)?);
    }
    ensure!(values.len() == count, DAMAGED);
    Ok(values)
}

/// Values in Fortran order, where the row changes fastest and the channel slowest, pixel by pixel.
fn by_pixel(values: &[f32], [width, height]: [u32; 2], channels: usize) -> Result<Vec<f32>, OutOfMemory> {
    let [width, height] = [width, height].map(|side| side as usize);
    let mut sorted = host_vec(values.len(), "a picture")?;
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        sorted.extend((0..channels).map(|channel| values[(channel * width + x) * height + y]));
    }
    Ok(sorted)
}
