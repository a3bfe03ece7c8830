//! Writes `.splat`: 32 bytes per Gaussian, with colours of degree 0 only.

use std::io::Write;

use anyhow::Result;

use crate::formats::rows::{Row, base_colour, to_byte, write_rows};
use crate::scene::Gaussians;

pub(crate) fn write(gaussians: &Gaussians, out: &mut impl Write) -> Result<()> {
    write_rows(out, gaussians.len(), 32, |i, row| {
        let mut row = Row(row);
        row.floats(gaussians.means()[i]);
        row.floats(gaussians.scales()[i]);
        row.put(gaussians.sh(i)[0].map(|coefficient| to_byte(base_colour(coefficient))));
        row.put([to_byte(f64::from(gaussians.opacities()[i]))]);
        row.put(gaussians.rotations()[i].map(|v| (v * 128.0 + 128.0).round().clamp(0.0, 255.0) as u8));
    })
}
