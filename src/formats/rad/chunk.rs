//! Chunks of a `.rad`: the encodings of their properties, and the Gaussians that these are.

use std::io::Read;
use std::ops::Range;
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use flate2::read::DeflateDecoder;
use half::f16;
use rayon::prelude::*;
use serde::Deserialize;

use crate::formats::input::{Input, word};
use crate::host_memory::host_zeros;
use crate::scene::{Activated, harmonics, sh_coefficients};

const CHUNK: &[u8] = b"RADC";
/// Most bytes of a JSON header, and of a chunk.
const MOST_JSON: u64 = 1 << 28;
const MOST_CHUNK: u64 = 1 << 30;
/// Most Gaussians of a chunk.
pub const MOST_IN_CHUNK: u64 = 1 << 24;

#[derive(Deserialize)]
struct ChunkMeta {
    version: u32,
    count: u64,
    properties: Vec<Property>,
}

#[derive(Deserialize)]
struct Property {
    offset: u64,
    bytes: u64,
    property: String,
    encoding: String,
    compression: Option<String>,
    min: Option<f32>,
    max: Option<f32>,
}

/// Reads a signature, and a JSON text with its length before it and zeros up to a multiple of 8 bytes behind it. Also
/// returns the number of bytes.
pub fn header<T: serde::de::DeserializeOwned>(input: &mut Input, signature: &[u8], what: &str) -> Result<(T, u64)> {
    let start = input.bytes(8, what)?;
    ensure!(start.starts_with(signature), "{what} does not begin with {}", String::from_utf8_lossy(signature));
    let length = u64::from(word(&start, 4));
    ensure!(length <= MOST_JSON, "{what} has {length} bytes, expected at most {MOST_JSON}");
    let json = input.bytes(length.next_multiple_of(8), what)?;
    let value =
        serde_json::from_slice(&json[..length as usize]).with_context(|| format!("{what} is not that of RAD"))?;
    Ok((value, 8 + json.len() as u64))
}

/// A chunk that is read, but not decoded.
pub struct Chunk {
    pub count: usize,
    properties: Vec<Property>,
    payload: Vec<u8>,
}

impl Chunk {
    /// Reads a chunk of `bytes` bytes with `expected` Gaussians.
    pub fn read(input: &mut Input, bytes: u64, expected: u64) -> Result<Self> {
        ensure!(bytes <= MOST_CHUNK, "it has {bytes} bytes, expected at most {MOST_CHUNK}");
        let (ChunkMeta { version, count, properties }, length) = header(input, CHUNK, "its header")?;
        ensure!(version == 1, "its version is {version}, and only 1 is supported");
        ensure!(count == expected, "it has {count} Gaussians, expected {expected}");
        let length = length + 8;
        ensure!(length <= bytes, "its header has {length} bytes, of {bytes} of the chunk");
        input.skip(8, "the length of its content")?;
        let payload = input.bytes(bytes - length, "its content")?;
        Ok(Self { count: usize::try_from(count)?, properties, payload })
    }

    fn find(&self, name: &str) -> Option<&Property> {
        self.properties.iter().find(|property| property.property == name)
    }

    /// The bytes of a property, which must be of this length.
    fn bytes(&self, property: &Property, length: usize) -> Result<Vec<u8>> {
        let Property { offset, bytes, property: name, compression, .. } = property;
        let end = offset.checked_add(*bytes).filter(|end| *end <= self.payload.len() as u64);
        let end = end.with_context(|| format!("{name} lies behind the end of the chunk"))?;
        let stored = &self.payload[*offset as usize..end as usize];
        let mut unpacked = host_zeros(length, name)?;
        let is_whole = match compression.as_deref() {
            None => {
                unpacked.clear();
                unpacked.extend_from_slice(stored);
                stored.len() == length
            }
            // Deflate without the header of gzip, whatever its name.
            Some("gz") => {
                let mut decoder = DeflateDecoder::new(stored);
                decoder.read_exact(&mut unpacked).is_ok() && decoder.read(&mut [0]).is_ok_and(|more| more == 0)
            }
            Some(other) => bail!("{name} is compressed by '{other}', and only gz is supported"),
        };
        ensure!(is_whole, "{name} does not hold {length} bytes");
        Ok(unpacked)
    }

    /// A property as numbers: `dimensions` planes of `count` each.
    fn planes(&self, property: &Property, dimensions: usize, count: usize) -> Result<Vec<f32>> {
        let Property { property: name, encoding, min, max, .. } = property;
        let values = dimensions * count;
        let range = || min.zip(*max).with_context(|| format!("{name} has no range"));
        let bytes = |each: usize| self.bytes(property, each * values);
        let half = |bytes: [u8; 2]| f16::from_le_bytes(bytes).to_f32();
        let signed = |bytes: Vec<u8>| -> Result<Vec<f32>> {
            let max = max.with_context(|| format!("{name} has no range"))?;
            Ok(bytes.into_iter().map(|byte| f32::from(byte as i8) / 127.0 * max).collect())
        };
        let unsigned = |bytes: Vec<u8>| -> Result<Vec<f32>> {
            let (min, max) = range()?;
            Ok(bytes.into_iter().map(|byte| f32::from(byte) / 255.0 * (max - min) + min).collect())
        };
        let summed = |mut bytes: Vec<u8>| {
            for plane in bytes.chunks_exact_mut(count.max(1)) {
                let mut sum = 0_u8;
                plane.iter_mut().for_each(|byte| {
                    sum = sum.wrapping_add(*byte);
                    *byte = sum;
                });
            }
            bytes
        };
        Ok(match encoding.as_str() {
            "f32" => bytes(4)?.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect(),
            "f16" => bytes(2)?.as_chunks().0.iter().map(|bytes| half(*bytes)).collect(),
            // The first bytes of all values, then the second ones.
            "f32_lebytes" => {
                let bytes = bytes(4)?;
                (0..values).map(|i| f32::from_le_bytes([0, 1, 2, 3].map(|k| bytes[k * values + i]))).collect()
            }
            "f16_lebytes" => {
                let bytes = bytes(2)?;
                (0..values).map(|i| half([0, 1].map(|k| bytes[k * values + i]))).collect()
            }
            "r8" => unsigned(bytes(1)?)?,
            "r8_delta" => unsigned(summed(bytes(1)?))?,
            "s8" => signed(bytes(1)?)?,
            "s8_delta" => signed(summed(bytes(1)?))?,
            "ln_f16" => bytes(2)?.as_chunks().0.iter().map(|bytes| half(*bytes).exp()).collect(),
            "ln_0r8" => {
                let (min, max) = range()?;
                let exponent = |byte: u8| min + f32::from(byte - 1) * (max - min) / 254.0;
                let value = |byte: u8| if byte == 0 { 0.0 } else { exponent(byte).exp() };
                bytes(1)?.into_iter().map(value).collect()
            }
            other => bail!("the encoding '{other}' of {name} is not supported"),
        })
    }

    /// Whole numbers of one plane.
    fn whole(&self, property: &Property) -> Result<Vec<u32>> {
        let Property { property: name, encoding, .. } = property;
        let bytes = |each: usize| self.bytes(property, each * self.count);
        Ok(match encoding.as_str() {
            "u16" => bytes(2)?.as_chunks().0.iter().map(|bytes| u16::from_le_bytes(*bytes).into()).collect(),
            "u32" => bytes(4)?.as_chunks().0.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect(),
            other => bail!("the encoding '{other}' of {name} is not supported"),
        })
    }

    fn needed(&self, name: &str) -> Result<&Property> {
        self.find(name).with_context(|| format!("it has no {name}"))
    }

    /// The spherical harmonics of the palette, as planes of degree 1, 2 and 3; empty without a palette.
    pub fn codes(&self, degree: u32, count: Option<u64>) -> Result<Arc<[Vec<f32>]>> {
        let Some(count) = count else { return Ok(Arc::new([])) };
        let count = usize::try_from(count.min(MOST_IN_CHUNK))?;
        let of_degree = |degree: u32| {
            let property = self.needed(&format!("sh{degree}_code"))?;
            self.planes(property, 3 * (2 * degree as usize + 1), count)
        };
        (1..=degree).map(of_degree).collect()
    }

    /// The values of all Gaussians. `codes` are the planes of the palette.
    pub fn columns(&self, degree: u32, codes: &Arc<[Vec<f32>]>) -> Result<Columns> {
        const NUMBERS: [(&str, usize); 4] = [("center", 3), ("alpha", 1), ("rgb", 3), ("scales", 3)];
        let numbers = NUMBERS.par_iter().map(|(name, planes)| self.planes(self.needed(name)?, *planes, self.count));
        let [means, alphas, colours, scales] =
            <[Vec<f32>; 4]>::try_from(numbers.collect::<Result<Vec<_>>>()?).expect("four properties");
        let orientation = self.needed("orientation")?;
        let rotations = match orientation.encoding.as_str() {
            "oct88r8" => {
                let bytes = self.bytes(orientation, 3 * self.count)?;
                bytes.as_chunks().0.iter().map(|bytes| turn_about(*bytes)).collect()
            }
            _ => {
                let planes = self.planes(orientation, 3, self.count)?;
                let turn = |i: usize| {
                    let [x, y, z] = [0, 1, 2].map(|k| f64::from(planes[k * self.count + i]));
                    [(1.0 - x * x - y * y - z * z).max(0.0).sqrt(), x, y, z]
                };
                (0..self.count).map(turn).collect()
            }
        };
        let (mut sh, mut labels) = (Vec::new(), None);
        for of_degree in 1..=degree {
            let planes = 3 * (2 * of_degree as usize + 1);
            match self.find(&format!("sh{of_degree}")) {
                Some(property) => sh.push(self.planes(property, planes, self.count)?),
                None => ensure!(!codes.is_empty(), "it has no sh{of_degree}, and the file no palette"),
            }
        }
        if sh.is_empty() && !codes.is_empty() {
            let own = self.whole(self.needed("sh_label")?)?;
            let entries = codes[0].len() / 9;
            if let Some(label) = own.iter().find(|label| **label as usize >= entries) {
                bail!("a Gaussian has palette entry {label}, there are {entries}");
            }
            labels = Some(own);
        }
        ensure!(labels.is_some() || sh.len() == degree as usize, "it has a part of its spherical harmonics");
        Ok(Columns { count: self.count, means, alphas, colours, scales, rotations, sh, labels, codes: codes.clone() })
    }

    /// The indices of the Gaussians that stand for no others, in a file with a tree.
    pub fn leaves(&self) -> Result<Vec<usize>> {
        let children = self.whole(self.needed("child_count")?)?;
        Ok((0..self.count).filter(|index| children[*index] == 0).collect())
    }

    /// The children of each node, in a file with a tree.
    pub fn children(&self) -> Result<Vec<Range<u32>>> {
        let [counts, starts] = ["child_count", "child_start"].map(|name| self.whole(self.needed(name)?));
        let range = |(count, start): (u32, u32)| match count {
            0 => Ok(0..0),
            _ => Ok(start..start.checked_add(count).context("its tree names a node that is not there")?),
        };
        counts?.into_iter().zip(starts?).map(range).collect()
    }
}

/// The quaternion w x y z of an axis in two bytes, folded to an octahedron, and half of the angle in a byte, 0 to 90
/// degrees.
fn turn_about([u, v, angle]: [u8; 3]) -> [f64; 4] {
    let [x, y] = [u, v].map(|byte| f64::from(byte) / 127.5 - 1.0);
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    let [x, y] = [x, y].map(|value| if value >= 0.0 { value - fold } else { value + fold });
    let length = (x * x + y * y + z * z).sqrt();
    let (sin, cos) = (f64::from(angle) / 255.0 * std::f64::consts::FRAC_PI_2).sin_cos();
    [cos, sin * x / length, sin * y / length, sin * z / length]
}

/// The decoded planes of a chunk.
pub struct Columns {
    count: usize,
    means: Vec<f32>,
    alphas: Vec<f32>,
    colours: Vec<f32>,
    scales: Vec<f32>,
    rotations: Vec<[f64; 4]>,
    /// Planes of degree 1, 2 and 3, if each Gaussian has its own.
    sh: Vec<Vec<f32>>,
    /// Otherwise the entry of each in the palette.
    labels: Option<Vec<u32>>,
    codes: Arc<[Vec<f32>]>,
}

impl Columns {
    /// A Gaussian, whose spherical harmonics are written to `sh`.
    pub fn gaussian(&self, index: usize, sh: &mut [[f32; 3]]) -> Activated {
        sh[0] = self.three(&self.colours, index).map(|value| ((f64::from(value) - 0.5) / harmonics::C0) as f32);
        let (planes, place) = match &self.labels {
            Some(labels) => (&self.codes[..], labels[index] as usize),
            None => (&self.sh[..], index),
        };
        for (degree, planes) in (1..).zip(planes) {
            let stride = planes.len() / (3 * (2 * degree as usize + 1));
            let first = sh_coefficients(degree - 1);
            for (basis, value) in sh[first..sh_coefficients(degree)].iter_mut().enumerate() {
                *value = std::array::from_fn(|channel| planes[(3 * basis + channel) * stride + place]);
            }
        }
        let (opacity, wider) = self.shape(index);
        Activated {
            mean: self.mean(index).map(f64::from),
            scale: self.three(&self.scales, index).map(|scale| wider * f64::from(scale)),
            rotation: self.rotations[index],
            opacity,
        }
    }

    /// The opacity of a Gaussian, and the factor of its scales.
    fn shape(&self, index: usize) -> (f64, f64) {
        let alpha = f64::from(self.alphas[index]);
        if alpha > ROUNDED_ONE { (1.0, widening(alpha)) } else { (alpha.min(1.0), 1.0) }
    }

    pub fn mean(&self, index: usize) -> [f32; 3] {
        self.three(&self.means, index)
    }

    /// The largest standard deviation of a Gaussian, as it is drawn.
    pub fn size(&self, index: usize) -> f32 {
        self.shape(index).1 as f32 * self.three(&self.scales, index).into_iter().fold(0.0, f32::max)
    }

    /// The values of a Gaussian in three planes.
    fn three(&self, planes: &[f32], index: usize) -> [f32; 3] {
        [0, 1, 2].map(|k| planes[k * self.count + index])
    }
}

/// The largest alpha that an opacity of 1 becomes in bytes from 0 to 2.
const ROUNDED_ONE: f64 = 1.0 + 1.0 / 255.0 + 1e-6;

/// The factor of the scales of a Gaussian of opacity 1 in place of one with an alpha above 1. Spark draws the latter as
/// 1 - (1 - exp(-r^2/2))^o, with ln o = (steepness^2 - 1) / e. Over the plane, alpha then sums to the harmonic number
/// of o, here by its series, where a Gaussian of opacity 1 has a sum of 1.
fn widening(alpha: f64) -> f64 {
    const EULER_GAMMA: f64 = 0.577_215_664_901_532_9;
    let steepness = (4.0 * alpha - 3.0).min(5.0);
    let opacity = ((steepness * steepness - 1.0) / std::f64::consts::E).exp();
    let sum = opacity.ln() + EULER_GAMMA + 0.5 / opacity - 1.0 / (12.0 * opacity * opacity);
    sum.max(1.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_are_about_the_axes_of_an_octahedron() {
        for (bytes, expected) in [
            ([255, 128, 255], [0.0, 1.0, 0.0, 0.0]),
            ([128, 255, 255], [0.0, 0.0, 1.0, 0.0]),
            ([128, 128, 0], [1.0, 0.0, 0.0, 0.0]),
            ([128, 128, 255], [0.0, 0.0, 0.0, 1.0]),
            ([255, 255, 255], [0.0, 0.0, 0.0, -1.0]),
        ] {
            let found = turn_about(bytes);
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.01), "{bytes:?}: {found:?}");
        }
    }

    #[test]
    fn wider_scales_keep_the_sum_of_alpha() {
        assert_eq!(widening(1.0), 1.0);
        for alpha in [1.1, 1.5, 2.0] {
            let steepness: f64 = 4.0 * alpha - 3.0;
            let opacity = ((steepness * steepness - 1.0) / std::f64::consts::E).exp();
            let drawn = |r: f64| 1.0 - (1.0 - (-r * r / 2.0).exp()).powf(opacity);
            let sum: f64 = (0..10_000).map(|i| f64::from(i) * 1e-3).map(|r| drawn(r) * r * 1e-3).sum();
            assert!((widening(alpha).powi(2) / sum - 1.0).abs() < 0.01, "{alpha}: {}, {sum}", widening(alpha));
        }
    }
}
