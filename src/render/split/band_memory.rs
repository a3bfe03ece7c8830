//! The memory through which the pixels of bands come from one device to another.

use anyhow::{Context, Result};

use crate::gpu::{Device, Staging};
use crate::pixels::Integers;
use crate::render::frame_queue::{Form, HostFrame};

/// The form in which bands come to the other device: the fewest bytes that a screen needs.
pub const COLOURS: Integers = Integers::Rgb8;

/// The memory for the bands that `from` draws and `to` reads. There are several, since `to` may still read one while
/// `from` draws the next.
pub struct BandMemories {
    from: Device,
    to: Device,
    idle: Vec<BandMemory>,
    /// The host copies bands, also where both devices share its memory.
    copies: bool,
}

/// The memory for one band. It holds a whole picture, as the heights of bands change.
struct BandMemory {
    /// On the device that draws.
    host: HostFrame,
    receiver: Receiver,
}

/// The memory for one band on the device that reads it.
pub struct Receiver {
    pub pixels: Staging<u32>,
    /// It is the memory into which the other device draws.
    is_shared: bool,
}

impl BandMemories {
    pub fn new(from: &Device, to: &Device) -> Self {
        Self { from: from.clone(), to: to.clone(), idle: Vec::new(), copies: false }
    }

    /// Lets the host copy bands from now on.
    pub fn copy(&mut self) {
        (self.copies, self.idle) = (true, Vec::new());
    }

    /// Memory for a band of a picture of this size: into which one device draws, and from which the other one reads.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn take(&mut self, size_px: [u32; 2]) -> Result<(HostFrame, Receiver)> {
        let words = COLOURS.words(size_px);
        // Memory of a size that is no longer needed is freed.
        self.idle.retain(|memory| memory.receiver.pixels.len() == words);
        let memory = match self.idle.iter().position(|memory| memory.receiver.pixels.is_idle()) {
            Some(place) => self.idle.swap_remove(place),
            None => self.allocated(words)?,
        };
        Ok((memory.host, memory.receiver))
    }

    fn allocated(&self, words: usize) -> Result<BandMemory> {
        const NAME: &str = "bands";
        let (from, to) = (&self.from, &self.to);
        let shared = if self.copies { None } else { Staging::shared([from, to], NAME, words)? };
        let is_shared = shared.is_some();
        let [drawn, pixels] = match shared {
            Some(both) => both,
            None => [Staging::new(from, NAME, words)?, Staging::new(to, NAME, words)?],
        };
        let host = HostFrame::for_bands(Form::Integers(COLOURS), drawn);
        Ok(BandMemory { host, receiver: Receiver { pixels, is_shared } })
    }

    /// Gives back the memory of a band. It is used again when no commands read it any more.
    pub fn give_back(&mut self, host: HostFrame, receiver: Receiver) {
        self.idle.push(BandMemory { host, receiver });
    }
}

impl Receiver {
    /// Brings the pixels of a finished band to the device that reads them.
    ///
    /// # Errors
    /// If the band has no pixels in this form.
    pub fn receive(&mut self, host: &mut HostFrame) -> Result<()> {
        if !self.is_shared {
            let bytes = host.integers(COLOURS).context("bands have colours")?;
            // Not by the pool that shares work: a long job there would keep the window waiting.
            bytemuck::cast_slice_mut::<u32, u8>(self.pixels.map())[..bytes.len()].copy_from_slice(bytes);
        }
        Ok(())
    }
}
