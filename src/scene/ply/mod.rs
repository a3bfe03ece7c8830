//! PLY: the scenes of the original 3DGS (`x y z`, `f_dc`, `f_rest`, `opacity`, `scale`, `rot`) in all that others make of
//! them, and point clouds.

mod header;
mod points;

use anyhow::{Context, Result, bail, ensure};

use super::canonical::{BLOCK, Builder, Raw};
use super::harmonics::C0;
use super::source::Source;
use super::{MAX_SH_DEGREE, Scene, checked_count, compressed_ply, rest_values};
use crate::host_memory::host_vec;
use header::quoted;
pub(super) use header::{Element, Encoding, Property, Scalar};

/// Longest line of an element that is written as text.
const MAX_LINE_BYTES: u64 = 1 << 16;

pub(super) fn read(source: &mut Source) -> Result<Scene> {
    let header::Header { elements, is_antialiased, mut notices } = header::read(source)?;
    if elements.iter().any(|e| e.name == "chunk") {
        return Ok(Scene { is_antialiased, notices, ..compressed_ply::read(source, &elements)? });
    }
    for element in &elements {
        if element.name == "vertex" {
            let scene = vertices(source, element)?;
            notices.extend(scene.notices);
            return Ok(Scene { is_antialiased, notices, ..scene });
        }
        skip(source, element)?;
    }
    bail!("the header has no element vertex")
}

/// Reads past an element that nothing is taken from.
pub(super) fn skip(source: &mut Source, element: &Element) -> Result<()> {
    ensure!(
        !element.has_list || element.encoding == Encoding::Ascii,
        "element {} has a list property; lists before the Gaussians are not supported",
        element.name
    );
    if element.encoding == Encoding::Ascii {
        let count = checked_count(element.count, 1, source.left(), &element.name)?;
        return (0..count).try_for_each(|_| source.line(MAX_LINE_BYTES, &element.name).map(drop));
    }
    let count = checked_count(element.count, element.stride() as u64, source.left(), &element.name)?;
    source.skip((count * element.stride()) as u64, &element.name)
}

/// The rows of an element, a block at a time.
struct Rows<'e> {
    element: &'e Element,
    count: usize,
    bytes: Vec<u8>,
}

impl<'e> Rows<'e> {
    fn of(source: &Source, element: &'e Element) -> Result<Self> {
        ensure!(!element.has_list, "element {} has a list property", element.name);
        let is_text = element.encoding == Encoding::Ascii;
        // A number and a space or an end of line at least.
        let least = if is_text { 2 * element.properties.len() } else { element.stride() };
        // The last line may have no end.
        let available = source.left() + u64::from(is_text);
        let count = checked_count(element.count, least as u64, available, "vertices")?;
        Ok(Self { element, count, bytes: Vec::new() })
    }

    /// How rows are kept: as in the file, or where that is text, as 64-bit floats.
    fn kept(&self) -> Element {
        if self.element.encoding == Encoding::Ascii { self.element.widened() } else { self.element.clone() }
    }

    /// Reads the next rows. Returns all of them.
    fn next(&mut self, source: &mut Source, first: usize, count: usize) -> Result<&[u8]> {
        if self.element.encoding != Encoding::Ascii {
            if self.bytes.capacity() == 0 {
                self.bytes = host_vec(count * self.element.stride(), "vertices")?;
            }
            self.bytes.resize(count * self.element.stride(), 0);
            source.fill(&mut self.bytes, "the vertices")?;
            return Ok(&self.bytes);
        }
        self.bytes.clear();
        for row in first..first + count {
            let line = source.last_line(MAX_LINE_BYTES, "the vertices")?;
            let mut words = line.split_ascii_whitespace();
            for property in &self.element.properties {
                let word = words.next().with_context(|| format!("vertex {row} has no {}", property.name))?;
                let value: f64 = word.parse().with_context(|| {
                    format!("vertex {row}: '{}' for {} is not a number", quoted(word), property.name)
                })?;
                self.bytes.extend(value.to_le_bytes());
            }
            ensure!(words.next().is_none(), "vertex {row} has more numbers than properties");
        }
        Ok(&self.bytes)
    }
}

/// Where a Gaussian's values are in a vertex.
struct Layout<'e> {
    mean: [&'e Property; 3],
    /// Two of a surfel, which is flat along the third axis.
    scale: Vec<&'e Property>,
    rotation: [&'e Property; 4],
    opacity: &'e Property,
    colour: Colour<'e>,
    /// Channel-major: all red, all green, all blue.
    rest: Vec<&'e Property>,
    sh_degree: u32,
}

/// Where a vertex has its colour.
#[derive(Clone, Copy)]
enum Colour<'e> {
    /// Coefficients of degree 0.
    Coefficients([&'e Property; 3]),
    /// Red, green and blue up to this.
    Channels([&'e Property; 3], f64),
}

impl<'e> Layout<'e> {
    fn of(element: &'e Element) -> Result<Self> {
        let rest_count = element.run("f_rest_");
        let sh_degree = (0..=MAX_SH_DEGREE).find(|d| rest_values(*d) == rest_count);
        let sh_degree = sh_degree.with_context(|| {
            format!("there are {rest_count} f_rest properties; 0, 9, 24 or 45 make SH degree 0, 1, 2 or 3")
        })?;
        let rest: Vec<String> = (0..rest_count).map(|i| format!("f_rest_{i}")).collect();
        let scales = ["scale_0", "scale_1", "scale_2"];
        let axes = if element.has("scale_0") && !element.has("scale_2") { 2 } else { 3 };
        Ok(Self {
            mean: all(element, ["x", "y", "z"])?,
            scale: scales[..axes].iter().map(|name| element.property(name)).collect::<Result<_>>()?,
            rotation: all(element, ["rot_0", "rot_1", "rot_2", "rot_3"])?,
            opacity: element.property("opacity")?,
            colour: Colour::of(element)?,
            rest: rest.iter().map(|name| element.property(name)).collect::<Result<_>>()?,
            sh_degree,
        })
    }

    fn raw(&self, row: &[u8]) -> Raw {
        let scale = |axis: usize| self.scale.get(axis).map_or(f64::NEG_INFINITY, |p| p.read(row));
        Raw {
            mean: self.mean.map(|p| p.read(row)),
            log_scale: [0, 1, 2].map(scale),
            rotation: self.rotation.map(|p| p.read(row)),
            opacity_logit: self.opacity.read(row),
        }
    }
}

impl<'e> Colour<'e> {
    fn of(element: &'e Element) -> Result<Self> {
        if !element.has("f_dc_0") && element.has("red") {
            let channels = all(element, ["red", "green", "blue"])?;
            let most = match channels[0].kind {
                Scalar::F32 | Scalar::F64 => 1.0,
                Scalar::U16 => 65535.0,
                _ => 255.0,
            };
            return Ok(Self::Channels(channels, most));
        }
        Ok(Self::Coefficients(all(element, ["f_dc_0", "f_dc_1", "f_dc_2"])?))
    }

    /// As coefficients of degree 0.
    fn read(self, row: &[u8]) -> [f32; 3] {
        match self {
            Self::Coefficients(coefficients) => coefficients.map(|p| p.read_f32(row)),
            Self::Channels(channels, most) => channels.map(|p| ((p.read(row) / most - 0.5) / C0) as f32),
        }
    }
}

fn all<'e, const N: usize>(element: &'e Element, names: [&str; N]) -> Result<[&'e Property; N]> {
    let properties: Vec<_> = names.iter().map(|name| element.property(name)).collect::<Result<_>>()?;
    Ok(std::array::from_fn(|i| properties[i]))
}

fn vertices(source: &mut Source, element: &Element) -> Result<Scene> {
    let mut rows = Rows::of(source, element)?;
    let kept = rows.kept();
    if !["scale_0", "rot_0", "opacity", "f_dc_0"].iter().any(|name| element.has(name)) {
        return points::read(source, &mut rows, &kept);
    }
    let layout = Layout::of(&kept)?;
    let mut builder = Builder::new(layout.sh_degree, rows.count)?;
    let (stride, bands) = (kept.stride(), layout.rest.len() / 3);
    for first in (0..rows.count).step_by(BLOCK) {
        source.before_block(&builder)?;
        let block = BLOCK.min(rows.count - first);
        let bytes = rows.next(source, first, block)?;
        builder.extend(block, |index, sh| {
            let row = &bytes[index * stride..][..stride];
            sh[0] = layout.colour.read(row);
            for (i, coefficient) in sh[1..].iter_mut().enumerate() {
                *coefficient = std::array::from_fn(|channel| layout.rest[channel * bands + i].read_f32(row));
            }
            layout.raw(row)
        });
    }
    let (gaussians, tally) = builder.finish();
    let flat = (layout.scale.len() == 2).then(|| "it has two scales, and is drawn as flat Gaussians".to_owned());
    let notices = flat.into_iter().collect();
    Ok(Scene { gaussians, tally, format: "PLY".to_owned(), is_antialiased: false, notices })
}
