//! Writes PLY like the original 3DGS: 32-bit floats, with the zero normals that its viewer requires.

use std::io::Write;

use anyhow::Result;

use crate::formats::rows::{Row, write_rows};
use crate::scene::{Gaussians, logit, rest_values};

pub(crate) fn write(gaussians: &Gaussians, is_antialiased: bool, out: &mut impl Write) -> Result<()> {
    let rest = rest_values(gaussians.sh_degree());
    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    if is_antialiased {
        writeln!(out, "comment SplatRenderMode: mip")?;
    }
    writeln!(out, "element vertex {}", gaussians.len())?;
    let named = |stem: &'static str, count: usize| (0..count).map(move |i| format!("{stem}{i}"));
    let places = ["x", "y", "z", "nx", "ny", "nz"].map(str::to_owned).into_iter();
    let colours = named("f_dc_", 3).chain(named("f_rest_", rest));
    let shapes = std::iter::once("opacity".to_owned()).chain(named("scale_", 3)).chain(named("rot_", 4));
    let properties: Vec<String> = places.chain(colours).chain(shapes).collect();
    for property in &properties {
        writeln!(out, "property float {property}")?;
    }
    writeln!(out, "end_header")?;
    write_rows(out, gaussians.len(), 4 * properties.len(), |i, row| {
        let (sh, mut row) = (gaussians.sh(i), Row(row));
        row.floats(gaussians.means()[i]);
        row.floats([0.0; 3]);
        row.floats(sh[0]);
        // Channel-major: all red, all green, all blue.
        (0..3).for_each(|channel| row.floats(sh[1..].iter().map(|coefficient| coefficient[channel])));
        row.floats([logit(f64::from(gaussians.opacities()[i])) as f32]);
        row.floats(gaussians.scales()[i].map(|scale| f64::from(scale).ln() as f32));
        row.floats(gaussians.rotations()[i]);
    })
}
