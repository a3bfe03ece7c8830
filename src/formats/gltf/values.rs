//! The numbers of a glTF file: accessors, the buffer views that they refer to, and sparse replacements.

use anyhow::{Context, Result, ensure};
use serde::Deserialize;

use crate::formats::input::checked_count;

/// The accessors of a file, and the bytes that they refer to.
pub(crate) struct Data<'d> {
    pub accessors: &'d [Accessor],
    pub views: &'d [View],
    pub buffers: &'d [Vec<u8>],
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Accessor {
    #[serde(flatten)]
    location: Location,
    component_type: u32,
    count: u64,
    #[serde(rename = "type")]
    shape: String,
    #[serde(default)]
    normalized: bool,
    sparse: Option<Sparse>,
}

/// The first byte of rows of numbers.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Location {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: u64,
}

/// Elements that replace others.
#[derive(Deserialize)]
struct Sparse {
    count: u64,
    indices: SparseIndices,
    values: Location,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct SparseIndices {
    #[serde(flatten)]
    location: Location,
    component_type: u32,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct View {
    buffer: usize,
    #[serde(default)]
    byte_offset: u64,
    byte_length: u64,
    byte_stride: Option<u64>,
}

impl<'d> Data<'d> {
    /// The values of an accessor with this number of components.
    pub fn values(&self, index: usize, components: usize, name: &str) -> Result<Values<'d>> {
        let accessor = self.accessors.get(index).with_context(|| format!("accessor {index} of {name} is missing"))?;
        let shape = ["SCALAR", "VEC2", "VEC3", "VEC4"][components - 1];
        ensure!(accessor.shape == shape, "{name} is {}, not {shape}", accessor.shape);
        let component = Component::named(accessor.component_type, name)?;
        let values = self.rows(&accessor.location, component, components, accessor.count, name)?;
        let values = Values { is_normalized: accessor.normalized, ..values };
        match &accessor.sparse {
            Some(sparse) => {
                let replaced = self.replaced(&values, sparse, components, name)?;
                Ok(Values { replaced: Some(Box::new(replaced)), ..values })
            }
            None => Ok(values),
        }
    }

    /// `count` rows of numbers.
    fn rows(
        &self,
        location: &Location,
        component: Component,
        row: usize,
        count: u64,
        name: &str,
    ) -> Result<Values<'d>> {
        let view = location.buffer_view.and_then(|view| self.views.get(view));
        let view = view.with_context(|| format!("{name} has no buffer view"))?;
        let buffer = self.buffers.get(view.buffer).with_context(|| format!("{name} has no buffer"))?;
        let row = (row * component.bytes()) as u64;
        let stride = view.byte_stride.unwrap_or(row);
        ensure!(stride >= row && stride <= 252.max(row), "{name} has {stride} bytes from one element to the next");
        let end = view.byte_offset.checked_add(view.byte_length).filter(|end| *end <= buffer.len() as u64);
        let end = end.with_context(|| format!("{name} lies outside of its buffer of {} bytes", buffer.len()))?;
        let start = view.byte_offset.saturating_add(location.byte_offset);
        let available = (end + stride - row).saturating_sub(start);
        let count = checked_count(count, stride, available, &format!("values of {name}"))?;
        let bytes = if count == 0 { &[] } else { &buffer[start as usize..end as usize] };
        Ok(Values { bytes, stride: stride as usize, component, is_normalized: false, count, replaced: None })
    }

    /// The rows that a sparse accessor replaces.
    fn replaced(&self, all: &Values, sparse: &Sparse, components: usize, name: &str) -> Result<Replaced<'d>> {
        let Sparse { count, indices, values } = sparse;
        let kind = Component::named(indices.component_type, name)?;
        let indices = self.rows(&indices.location, kind, 1, *count, &format!("indices of {name}"))?;
        let rows = self.rows(values, all.component, components, *count, &format!("replaced values of {name}"))?;
        let mut next = 0.0;
        for [index] in (0..indices.count).map(|i| indices.row(i)) {
            ensure!(index >= next, "the indices of replaced values of {name} are not ascending");
            ensure!(index < all.count as f64, "value {index} of {name} is replaced, but there are {}", all.count);
            next = index + 1.0;
        }
        Ok(Replaced { indices, rows: Values { is_normalized: all.is_normalized, ..rows } })
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn named(code: u32, name: &str) -> Result<Self> {
        Self::of(code).with_context(|| format!("{name} has components of the unknown type {code}"))
    }

    fn of(code: u32) -> Option<Self> {
        Some(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }
}

/// The values of an accessor: rows of numbers.
pub(crate) struct Values<'d> {
    bytes: &'d [u8],
    stride: usize,
    component: Component,
    is_normalized: bool,
    pub count: usize,
    replaced: Option<Box<Replaced<'d>>>,
}

/// Rows that a sparse accessor replaces.
struct Replaced<'d> {
    /// Ascending.
    indices: Values<'d>,
    rows: Values<'d>,
}

impl Values<'_> {
    pub fn row<const N: usize>(&self, index: usize) -> [f64; N] {
        if let Some(Replaced { indices, rows }) = self.replaced.as_deref()
            && let Some(found) = indices.position(index as f64)
        {
            return rows.row(found);
        }
        let size = self.component.bytes();
        std::array::from_fn(|i| self.number(&self.bytes[index * self.stride + i * size..][..size]))
    }

    /// The position of a value in an ascending column.
    fn position(&self, value: f64) -> Option<usize> {
        let (mut from, mut to) = (0, self.count);
        while from < to {
            let middle = from.midpoint(to);
            let [found] = self.row(middle);
            (from, to) = if found < value { (middle + 1, to) } else { (from, middle) };
        }
        (from < self.count && self.row(from) == [value]).then_some(from)
    }

    fn number(&self, bytes: &[u8]) -> f64 {
        let (value, most) = match (self.component, bytes) {
            (Component::I8, [a, ..]) => (f64::from(*a as i8), 127.0),
            (Component::U8, [a, ..]) => (f64::from(*a), 255.0),
            (Component::I16, [a, b, ..]) => (f64::from(i16::from_le_bytes([*a, *b])), 32767.0),
            (Component::U16, [a, b, ..]) => (f64::from(u16::from_le_bytes([*a, *b])), 65535.0),
            (Component::U32, [a, b, c, d, ..]) => (f64::from(u32::from_le_bytes([*a, *b, *c, *d])), u32::MAX.into()),
            (Component::F32, [a, b, c, d, ..]) => return f64::from(f32::from_le_bytes([*a, *b, *c, *d])),
            _ => return f64::NAN,
        };
        if self.is_normalized { (value / most).max(-1.0) } else { value }
    }
}
