//! Textures of bytes, decoded from lossless WebP images.

use std::io::Cursor;

use anyhow::{Context, Result, ensure};
use image_webp::WebPDecoder;

use crate::host_memory::host_vec;

/// Smallest and largest number of texels of a texture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    pub least: u64,
    pub most: u64,
}

impl Bounds {
    /// Upper bound on the size of an image file with this number of texels, however badly compressed.
    pub fn most_bytes(self) -> u64 {
        self.most.saturating_mul(5).saturating_add(1 << 16)
    }
}

/// A texture: three or four bytes per texel, row after row.
pub(crate) struct Texture {
    /// Width and height.
    pub size: [u32; 2],
    bytes: Vec<u8>,
    channels: usize,
}

impl Texture {
    /// Decodes the file `name`. Fails if its number of texels is out of bounds.
    pub fn decode(name: &str, file: &[u8], bounds: Bounds) -> Result<Self> {
        let mut decoder = open(name, file)?;
        let (width, height) = decoder.dimensions();
        let texels = u64::from(width) * u64::from(height);
        let Bounds { least, most } = bounds;
        ensure!(
            (least..=most).contains(&texels),
            "{name} is {width}x{height} texels large, expected {least} to {most} of them"
        );
        let channels = if decoder.has_alpha() { 4 } else { 3 };
        let size = usize::try_from(texels)? * channels;
        let mut bytes = host_vec(size, name)?;
        bytes.resize(size, 0);
        decoder.read_image(&mut bytes).with_context(|| format!("{name} is damaged"))?;
        Ok(Self { size: [width, height], bytes, channels })
    }

    pub fn texels(&self) -> usize {
        self.bytes.len() / self.channels
    }

    /// Red, green, blue and alpha of a texel; alpha is 255 if the image has none.
    pub fn texel(&self, index: usize) -> [u8; 4] {
        let bytes = &self.bytes[index * self.channels..][..self.channels];
        [bytes[0], bytes[1], bytes[2], bytes.get(3).copied().unwrap_or(255)]
    }
}

/// Width and height of an image, from its header.
pub(crate) fn size(name: &str, file: &[u8]) -> Result<(u32, u32)> {
    Ok(open(name, file)?.dimensions())
}

fn open<'f>(name: &str, file: &'f [u8]) -> Result<WebPDecoder<Cursor<&'f [u8]>>> {
    let mut decoder = WebPDecoder::new(Cursor::new(file)).with_context(|| format!("{name} is not a WebP image"))?;
    ensure!(!decoder.is_lossy(), "{name} is compressed with loss, which would change every value");
    ensure!(!decoder.is_animated(), "{name} is an animation");
    Ok(decoder)
}
