//! Writes the compressed PLY of PlayCanvas: chunks of 256 Gaussians, quantized between the bounds of their chunk.

use std::array::from_fn;
use std::io::Write;

use anyhow::Result;

use super::compressed_read::CHUNK;
use crate::formats::rows::{Row, base_colour, to_byte, write_rows};
use crate::scene::{Gaussians, rest_values};

/// Log scales are clamped to this magnitude, as in other writers: that of a flat Gaussian is infinite.
const LARGEST_LOG_SCALE: f32 = 20.0;

/// Minima and maxima of a value in a chunk.
type Range = [[f32; 3]; 2];

struct Chunk {
    mean: Range,
    log_scale: Range,
    colour: Range,
}

pub(crate) fn write(gaussians: &Gaussians, is_antialiased: bool, out: &mut impl Write) -> Result<()> {
    let (count, rest) = (gaussians.len(), rest_values(gaussians.sh_degree()));
    let chunks: Vec<Chunk> = (0..count).step_by(CHUNK).map(|first| chunk(gaussians, first)).collect();
    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    if is_antialiased {
        writeln!(out, "comment SplatRenderMode: mip")?;
    }
    writeln!(out, "element chunk {}", chunks.len())?;
    for (stem, axes) in [("", ["x", "y", "z"]), ("scale_", ["x", "y", "z"]), ("", ["r", "g", "b"])] {
        for bound in ["min", "max"] {
            for axis in axes {
                writeln!(out, "property float {bound}_{stem}{axis}")?;
            }
        }
    }
    writeln!(out, "element vertex {count}")?;
    for name in ["position", "rotation", "scale", "color"] {
        writeln!(out, "property uint packed_{name}")?;
    }
    if rest > 0 {
        writeln!(out, "element sh {count}")?;
        for i in 0..rest {
            writeln!(out, "property uchar f_rest_{i}")?;
        }
    }
    writeln!(out, "end_header")?;
    write_rows(out, chunks.len(), 72, |i, row| {
        let Chunk { mean, log_scale, colour } = &chunks[i];
        Row(row).floats([mean, log_scale, colour].into_iter().flatten().flatten().copied());
    })?;
    write_rows(out, count, 16, |i, row| {
        let Chunk { mean, log_scale, colour } = &chunks[i / CHUNK];
        let [r, g, b] = fractions(base(gaussians, i), colour).map(to_byte);
        let mut row = Row(row);
        row.put(pack(fractions(gaussians.means()[i], mean)).to_le_bytes());
        row.put(pack_smallest_three(gaussians.rotations()[i]).to_le_bytes());
        row.put(pack(fractions(log_scales(gaussians, i), log_scale)).to_le_bytes());
        row.put(u32::from_be_bytes([r, g, b, to_byte(f64::from(gaussians.opacities()[i]))]).to_le_bytes());
    })?;
    if rest > 0 {
        write_rows(out, count, rest, |i, row| {
            let sh = &gaussians.sh(i)[1..];
            // Channel-major, as in the original PLY.
            let values = (0..3).flat_map(|channel| sh.iter().map(move |coefficient| coefficient[channel]));
            let bytes = row.iter_mut().zip(values).enumerate();
            bytes.for_each(|(k, (byte, value))| *byte = sh_byte(value, (i + k).is_multiple_of(2)));
        })?;
    }
    Ok(())
}

fn log_scales(gaussians: &Gaussians, i: usize) -> [f32; 3] {
    gaussians.scales()[i].map(|s| s.ln().clamp(-LARGEST_LOG_SCALE, LARGEST_LOG_SCALE))
}

fn base(gaussians: &Gaussians, i: usize) -> [f32; 3] {
    gaussians.sh(i)[0].map(|coefficient| base_colour(coefficient) as f32)
}

fn chunk(gaussians: &Gaussians, first: usize) -> Chunk {
    let all = first..gaussians.len().min(first + CHUNK);
    let range = |value: &dyn Fn(usize) -> [f32; 3]| {
        all.clone().map(value).fold([[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]], |[low, high], value| {
            [from_fn(|axis| low[axis].min(value[axis])), from_fn(|axis| high[axis].max(value[axis]))]
        })
    };
    Chunk {
        mean: range(&|i| gaussians.means()[i]),
        log_scale: range(&|i| log_scales(gaussians, i)),
        colour: range(&|i| base(gaussians, i)),
    }
}

/// Positions of the values between the bounds, 0 to 1; 0 where the bounds are equal.
fn fractions(values: [f32; 3], range: &Range) -> [f64; 3] {
    from_fn(|axis| {
        let [low, high, value] = [range[0][axis], range[1][axis], values[axis]].map(f64::from);
        if high > low { (value - low) / (high - low) } else { 0.0 }
    })
}

/// Packs fractions in 11, 10 and 11 bits, from the highest on.
fn pack(fractions: [f64; 3]) -> u32 {
    let steps = |axis: usize, most: f64| (fractions[axis] * most).round() as u32;
    steps(0, 2047.0) << 21 | steps(1, 1023.0) << 11 | steps(2, 2047.0)
}

/// Packs a unit quaternion w x y z: two bits for the index of the largest component, made positive, then ten for each
/// of the others in order.
fn pack_smallest_three(rotation: [f32; 4]) -> u32 {
    let largest = (0..4).max_by(|a, b| rotation[*a].abs().total_cmp(&rotation[*b].abs())).unwrap_or(0);
    let sign = f64::from(rotation[largest]).signum();
    let others = (0..4).filter(|i| *i != largest);
    others.fold(largest as u32, |packed, i| {
        let fraction = sign * f64::from(rotation[i]) * 0.5_f64.sqrt() + 0.5;
        packed << 10 | (fraction * 1023.0).round().clamp(0.0, 1023.0) as u32
    })
}

/// A coefficient as one of 256 buckets from -4 to 4. A value on the border of two buckets (0, and all values of an
/// .spz) is equally far from both centres; `takes_lower` alternates, because a fixed choice would shift the colours of
/// the scene.
fn sh_byte(value: f32, takes_lower: bool) -> u8 {
    let place = (value / 8.0 + 0.5) * 256.0;
    let bucket = if place.fract() == 0.0 && takes_lower { place - 1.0 } else { place.floor() };
    bucket.clamp(0.0, 255.0) as u8
}
