//! Reads or skips the rows of an element.

use anyhow::{Context, Result, ensure};

use super::header::{Element, Encoding, quoted};
use crate::formats::input::{Input, checked_count};
use crate::host_memory::host_vec;

/// Longest line of an element in text encoding.
const MAX_LINE_BYTES: u64 = 1 << 16;

/// Skips an element.
pub(crate) fn skip(input: &mut Input, element: &Element) -> Result<()> {
    ensure!(
        !element.has_list || element.encoding == Encoding::Ascii,
        "element {} has a list property; lists before the Gaussians are not supported",
        element.name
    );
    let what = &rows_of(element);
    if element.encoding == Encoding::Ascii {
        let count = checked_count(element.count, 1, input.left(), what)?;
        return (0..count).try_for_each(|_| input.line(MAX_LINE_BYTES, what).map(drop));
    }
    let count = checked_count(element.count, element.stride() as u64, input.left(), what)?;
    input.skip((count * element.stride()) as u64, what)
}

/// The rows of an element, as errors name them.
fn rows_of(element: &Element) -> String {
    format!("rows of element {}", element.name)
}

/// Reads the rows of an element block by block.
pub(crate) struct Rows<'e> {
    element: &'e Element,
    pub count: usize,
    bytes: Vec<u8>,
}

impl<'e> Rows<'e> {
    /// The rows of `element`, which must be next in `input`. Fails if the file cannot hold them.
    pub fn of(input: &Input, element: &'e Element) -> Result<Self> {
        ensure!(!element.has_list, "element {} has a list property", element.name);
        let is_text = element.encoding == Encoding::Ascii;
        // In text, at least one digit and one separator per number.
        let least = if is_text { 2 * element.properties.len() } else { element.stride() };
        // The last line may lack its end.
        let available = input.left() + u64::from(is_text);
        let count = checked_count(element.count, least as u64, available, "vertices")?;
        Ok(Self { element, count, bytes: Vec::new() })
    }

    /// The layout of the rows that `next` returns: that of the file, or 64-bit floats if the file is text.
    pub fn kept(&self) -> Element {
        if self.element.encoding == Encoding::Ascii { self.element.widened() } else { self.element.clone() }
    }

    /// Reads rows `first` to `first + count`, which must be the next ones, and returns their bytes.
    pub fn next(&mut self, input: &mut Input, first: usize, count: usize) -> Result<&[u8]> {
        if self.element.encoding != Encoding::Ascii {
            if self.bytes.capacity() == 0 {
                self.bytes = host_vec(count * self.element.stride(), "vertices")?;
            }
            self.bytes.resize(count * self.element.stride(), 0);
            input.fill(&mut self.bytes, "the vertices")?;
            return Ok(&self.bytes);
        }
        self.bytes.clear();
        for row in first..first + count {
            let line = input.last_line(MAX_LINE_BYTES, "the vertices")?;
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

/// Reads all rows of an element in binary encoding. `take` appends `per_row` values per row.
pub(crate) fn binary_rows<T>(
    input: &mut Input,
    element: &Element,
    per_row: usize,
    take: impl Fn(&[u8], &mut Vec<T>),
) -> Result<Vec<T>> {
    ensure!(!element.has_list, "element {} has a list property", element.name);
    ensure!(element.encoding != Encoding::Ascii, "packed Gaussians written as text are not supported");
    let what = &rows_of(element);
    let count = checked_count(element.count, element.stride() as u64, input.left(), what)?;
    let mut row = vec![0; element.stride()];
    let mut all = host_vec(count * per_row, what)?;
    for _ in 0..count {
        input.fill(&mut row, what)?;
        take(&row, &mut all);
    }
    Ok(all)
}
