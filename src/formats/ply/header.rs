//! The header of a PLY: its elements, their encoding, and the comments of trainers.

use anyhow::{Context, Result, bail, ensure};

use crate::formats::input::Input;

/// Largest header that is read.
const MAX_HEADER_BYTES: u64 = 1 << 20;

/// Largest number of properties of an element.
const MAX_PROPERTIES: usize = 1024;

/// Encoding of the elements after the header.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Encoding {
    LittleEndian,
    BigEndian,
    /// One line of text per row.
    Ascii,
}

/// One element of a PLY header.
#[derive(Clone, Debug)]
pub(crate) struct Element {
    pub name: String,
    pub count: u64,
    /// Scalar properties in file order; lists are left out. CloudCompare's `scalar_` or `scal_` before a name is, too.
    pub properties: Vec<Property>,
    /// It has a list property, so the size of its rows is unknown.
    pub has_list: bool,
    pub encoding: Encoding,
}

#[derive(Clone, Debug)]
pub(crate) struct Property {
    pub name: String,
    /// The type that the header states.
    pub kind: Scalar,
    /// The type of the value in a row: `kind`, or 64-bit floats if the row was text.
    stored: Scalar,
    /// Bytes from the start of the element.
    pub offset: usize,
    is_big_endian: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Scalar {
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

    /// The largest value of an unsigned integer, which stands for 1; `None` for other types.
    pub fn one(self) -> Option<f64> {
        match self {
            Self::U8 => Some(255.0),
            Self::U16 => Some(65535.0),
            _ => None,
        }
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    fn read(self, bytes: &[u8], is_big_endian: bool) -> f64 {
        fn first<const N: usize>(bytes: &[u8], is_big_endian: bool) -> [u8; N] {
            let mut first = *bytes.first_chunk().expect("a property lies inside its element");
            if is_big_endian {
                first.reverse();
            }
            first
        }
        match self {
            Self::I8 => f64::from(bytes[0] as i8),
            Self::U8 => f64::from(bytes[0]),
            Self::I16 => f64::from(i16::from_le_bytes(first(bytes, is_big_endian))),
            Self::U16 => f64::from(u16::from_le_bytes(first(bytes, is_big_endian))),
            Self::I32 => f64::from(i32::from_le_bytes(first(bytes, is_big_endian))),
            Self::U32 => f64::from(u32::from_le_bytes(first(bytes, is_big_endian))),
            Self::F32 => f64::from(f32::from_le_bytes(first(bytes, is_big_endian))),
            Self::F64 => f64::from_le_bytes(first(bytes, is_big_endian)),
        }
    }
}

impl Element {
    pub fn stride(&self) -> usize {
        self.properties.iter().map(|p| p.stored.bytes()).sum()
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

    /// Removes what CloudCompare puts before the names of scalar fields.
    fn remove_prefixes(&mut self) {
        for index in 0..self.properties.len() {
            let name = &self.properties[index].name;
            let bare = name.strip_prefix("scalar_").unwrap_or(name);
            let bare = bare.strip_prefix("scal_").unwrap_or(bare).to_owned();
            if !self.has(&bare) {
                self.properties[index].name = bare;
            }
        }
    }

    /// The element with 64-bit floats for all properties, the form in which parsed lines of text are kept.
    pub fn widened(&self) -> Self {
        let widen = |(i, p): (usize, &Property)| Property { stored: Scalar::F64, offset: 8 * i, ..p.clone() };
        let properties = self.properties.iter().enumerate().map(widen).collect();
        Self { properties, encoding: Encoding::LittleEndian, ..self.clone() }
    }
}

impl Property {
    pub fn read(&self, element: &[u8]) -> f64 {
        self.stored.read(&element[self.offset..], self.is_big_endian)
    }

    /// The value rounded to 32 bits. Most of a file is colours in 32-bit floats, which are copied.
    #[inline]
    pub fn read_f32(&self, element: &[u8]) -> f32 {
        match element[self.offset..].first_chunk() {
            Some(bytes) if self.stored == Scalar::F32 && !self.is_big_endian => f32::from_le_bytes(*bytes),
            _ => self.read(element) as f32,
        }
    }
}

/// The elements of a PLY that hold something, and what its comments state.
pub(crate) struct Header {
    pub elements: Vec<Element>,
    pub is_antialiased: bool,
    pub notices: Vec<String>,
}

/// Reads up to the first element.
pub(crate) fn read(input: &mut Input) -> Result<Header> {
    let (mut encoding, mut elements, mut comments) = (None, Vec::<Element>::new(), Comments::default());
    let start = input.left();
    let mut number = 0;
    loop {
        let room = MAX_HEADER_BYTES.saturating_sub(start - input.left());
        let line = input.line(room, "the PLY header")?;
        number += 1;
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["ply"] if number == 1 => {}
            ["format", name, "1.0"] => encoding = Some(encoding_of(name)?),
            ["comment" | "obj_info", ref words @ ..] => comments.take(words),
            [] => {}
            ["element", name, count] => {
                let encoding = encoding.context("the PLY header has no format line before its elements")?;
                let count = count
                    .parse()
                    .with_context(|| format!("header line {number}: '{}' is not a count", quoted(count)))?;
                let name = quoted(name);
                elements.push(Element { name, count, properties: Vec::new(), has_list: false, encoding });
            }
            ["property", ref kind @ .., name] => {
                let element = elements
                    .last_mut()
                    .with_context(|| format!("header line {number}: a property outside of an element"))?;
                match kind {
                    ["list", ..] => element.has_list = true,
                    [kind] => {
                        let kind = Scalar::parse(kind)
                            .with_context(|| format!("header line {number}: '{}' is not a PLY type", quoted(kind)))?;
                        ensure!(
                            element.properties.len() < MAX_PROPERTIES,
                            "element {} has over {MAX_PROPERTIES} properties",
                            element.name
                        );
                        ensure!(!element.has(name), "header line {number}: property {} is there twice", quoted(name));
                        let (offset, is_big_endian) = (element.stride(), element.encoding == Encoding::BigEndian);
                        let (name, stored) = (quoted(name), kind);
                        element.properties.push(Property { name, kind, stored, offset, is_big_endian });
                    }
                    _ => bail!("header line {number} is not PLY: '{}'", quoted(&line)),
                }
            }
            ["end_header"] => {
                ensure!(encoding.is_some(), "the PLY header has no format line");
                // Each row of a text has a line, even if there is nothing in it.
                elements.retain(|e| e.has_list || !e.properties.is_empty() || e.encoding == Encoding::Ascii);
                elements.iter_mut().for_each(Element::remove_prefixes);
                return Ok(Header { elements, is_antialiased: comments.is_antialiased, notices: comments.notices() });
            }
            _ => bail!("header line {number} is not PLY: '{}'", quoted(&line)),
        }
    }
}

fn encoding_of(name: &str) -> Result<Encoding> {
    Ok(match name {
        "binary_little_endian" => Encoding::LittleEndian,
        "binary_big_endian" => Encoding::BigEndian,
        "ascii" => Encoding::Ascii,
        other => bail!(
            "PLY format {} is not supported, only ascii, binary_little_endian and binary_big_endian",
            quoted(other)
        ),
    })
}

/// The first 40 characters of a text from a file, escaped for printing.
pub(crate) fn quoted(text: &str) -> String {
    text.chars().take(40).flat_map(char::escape_debug).collect()
}

/// Settings that trainers write into comments. The last comment of a kind counts.
#[derive(Default)]
struct Comments {
    is_antialiased: bool,
    mode: Option<String>,
    kernel_size: Option<f64>,
    background: Option<String>,
    vertical: Option<String>,
}

impl Comments {
    fn take(&mut self, words: &[&str]) {
        let words: Vec<String> = words.iter().map(|word| word.to_ascii_lowercase()).collect();
        match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
            // Brush and splat-transform.
            ["splatrendermode:", mode] => {
                self.is_antialiased = mode == "mip";
                self.mode = Some(mode.to_owned());
            }
            // Postshot.
            ["antialiased", flag] => self.is_antialiased = flag == "1",
            // Brush writes y or three numbers, nerfstudio z.
            ["vertical", "axis:", ref axis @ ..] => self.vertical = Some(axis.join(" ")),
            // web-splat.
            [word] => match word.split_once('=') {
                Some(("mip", flag)) => self.is_antialiased = matches!(flag, "true" | "1"),
                Some(("kernel_size", size)) => self.kernel_size = size.parse().ok(),
                Some(("background_color", colour)) => self.background = Some(colour.to_owned()),
                _ => {}
            },
            _ => {}
        }
    }

    /// Differences between these settings and the picture.
    fn notices(&self) -> Vec<String> {
        let is_other = |axis: &&String| !matches!(axis.as_str(), "y" | "-y");
        let vertical = self.vertical.as_ref().filter(is_other).map(|axis| {
            format!("its vertical axis is {}, but it is drawn with y as vertical axis; --up turns it", quoted(axis))
        });
        let mode = match self.mode.as_deref() {
            None | Some("default" | "mip") => None,
            Some("2dgs") => Some("it was trained as 2D Gaussians, and is drawn as flat ones in 3D".to_owned()),
            Some(other) => Some(format!("its mode of rendering, {}, is unknown and not used", quoted(other))),
        };
        let is_black = |colour: &str| colour.split(',').all(|value| value.parse() == Ok(0.0));
        let background = self.background.as_deref().filter(|colour| !is_black(colour));
        let background = background.map(|colour| background_notice(&quoted(colour)));
        [self.kernel_size.and_then(kernel_notice), vertical, mode, background].into_iter().flatten().collect()
    }
}

/// A note on a scene that was trained with this low-pass.
pub(crate) fn kernel_notice(px2: f64) -> Option<String> {
    (px2 != LOW_PASS).then(|| format!("it asks for a kernel of {px2} px^2, but is drawn with {LOW_PASS}"))
}

/// A note on a scene that was trained on a background other than black.
pub(crate) fn background_notice(colour: &str) -> String {
    format!("it was trained on the background {colour}, which --background sets; the default is black")
}

/// px^2, the low-pass that renderers of the original kind add to the covariance on the screen.
const LOW_PASS: f64 = 0.3;
