//! Writes binary glTF with KHR_gaussian_splatting: 32-bit floats in the axes right, up, back.

use std::io::Write;

use anyhow::{Context, Result};
use serde_json::json;

use super::{BINARY, DISPLAY, EXTENSION, JSON, MAGIC};
use crate::formats::rows::{Row, base_colour, to_byte, write_rows};
use crate::scene::{Bounds, Gaussians, RIGHT_UP_BACK};

const FLOAT: u32 = 5126;
const UNSIGNED_BYTE: u32 = 5121;
const ARRAY_BUFFER: u32 = 34962;

/// The attribute of a Gaussian in one accessor.
#[derive(Clone, Copy)]
enum Attribute {
    Position,
    /// For viewers that only draw points.
    Colour,
    Rotation,
    Scale,
    Opacity,
    Sh {
        index: usize,
    },
}

pub(crate) fn write(gaussians: &Gaussians, out: &mut impl Write) -> Result<()> {
    // Flipping the scene also changes rotations and spherical harmonics.
    let gaussians = &gaussians.clone().flipped(RIGHT_UP_BACK);
    let attributes = attributes(gaussians.sh_degree());
    let (mut views, mut accessors, mut names, mut length) = (Vec::new(), Vec::new(), serde_json::Map::new(), 0);
    for (index, (name, attribute)) in attributes.iter().enumerate() {
        let bytes = attribute.bytes() * gaussians.len();
        views.push(json!({"buffer": 0, "byteOffset": length, "byteLength": bytes, "target": ARRAY_BUFFER}));
        accessors.push(attribute.accessor(gaussians, index));
        names.insert(name.clone(), json!(index));
        length += bytes;
    }
    let splatting = json!({
        "kernel": "ellipse", "colorSpace": DISPLAY, "projection": "perspective", "sortingMethod": "cameraDistance",
    });
    let mut document = serde_json::to_vec(&json!({
        "asset": {"version": "2.0", "generator": concat!("smalto ", env!("CARGO_PKG_VERSION"))},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"mode": 0, "attributes": names, "extensions": {EXTENSION: splatting}}]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": length}],
    }))?;
    document.resize(document.len().next_multiple_of(4), b' ');
    let all = 12 + 8 + document.len() + 8 + length;
    let all = u32::try_from(all)
        .ok()
        .with_context(|| format!("a .glb holds less than 4 GiB, the scene takes {all} bytes"))?;
    for word in [MAGIC, 2, all, document.len() as u32, JSON] {
        out.write_all(&word.to_le_bytes())?;
    }
    out.write_all(&document)?;
    for word in [length as u32, BINARY] {
        out.write_all(&word.to_le_bytes())?;
    }
    for (_, attribute) in attributes {
        write_rows(out, gaussians.len(), attribute.bytes(), |i, row| attribute.encode(gaussians, i, row))?;
    }
    Ok(())
}

/// The attributes with their names, in the order of the file.
fn attributes(sh_degree: u32) -> Vec<(String, Attribute)> {
    let own = |name: &str| format!("{EXTENSION}:{name}");
    let mut attributes = vec![
        ("POSITION".to_owned(), Attribute::Position),
        ("COLOR_0".to_owned(), Attribute::Colour),
        (own("ROTATION"), Attribute::Rotation),
        (own("SCALE"), Attribute::Scale),
        (own("OPACITY"), Attribute::Opacity),
    ];
    let coefficients = (0..=sh_degree).flat_map(|degree| (0..2 * degree + 1).map(move |i| (degree, i)));
    attributes.extend(
        coefficients
            .enumerate()
            .map(|(index, (degree, i))| (own(&format!("SH_DEGREE_{degree}_COEF_{i}")), Attribute::Sh { index })),
    );
    attributes
}

impl Attribute {
    fn bytes(self) -> usize {
        match self {
            Self::Position | Self::Scale | Self::Sh { .. } => 12,
            Self::Rotation => 16,
            Self::Opacity | Self::Colour => 4,
        }
    }

    fn accessor(self, gaussians: &Gaussians, view: usize) -> serde_json::Value {
        let (shape, component) = match self {
            Self::Position | Self::Scale | Self::Sh { .. } => ("VEC3", FLOAT),
            Self::Rotation => ("VEC4", FLOAT),
            Self::Opacity => ("SCALAR", FLOAT),
            Self::Colour => ("VEC4", UNSIGNED_BYTE),
        };
        let mut accessor =
            json!({"bufferView": view, "componentType": component, "count": gaussians.len(), "type": shape});
        match self {
            Self::Position => {
                let Bounds { low, high } = Bounds::of(gaussians);
                accessor["min"] = json!(low);
                accessor["max"] = json!(high);
            }
            Self::Colour => accessor["normalized"] = json!(true),
            _ => {}
        }
        accessor
    }

    fn encode(self, gaussians: &Gaussians, i: usize, row: &mut [u8]) {
        let mut row = Row(row);
        match self {
            Self::Position => row.floats(gaussians.means()[i]),
            Self::Colour => {
                row.put(gaussians.sh(i)[0].map(|coefficient| to_byte(base_colour(coefficient))));
                row.put([to_byte(f64::from(gaussians.opacities()[i]))]);
            }
            Self::Rotation => {
                let [w, x, y, z] = gaussians.rotations()[i];
                row.floats([x, y, z, w]);
            }
            Self::Scale => row.floats(gaussians.scales()[i]),
            Self::Opacity => row.floats([gaussians.opacities()[i]]),
            Self::Sh { index } => row.floats(gaussians.sh(i)[index]),
        }
    }
}
