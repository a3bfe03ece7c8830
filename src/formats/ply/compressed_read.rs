//! Reads the compressed PLY of PlayCanvas: chunks of 256 Gaussians of 16 bytes each, and an optional element of SH
//! bytes.

use anyhow::{Context, Result, ensure};

use super::dialects;
use super::header::{Element, Property, Scalar};
use super::rows::{binary_rows, skip};
use crate::formats::input::Input;
use crate::scene::harmonics::C0;
use crate::scene::{BLOCK, Raw, Scene, USUAL_SH_DEGREE, from_smallest_three, logit, rest_values};

pub(crate) const CHUNK: usize = 256; // Gaussians that share their minima and maxima

/// Minima and maxima of one chunk, between which its Gaussians are quantized.
struct Chunk {
    mean: [[f64; 3]; 2],
    log_scale: [[f64; 3]; 2],
    colour: [[f64; 3]; 2],
}

pub(crate) fn read(input: &mut Input, elements: &[Element]) -> Result<Scene> {
    let (mut chunks, mut vertices, mut sh, mut notices) = (None, None, None, Vec::new());
    for element in elements {
        match element.name.as_str() {
            "chunk" => chunks = Some(read_chunks(input, element)?),
            "vertex" => {
                notices = dialects::notices(element);
                vertices = Some(read_vertices(input, element)?);
            }
            "sh" if element.count > 0 => sh = Some(read_sh(input, element)?),
            _ => skip(input, element)?,
        }
    }
    let chunks = chunks.context("the header has no element chunk")?;
    let vertices = vertices.context("the header has no element vertex")?;
    let (sh_degree, sh) = sh.unwrap_or((0, Vec::new()));
    let rest = rest_values(sh_degree);
    let count = vertices.len();
    ensure!(
        chunks.len() == count.div_ceil(CHUNK),
        "{count} vertices need {} chunks, the file has {}",
        count.div_ceil(CHUNK),
        chunks.len()
    );
    ensure!(
        sh.len() == rest * count,
        "{count} vertices need as many sh elements, the file has {}",
        sh.len() / rest.max(1)
    );

    let mut builder = input.builder(sh_degree, count)?;
    let bands = rest / 3;
    let decode = |index: usize, coefficients: &mut [[f32; 3]]| {
        let [position, rotation, scale, colour] = vertices[index];
        let chunk = &chunks[index / CHUNK];
        let byte = |shift: u32| f64::from(colour >> shift & 255) / 255.0;
        let rgb = [byte(24), byte(16), byte(8)];
        let alpha = byte(0);
        let rgb = std::array::from_fn::<_, 3, _>(|i| lerp(chunk.colour[0][i], chunk.colour[1][i], rgb[i]));
        coefficients[0] = rgb.map(|v| ((v - 0.5) / C0) as f32);
        for (i, coefficient) in coefficients[1..].iter_mut().enumerate() {
            // Channel-major, as in the original PLY.
            *coefficient = std::array::from_fn(|channel| sh_value(sh[index * rest + channel * bands + i]));
        }
        Raw {
            mean: unpack(position, &chunk.mean),
            log_scale: unpack(scale, &chunk.log_scale),
            rotation: unpack_smallest_three(rotation),
            opacity_logit: logit(alpha),
        }
    };
    for first in (0..count).step_by(BLOCK) {
        input.before_block(&builder)?;
        builder.extend(BLOCK.min(count - first), |index, coefficients| decode(first + index, coefficients));
    }
    let (gaussians, report) = builder.finish();
    Ok(Scene {
        gaussians,
        report,
        format: "compressed PLY".to_owned(),
        is_antialiased: false,
        notices,
        levels: Vec::new(),
    })
}

fn read_chunks(input: &mut Input, element: &Element) -> Result<Vec<Chunk>> {
    let triple = |stem: &str, names: [&str; 3]| -> Result<_> {
        let [x, y, z] = names.map(|name| element.property(&format!("{stem}_{name}")));
        Ok([x?, y?, z?])
    };
    let axes = ["x", "y", "z"];
    let mean = [triple("min", axes)?, triple("max", axes)?];
    let scale = [triple("min_scale", axes)?, triple("max_scale", axes)?];
    let channels = ["r", "g", "b"];
    let colour =
        element.has("min_r").then(|| anyhow::Ok([triple("min", channels)?, triple("max", channels)?])).transpose()?;
    let chunk = |row: &[u8]| Chunk {
        mean: mean.map(|p| p.map(|p| p.read(row))),
        log_scale: scale.map(|p| p.map(|p| p.read(row))),
        colour: colour.map_or([[0.0; 3], [1.0; 3]], |c| c.map(|p| p.map(|p| p.read(row)))),
    };
    binary_rows(input, element, 1, |row, all| all.push(chunk(row)))
}

fn read_vertices(input: &mut Input, element: &Element) -> Result<Vec<[u32; 4]>> {
    let [position, rotation, scale, colour] = ["packed_position", "packed_rotation", "packed_scale", "packed_color"]
        .map(|n| of_kind(element, n, Scalar::U32));
    let properties = [position?, rotation?, scale?, colour?];
    binary_rows(input, element, 1, |row, all| all.push(properties.map(|p| p.read(row) as u32)))
}

/// The SH degree, and the SH bytes of all Gaussians one after another.
fn read_sh(input: &mut Input, element: &Element) -> Result<(u32, Vec<u8>)> {
    let rest = element.run("f_rest_");
    let degree = (1..=USUAL_SH_DEGREE).find(|d| rest_values(*d) == rest);
    let degree = degree.with_context(|| format!("element sh has {rest} f_rest properties, expected 9, 24 or 45"))?;
    let properties = (0..rest).map(|i| of_kind(element, &format!("f_rest_{i}"), Scalar::U8));
    let properties = properties.collect::<Result<Vec<_>>>()?;
    let bytes = binary_rows(input, element, rest, |row, all| all.extend(properties.iter().map(|p| row[p.offset])))?;
    Ok((degree, bytes))
}

/// The property of this name, which must have this type.
fn of_kind<'e>(element: &'e Element, name: &str, kind: Scalar) -> Result<&'e Property> {
    let property = element.property(name)?;
    ensure!(property.kind == kind, "property {name} of element {} is not of type {kind:?}", element.name);
    Ok(property)
}

/// Unpacks 11, 10 and 11 bits, from the highest on, to values between the minima and maxima.
fn unpack(packed: u32, range: &[[f64; 3]; 2]) -> [f64; 3] {
    let fractions =
        [f64::from(packed >> 21) / 2047.0, f64::from(packed >> 11 & 1023) / 1023.0, f64::from(packed & 2047) / 2047.0];
    std::array::from_fn(|i| lerp(range[0][i], range[1][i], fractions[i]))
}

/// Unpacks a quaternion w x y z: two bits for the index of the largest component, which is positive, then ten for each
/// of the others in order.
fn unpack_smallest_three(packed: u32) -> [f64; 4] {
    let largest = (packed >> 30) as usize;
    from_smallest_three(
        largest,
        [20, 10, 0].map(|shift| (f64::from(packed >> shift & 1023) / 1023.0 - 0.5) * 2f64.sqrt()),
    )
}

/// The coefficient of a byte, from -4 to 4: the centre of its bucket, or exactly -4 and 4 for the outer bytes.
fn sh_value(byte: u8) -> f32 {
    let fraction = match byte {
        0 => 0.0,
        255 => 1.0,
        b => (f64::from(b) + 0.5) / 256.0,
    };
    ((fraction - 0.5) * 8.0) as f32
}

fn lerp(from: f64, to: f64, fraction: f64) -> f64 {
    from * (1.0 - fraction) + to * fraction
}
