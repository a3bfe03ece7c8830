//! Writes SPZ 3 and 4: quantized planes in the axes right, up, back.

use std::io::Write;

use anyhow::{Result, ensure};
use rayon::prelude::*;

use super::read::{COLOUR_SCALE, MAGIC};
use crate::formats::rows::{Row, to_byte, write_rows};
use crate::scene::harmonics::flip_sign;
use crate::scene::{Gaussians, RIGHT_UP_BACK, axis_signs, encode_rotation, rest_values, rotation_signs};

/// Largest number of fractional bits of a coordinate. A scene too large for 24 bits in total gets fewer.
const FRACTIONAL_BITS: i32 = 16;
/// Largest coordinate in 24 bits with sign.
const LARGEST: f64 = 8_388_607.0;
/// Compression level of the reference implementation.
const ZSTD_LEVEL: i32 = 12;

pub(crate) fn write(gaussians: &Gaussians, is_antialiased: bool, version: u32, out: &mut impl Write) -> Result<()> {
    let fractional_bits = fractional_bits(gaussians)?;
    let mut header = Vec::new();
    for word in [MAGIC, version, u32::try_from(gaussians.len())?] {
        header.extend(word.to_le_bytes());
    }
    header.extend([gaussians.sh_degree() as u8, fractional_bits as u8, u8::from(is_antialiased)]);
    let step = 0.5_f64.powi(fractional_bits);
    if version == 3 {
        header.push(0);
        let mut stream = flate2::write::GzEncoder::new(out, flate2::Compression::default());
        stream.write_all(&header)?;
        for plane in planes(gaussians.sh_degree()) {
            plane.write(gaussians, step, &mut stream)?;
        }
        stream.finish()?;
        return Ok(());
    }
    let planes = planes(gaussians.sh_degree());
    header.push(planes.len() as u8);
    header.extend(32_u32.to_le_bytes());
    header.resize(32, 0);
    let streams = planes.par_iter().map(|plane| {
        let mut stream = zstd::Encoder::new(Vec::new(), ZSTD_LEVEL)?;
        plane.write(gaussians, step, &mut stream)?;
        Ok(stream.finish()?)
    });
    let streams = streams.collect::<Result<Vec<_>>>()?;
    for (stream, plane) in streams.iter().zip(&planes) {
        header.extend((stream.len() as u64).to_le_bytes());
        header.extend((gaussians.len() as u64 * plane.bytes() as u64).to_le_bytes());
    }
    out.write_all(&header)?;
    streams.iter().try_for_each(|stream| out.write_all(stream))?;
    Ok(())
}

fn fractional_bits(gaussians: &Gaussians) -> Result<i32> {
    let farthest = gaussians.means().par_iter().flatten().map(|v| f64::from(v.abs())).reduce(|| 0.0, f64::max);
    ensure!(farthest <= LARGEST, "a Gaussian lies at {farthest}, SPZ holds coordinates up to {LARGEST}");
    Ok((0..=FRACTIONAL_BITS).rev().find(|bits| farthest * 2_f64.powi(*bits) <= LARGEST).unwrap_or(0))
}

/// The attribute of a Gaussian in one plane of the file.
#[derive(Clone, Copy)]
enum Plane {
    Positions,
    Alphas,
    Colours,
    Scales,
    Rotations,
    Sh { values: usize },
}

/// The planes in file order.
fn planes(sh_degree: u32) -> Vec<Plane> {
    let values = rest_values(sh_degree);
    let mut planes = vec![Plane::Positions, Plane::Alphas, Plane::Colours, Plane::Scales, Plane::Rotations];
    planes.extend((values > 0).then_some(Plane::Sh { values }));
    planes
}

impl Plane {
    fn bytes(self) -> usize {
        match self {
            Self::Positions => 9,
            Self::Alphas => 1,
            Self::Colours | Self::Scales => 3,
            Self::Rotations => 4,
            Self::Sh { values } => values,
        }
    }

    fn write(self, gaussians: &Gaussians, step: f64, out: &mut impl Write) -> Result<()> {
        write_rows(out, gaussians.len(), self.bytes(), |i, row| self.encode(gaussians, i, step, row))
    }

    fn encode(self, gaussians: &Gaussians, i: usize, step: f64, row: &mut [u8]) {
        let sh = gaussians.sh(i);
        match self {
            Self::Positions => {
                let mut row = Row(row);
                for (mean, sign) in gaussians.means()[i].iter().zip(axis_signs(RIGHT_UP_BACK)) {
                    let [a, b, c, _] = ((f64::from(sign * mean) / step).round() as i32).to_le_bytes();
                    row.put([a, b, c]);
                }
            }
            Self::Alphas => row[0] = to_byte(f64::from(gaussians.opacities()[i])),
            Self::Colours => Row(row).put(sh[0].map(|v| to_byte(f64::from(v) * COLOUR_SCALE + 0.5))),
            Self::Scales => Row(row).put(gaussians.scales()[i].map(scale_byte)),
            Self::Rotations => {
                let (turned, q) = (rotation_signs(RIGHT_UP_BACK), gaussians.rotations()[i]);
                let [w, x, y, z] = std::array::from_fn(|i| turned[i] * q[i]);
                Row(row).put(encode_rotation([x, y, z, w]).to_le_bytes());
            }
            Self::Sh { .. } => {
                let mut row = Row(row);
                for (index, coefficient) in sh.iter().enumerate().skip(1) {
                    let bucket = if index < 4 { 8.0 } else { 16.0 };
                    let sign = flip_sign(index, RIGHT_UP_BACK);
                    row.put(coefficient.map(|v| sh_byte(sign * v, bucket)));
                }
            }
        }
    }
}

/// A scale in sixteen steps per factor of e, from exp(-10) on.
fn scale_byte(scale: f32) -> u8 {
    ((f64::from(scale).ln() + 10.0) * 16.0).round().clamp(0.0, 255.0) as u8
}

/// A coefficient rounded to a bucket, as in the reference implementation: five bits in degree 1, four in others. Fewer
/// distinct values compress better.
fn sh_byte(value: f32, bucket: f32) -> u8 {
    let steps = (value * 128.0).round() + 128.0;
    (((steps + bucket / 2.0) / bucket).floor() * bucket).clamp(0.0, 255.0) as u8
}
