//! Every intermediate buffer of a fast frame.

use anyhow::Result;

use crate::render::shaders::{Bin, FastDispatches, Totals};
use crate::render::portable::workspace::{Capacity, first_that_fits, length};
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
const BIN_PIECES: usize = 16;
const BIN_STRETCH: usize = 1024;

/// The buffers of one fast frame in the making. In a [`Capacity`], its tiles are bins.
pub struct FastWorkspace {
    pub room: Capacity,
    pub totals: Buffer<Totals>,
    pub dispatches: Buffer<FastDispatches>,
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
    /// The same between mergers, if one is not enough.
    pub merged: Buffer<[u32; 2]>,
    /// Times that lists are merged.
    mergers: u32,
    pub splat_ids: Buffer<u32>,
    /// A bit for every entry and block of its bin.
    pub masks: Buffer<u32>,
    splat_elements: usize,
}

impl FastWorkspace {
    /// A first guess of the room for a scene, from that of the portable path.
    pub fn guess(device: &Device, guess: Capacity) -> Capacity {
        let most = |bytes: u64| device.facts().limits.storage_range / bytes;
        // Captured scenes at 1080p: a splat is in 1.2 rows of bins and in 2 bins.
        let visible = guess.visible.min(most(48));
        Capacity { visible, spans: visible / 2, instances: (2 * visible).max(1 << 15).min(most(8)), ..guess }
    }

    pub fn new(device: &Device, room: Capacity, splat_elements: usize) -> Result<Self> {
        Self::with(device, room, splat_elements, 1)
    }

    fn with(device: &Device, room: Capacity, splat_elements: usize, mergers: u32) -> Result<Self> {
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
            merged: Buffer::new(device, "merged entries", if mergers > 1 { entries } else { 1 })?,
            mergers,
            splat_ids: words("splat ids", entries)?,
            masks: words("masks", stretches * BIN_STRETCH)?,
            splat_elements,
        })
    }

    /// Makes room for `demand` and a little more, and for a list as long as the longest, if there is not enough.
    pub fn grow(&mut self, device: &Device, demand: Capacity, longest_list: u32) -> Result<()> {
        let mergers = self.mergers.max(mergers(longest_list));
        if demand.fits(self.room) && mergers == self.mergers {
            return Ok(());
        }
        let elements = self.splat_elements;
        let rooms = demand.rooms_beyond(self.room);
        *self = Self::new(device, Capacity::default(), elements)?; // frees what is there before the larger are made
        *self = first_that_fits(rooms, |room| Self::with(device, room, elements, mergers))?;
        Ok(())
    }

    /// For every time that lists are merged: entries of the pieces that are sorted before, and these pieces' buffer, then the
    /// next ones'.
    pub fn mergers(&self) -> impl Iterator<Item = (u32, [&Buffer<[u32; 2]>; 2])> {
        let buffers = [[&self.entries, &self.merged], [&self.merged, &self.entries]];
        (0..self.mergers).map(move |i| ((BIN_RUN * BIN_PIECES.pow(i)) as u32, buffers[i as usize % 2]))
    }

    /// Whether there may be bins whose blocks several subgroups blend: those that are merged more than once.
    pub fn has_long_lists(&self) -> bool {
        self.mergers > 1
    }

    /// The longest list of a bin that is merged.
    pub fn longest_list(&self) -> u32 {
        u32::try_from(BIN_RUN * BIN_PIECES.pow(self.mergers) - 1).unwrap_or(u32::MAX)
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
            self.merged.footprint(),
        ]);
        all
    }
}

/// Times that a list is merged until it is sorted; once if it is short.
fn mergers(longest_list: u32) -> u32 {
    let is_enough = |times: &u32| BIN_RUN * BIN_PIECES.pow(*times) > longest_list as usize;
    (1..).find(is_enough).expect("powers grow")
}
