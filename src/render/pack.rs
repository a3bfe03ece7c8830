//! The conversion of a picture to the integers of a file on the GPU, and back: fewer bytes to copy, and no work for the
//! host.

use anyhow::Result;

use super::band::Band;
use super::shaders::shared::{Pack, PackBindings, PackConstants, PackPush, Unpack, UnpackBindings, UnpackPush};
use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Image, Stage, Staging};
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

/// The stage that brings colours of 8 bits back into a picture, and its buffer.
pub struct Unpacker {
    stage: Stage<Unpack>,
    packed: Buffer<u32>,
}

impl Unpacker {
    pub fn new(device: &Device) -> Result<Self> {
        let stage = Stage::new(device, &())?;
        Ok(Self { stage, packed: Buffer::new(device, "packed", 1)? })
    }

    /// Enlarges the buffer so that these bands of a picture of this size fit into it.
    pub fn fit(&mut self, device: &Device, size_px: [u32; 2], bands: &[(Band, &Staging<u32>)]) -> Result<()> {
        let words = bands.iter().map(|(band, _)| Integers::Rgb8.words(band.size(size_px))).sum();
        if self.packed.len() < words {
            self.packed = Buffer::new(device, "packed", words)?;
        }
        Ok(())
    }

    /// Records the copy of bands to `image`. Each is packed as [`Integers::Rgb8`] in its memory.
    pub fn record(&self, cmd: &mut Commands, bands: &[(Band, &Staging<u32>)], image: &Image) {
        let words = |(band, memory): &(Band, _)| (*memory, Integers::Rgb8.words(band.size(image.size())));
        let parts = Vec::from_iter(bands.iter().map(words));
        cmd.upload_joined(&parts, &self.packed);
        cmd.barrier(Access::COPY_WRITE, Access::SHADER);
        let mut first_word = 0;
        for ((band, _), (_, words)) in bands.iter().zip(&parts) {
            let size_px = band.size(image.size());
            let push = UnpackPush { size_px, top: band.top, first_word: first_word as u32 };
            first_word += words;
            let bindings = UnpackBindings { image, packed: &self.packed };
            let pixels = u64::from(size_px[0]) * u64::from(size_px[1]);
            cmd.dispatch(&self.stage, bindings, push, DispatchSize::Invocations(pixels));
            cmd.barrier(Access::SHADER_WRITE, Access::SHADER_WRITE);
        }
    }
}
