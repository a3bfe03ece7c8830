//! Every intermediate buffer of a fast frame.

use anyhow::Result;

use super::shaders::{Bin, BinDispatches, Totals};
use super::workspace::{Demand, first_that_fits, length};
use crate::gpu::{Buffer, Device};

// The shaders' constants of the same names.
/// Of blocks.
pub(super) const BIN_SHAPE: [u32; 2] = [8, 4];
/// px
pub(super) const BLOCK_WIDTH: u32 = 8;
pub(super) const BLOCKS: u64 = 32;
pub(super) const MAX_BINS: u32 = 7200;
pub(super) const PROJECT_CHUNK: usize = 384;
pub(super) const BIN_CHUNKS: usize = 264;
const BIN_RUN: usize = 2048;
const BIN_STRETCH: usize = 1024;

/// The buffers of one fast frame in the making. In a [`Demand`], its tiles are bins.
pub struct FastWorkspace {
    pub room: Demand,
    pub totals: Buffer<Totals>,
    pub dispatches: Buffer<BinDispatches>,
    pub gaussian_from_splat: Buffer<u32>,
    /// Two or three elements each.
    pub splats: Buffer<[u32; 4]>,
    pub depth_keys: Buffer<u32>,
    pub span_ranges: Buffer<[u32; 2]>,
    pub spans: Buffer<u32>,
    pub listed_in_bins: Buffer<u32>,
    /// Where the entries of every part of the splats begin in every bin.
    pub part_places: Buffer<u32>,
    pub bins: Buffer<Bin>,
    pub bin_order: Buffer<u32>,
    pub run_bins: Buffer<u32>,
    pub stretch_bins: Buffer<u32>,
    /// Depth key and splat.
    pub entries: Buffer<[u32; 2]>,
    pub splat_ids: Buffer<u32>,
    /// A bit for every entry and block of its bin.
    pub masks: Buffer<u32>,
    splat_elements: usize,
}

impl FastWorkspace {
    /// A first guess of the room for a scene, from that of the portable path.
    pub fn guess(device: &Device, guess: Demand) -> Demand {
        let most = |bytes: u64| device.facts().limits.storage_range / bytes;
        // Captured scenes at 1080p: a splat is in 1.2 rows of bins and in 2 bins.
        let visible = guess.visible.min(most(48));
        Demand { visible, spans: visible / 2, instances: (2 * visible).max(1 << 15).min(most(8)), ..guess }
    }

    pub fn new(device: &Device, room: Demand, splat_elements: usize) -> Result<Self> {
        let visible = length("visible splats", room.visible)?;
        let spans = length("rows of bins", room.spans)?;
        let entries = length("entries of bins", room.instances)?;
        let stretches = entries / BIN_STRETCH + room.tiles;
        let words = |name: &str, len: usize| Buffer::<u32>::new(device, name, len);
        Ok(Self {
            room,
            totals: Buffer::new(device, "totals", 1)?,
            dispatches: Buffer::new(device, "dispatches", 1)?,
            gaussian_from_splat: words("gaussian from splat", visible)?,
            splats: Buffer::new(device, "splats", visible * splat_elements)?,
            depth_keys: words("depth keys", visible)?,
            span_ranges: Buffer::new(device, "span ranges", visible)?,
            spans: words("spans", spans)?,
            listed_in_bins: words("listed in bins", room.tiles)?,
            part_places: words("part places", BIN_CHUNKS * room.tiles)?,
            bins: Buffer::new(device, "bins", room.tiles)?,
            bin_order: words("bin order", room.tiles)?,
            run_bins: words("run bins", entries / BIN_RUN + room.tiles)?,
            stretch_bins: words("stretch bins", stretches)?,
            entries: Buffer::new(device, "entries", entries)?,
            splat_ids: words("splat ids", entries)?,
            masks: words("masks", stretches * BIN_STRETCH)?,
            splat_elements,
        })
    }

    /// Makes room for `demand` and a little more, if there is not enough.
    pub fn grow(&mut self, device: &Device, demand: Demand) -> Result<()> {
        if demand.fits(self.room) {
            return Ok(());
        }
        let elements = self.splat_elements;
        let rooms = demand.rooms_beyond(self.room);
        *self = Self::new(device, Demand::default(), elements)?; // frees what is there before the larger are made
        *self = first_that_fits(rooms, |room| Self::new(device, room, elements))?;
        Ok(())
    }

    /// Every buffer's name and bytes.
    pub fn buffers(&self) -> Vec<(&str, u64)> {
        let words = [
            &self.gaussian_from_splat,
            &self.depth_keys,
            &self.spans,
            &self.listed_in_bins,
            &self.part_places,
            &self.bin_order,
            &self.run_bins,
            &self.stretch_bins,
            &self.splat_ids,
            &self.masks,
        ];
        let mut all: Vec<_> = words.into_iter().map(Buffer::footprint).collect();
        all.extend([
            self.totals.footprint(),
            self.dispatches.footprint(),
            self.splats.footprint(),
            self.span_ranges.footprint(),
            self.bins.footprint(),
            self.entries.footprint(),
        ]);
        all
    }
}
