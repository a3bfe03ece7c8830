//! The conversion of a picture to the integers of a file on the GPU: fewer bytes to copy, and no work for the host.

use anyhow::Result;

use super::shaders::shared::{Pack, PackBindings, PackConstants, PackPush};
use crate::gpu::{Buffer, Commands, Device, DispatchSize, Image, Stage};
use crate::pixels::Integers;

/// The stage for one kind of integers, and its buffer.
pub struct Packer {
    integers: Integers,
    stage: Stage<Pack>,
    packed: Buffer<u32>,
}

impl Packer {
    pub fn new(device: &Device, integers: Integers) -> Result<Self> {
        let constants = PackConstants {
            colours: matches!(integers, Integers::Rgb8 | Integers::Rgb16),
            wide: matches!(integers, Integers::Rgb16 | Integers::Grey16),
        };
        Ok(Self { integers, stage: Stage::new(device, &constants)?, packed: Buffer::new(device, "packed", 1)? })
    }

    pub fn integers(&self) -> Integers {
        self.integers
    }

    /// Enlarges the buffer to pictures of this size.
    pub fn fit(&mut self, device: &Device, size: [u32; 2]) -> Result<()> {
        let words = self.integers.words(size);
        if self.packed.len() < words {
            self.packed = Buffer::new(device, "packed", words)?;
        }
        Ok(())
    }

    /// Records the packing of `image`. Returns the buffer with the packed picture, its last word padded with 0.
    pub fn record(&self, cmd: &mut Commands, image: &Image) -> &Buffer<u32> {
        let size_px = image.size();
        let pixels: u64 = size_px.iter().map(|side| u64::from(*side)).product();
        let group = if matches!(self.integers, Integers::Rgb16 | Integers::Grey16) { 2 } else { 4 };
        let bindings = PackBindings { image, packed: &self.packed };
        cmd.dispatch(&self.stage, bindings, PackPush { size_px }, DispatchSize::Invocations(pixels.div_ceil(group)));
        &self.packed
    }
}
