//! Rows of bytes, and the encodings that several formats share.

use std::io::Write;

use anyhow::Result;
use rayon::prelude::*;

use crate::scene::BLOCK;
use crate::scene::harmonics::C0;

/// Writes `count` rows of `bytes` bytes, block by block; `encode(index, row)` runs on all cores.
pub(crate) fn write_rows(
    out: &mut impl Write,
    count: usize,
    bytes: usize,
    encode: impl Fn(usize, &mut [u8]) + Sync,
) -> Result<()> {
    let mut rows = Vec::new();
    for first in (0..count).step_by(BLOCK) {
        rows.resize(BLOCK.min(count - first) * bytes, 0);
        rows.par_chunks_exact_mut(bytes).enumerate().for_each(|(i, row)| encode(first + i, row));
        out.write_all(&rows)?;
    }
    Ok(())
}

/// Fills a row of bytes from the front.
pub(crate) struct Row<'r>(pub &'r mut [u8]);

impl Row<'_> {
    /// Writes bytes and moves past them.
    pub fn put<const N: usize>(&mut self, bytes: [u8; N]) {
        let (head, tail) = std::mem::take(&mut self.0).split_at_mut(N);
        head.copy_from_slice(&bytes);
        self.0 = tail;
    }

    /// Writes little-endian 32-bit floats.
    pub fn floats(&mut self, values: impl IntoIterator<Item = f32>) {
        values.into_iter().for_each(|value| self.put(value.to_le_bytes()));
    }
}

/// A fraction from 0 to 1 as the nearest of 256 steps.
pub(crate) fn to_byte(fraction: f64) -> u8 {
    (fraction * 255.0).round().clamp(0.0, 255.0) as u8
}

/// The colour of a coefficient of degree 0 alone.
pub(crate) fn base_colour(coefficient: f32) -> f64 {
    0.5 + C0 * f64::from(coefficient)
}
