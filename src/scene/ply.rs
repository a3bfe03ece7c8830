//! PLY: the header, and the scenes of the original 3DGS (`x y z`, `f_dc`, `f_rest`, `opacity`, `scale`, `rot`).

use std::io::Read;

use anyhow::{Context, Result, bail, ensure};

use super::canonical::{BLOCK, Builder, Raw};
use super::source::Source;
use super::{MAX_SH_DEGREE, Scene, checked_count, compressed_ply, rest_values};

/// Longest header that is read.
const MAX_HEADER_BYTES: u64 = 1 << 20;

/// One element of a PLY header.
#[derive(Debug)]
pub(super) struct Element {
    pub name: String,
    pub count: u64,
    /// In file order, without lists.
    pub properties: Vec<Property>,
    /// Has a list property: the size of its rows is unknown.
    pub has_list: bool,
}

#[derive(Debug)]
pub(super) struct Property {
    pub name: String,
    pub kind: Scalar,
    /// Bytes from the start of the element.
    pub offset: usize,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    fn read(self, bytes: &[u8]) -> f64 {
        fn first<const N: usize>(bytes: &[u8]) -> [u8; N] {
            *bytes.first_chunk().expect("a property lies inside its element")
        }
        match self {
            Self::I8 => f64::from(bytes[0] as i8),
            Self::U8 => f64::from(bytes[0]),
            Self::I16 => f64::from(i16::from_le_bytes(first(bytes))),
            Self::U16 => f64::from(u16::from_le_bytes(first(bytes))),
            Self::I32 => f64::from(i32::from_le_bytes(first(bytes))),
            Self::U32 => f64::from(u32::from_le_bytes(first(bytes))),
            Self::F32 => f64::from(f32::from_le_bytes(first(bytes))),
            Self::F64 => f64::from_le_bytes(first(bytes)),
        }
    }
}

impl Element {
    pub fn stride(&self) -> usize {
        self.properties.iter().map(|p| p.kind.bytes()).sum()
    }

    pub fn property(&self, name: &str) -> Result<&Property> {
        let found = self.properties.iter().find(|p| p.name == name);
        found.with_context(|| format!("property {name} of element {} is missing", self.name))
    }

    pub fn has(&self, name: &str) -> bool {
        self.properties.iter().any(|p| p.name == name)
    }

    /// The length of a run of properties `{stem}0`, `{stem}1`, ...
    pub fn run(&self, stem: &str) -> usize {
        (0..).take_while(|i| self.has(&format!("{stem}{i}"))).count()
    }
}

impl Property {
    pub fn read(&self, element: &[u8]) -> f64 {
        self.kind.read(&element[self.offset..])
    }
}

pub(super) fn read(source: &mut Source) -> Result<Scene> {
    let Header { elements, is_antialiased } = header(source)?;
    if elements.iter().any(|e| e.name == "chunk") {
        return Ok(Scene { is_antialiased, ..compressed_ply::read(source, &elements)? });
    }
    for element in &elements {
        if element.name == "vertex" {
            return Ok(Scene { is_antialiased, ..vertices(source, element)? });
        }
        skip(source, element)?;
    }
    bail!("the header has no element vertex")
}

/// Reads past an element that nothing is taken from.
pub(super) fn skip(source: &mut Source, element: &Element) -> Result<()> {
    ensure!(
        !element.has_list,
        "element {} has a list property; lists before the Gaussians are not supported",
        element.name
    );
    let count = checked_count(element.count, element.stride() as u64, source.left(), &element.name)?;
    let bytes = (count * element.stride()) as u64;
    let skipped = std::io::copy(&mut source.take(bytes), &mut std::io::sink())?;
    ensure!(skipped == bytes, "the file ends inside element {}", element.name);
    Ok(())
}

struct Header {
    elements: Vec<Element>,
    is_antialiased: bool,
}

fn header(source: &mut Source) -> Result<Header> {
    let (mut has_format, mut is_antialiased) = (false, false);
    let mut elements: Vec<Element> = Vec::new();
    let start = source.left();
    let mut number = 0;
    loop {
        let room = MAX_HEADER_BYTES.saturating_sub(start - source.left());
        let line = source.line(room, "the PLY header")?;
        number += 1;
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["ply"] if number == 1 => {}
            ["format", "binary_little_endian", "1.0"] => has_format = true,
            ["format", other, ..] => bail!("PLY format {other} is not supported, only binary_little_endian 1.0"),
            // Brush and splat-transform; Postshot. The last one counts.
            ["comment", "SplatRenderMode:", mode] => is_antialiased = mode == "mip",
            ["comment", "antialiased", flag] => is_antialiased = flag == "1",
            ["comment" | "obj_info", ..] | [] => {}
            ["element", name, count] => {
                let count = count.parse().with_context(|| format!("header line {number}: '{count}' is not a count"))?;
                elements.push(Element { name: name.to_owned(), count, properties: Vec::new(), has_list: false });
            }
            ["property", ref kind @ .., name] => {
                let element = elements
                    .last_mut()
                    .with_context(|| format!("header line {number}: a property outside of an element"))?;
                match kind {
                    ["list", ..] => element.has_list = true,
                    [kind] => {
                        let kind = Scalar::parse(kind)
                            .with_context(|| format!("header line {number}: '{kind}' is not a PLY type"))?;
                        ensure!(!element.has(name), "header line {number}: property {name} is there twice");
                        let offset = element.stride();
                        element.properties.push(Property { name: name.to_owned(), kind, offset });
                    }
                    _ => bail!("header line {number} is not PLY: '{line}'"),
                }
            }
            ["end_header"] => {
                ensure!(has_format, "the PLY header has no format line");
                return Ok(Header { elements, is_antialiased });
            }
            _ => bail!("header line {number} is not PLY: '{line}'"),
        }
    }
}

/// Where a Gaussian's values are in a vertex.
struct Layout<'e> {
    mean: [&'e Property; 3],
    scale: [&'e Property; 3],
    rotation: [&'e Property; 4],
    opacity: &'e Property,
    dc: [&'e Property; 3],
    /// Channel-major: all red, all green, all blue.
    rest: Vec<&'e Property>,
    sh_degree: u32,
}

impl<'e> Layout<'e> {
    fn of(element: &'e Element) -> Result<Self> {
        let rest_count = element.run("f_rest_");
        let sh_degree = (0..=MAX_SH_DEGREE).find(|d| rest_values(*d) == rest_count);
        let sh_degree = sh_degree.with_context(|| {
            format!("there are {rest_count} f_rest properties; 0, 9, 24 or 45 make SH degree 0, 1, 2 or 3")
        })?;
        let rest: Vec<String> = (0..rest_count).map(|i| format!("f_rest_{i}")).collect();
        Ok(Self {
            mean: all(element, ["x", "y", "z"])?,
            scale: all(element, ["scale_0", "scale_1", "scale_2"])?,
            rotation: all(element, ["rot_0", "rot_1", "rot_2", "rot_3"])?,
            opacity: element.property("opacity")?,
            dc: all(element, ["f_dc_0", "f_dc_1", "f_dc_2"])?,
            rest: rest.iter().map(|name| element.property(name)).collect::<Result<_>>()?,
            sh_degree,
        })
    }
}

fn all<'e, const N: usize>(element: &'e Element, names: [&str; N]) -> Result<[&'e Property; N]> {
    let properties: Vec<_> = names.iter().map(|name| element.property(name)).collect::<Result<_>>()?;
    Ok(std::array::from_fn(|i| properties[i]))
}

fn vertices(source: &mut Source, element: &Element) -> Result<Scene> {
    ensure!(!element.has_list, "element vertex has a list property");
    let layout = Layout::of(element)?;
    let count = checked_count(element.count, element.stride() as u64, source.left(), "vertices")?;
    let mut builder = Builder::new(layout.sh_degree, count)?;
    let stride = element.stride();
    let bands = layout.rest.len() / 3;
    let mut rows = Vec::new();
    for first in (0..count).step_by(BLOCK) {
        source.before_block(&builder)?;
        let block = BLOCK.min(count - first);
        rows.resize(block * stride, 0);
        source.fill(&mut rows, "the vertices")?;
        builder.extend(block, |index, sh| {
            let row = &rows[index * stride..][..stride];
            sh[0] = layout.dc.map(|p| p.read(row) as f32);
            for (i, coefficient) in sh[1..].iter_mut().enumerate() {
                *coefficient = std::array::from_fn(|channel| layout.rest[channel * bands + i].read(row) as f32);
            }
            Raw {
                mean: layout.mean.map(|p| p.read(row)),
                log_scale: layout.scale.map(|p| p.read(row)),
                rotation: layout.rotation.map(|p| p.read(row)),
                opacity_logit: layout.opacity.read(row),
            }
        });
    }
    let (gaussians, tally) = builder.finish();
    Ok(Scene { gaussians, tally, format: "PLY".to_owned(), is_antialiased: false })
}
