//! Little-endian numbers in bytes.

use anyhow::{Result, bail, ensure};

/// Writes numbers one after another.
#[derive(Default)]
pub struct Writer(pub Vec<u8>);

impl Writer {
    pub fn u32(&mut self, value: u32) {
        self.0.extend(value.to_le_bytes());
    }

    pub fn u64(&mut self, value: u64) {
        self.0.extend(value.to_le_bytes());
    }

    pub fn f32s(&mut self, values: &[f32]) {
        values.iter().for_each(|value| self.u32(value.to_bits()));
    }

    pub fn f64s(&mut self, values: &[f64]) {
        values.iter().for_each(|value| self.u64(value.to_bits()));
    }

    /// The length of a text in bytes, and the text, cut to `most` bytes.
    pub fn text(&mut self, text: &str, most: usize) {
        let text = &text[..text.floor_char_boundary(most)];
        self.u32(text.len() as u32);
        self.0.extend(text.bytes());
    }
}

/// Reads numbers one after another.
pub struct Reader<'b>(pub &'b [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N]> {
        let Some((first, rest)) = self.0.split_first_chunk() else { bail!("the header ends too soon") };
        self.0 = rest;
        Ok(*first)
    }

    pub fn u32(&mut self) -> Result<u32> {
        Ok(u32::from_le_bytes(self.take()?))
    }

    pub fn u64(&mut self) -> Result<u64> {
        Ok(u64::from_le_bytes(self.take()?))
    }

    /// A number that is 0 for false or 1 for true.
    pub fn flag(&mut self) -> Result<bool> {
        let value = self.u32()?;
        ensure!(value <= 1, "a flag of the header is {value}");
        Ok(value == 1)
    }

    pub fn f32s<const N: usize>(&mut self) -> Result<[f32; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = f32::from_bits(self.u32()?);
        }
        Ok(values)
    }

    pub fn f64s<const N: usize>(&mut self) -> Result<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = f64::from_bits(self.u64()?);
        }
        Ok(values)
    }

    pub fn text(&mut self) -> Result<String> {
        let len = self.u32()? as usize;
        ensure!(len <= self.0.len(), "a text of the header has {len} bytes");
        let (text, rest) = self.0.split_at(len);
        self.0 = rest;
        Ok(String::from_utf8(text.to_vec())?)
    }
}
