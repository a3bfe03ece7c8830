//! Every intermediate buffer of a frame of the fast path.

use anyhow::Result;

use crate::gpu::{Buffer, Commands, Device};
use crate::host_memory::OutOfMemory;
use crate::render::capacity::{Capacity, length};
use crate::render::fast::BinGrid;
use crate::render::shaders::fast::{
    BIN_CHUNK, BIN_CHUNKS, BIN_RUN, BIN_SEGMENT, BLOCKS, MANY_SPLATS, MAX_BIN_CHUNKS, MERGE_RUNS,
};
use crate::render::shaders::{Bin, FastCounters, FastDispatches, Totals};

/// The buffers of one frame of the fast path, whose cells are bins.
pub struct FastWorkspace {
    pub capacity: Capacity,
    pub totals: Buffer<Totals>,
    /// 0 between frames, like `listed_in_bins`: each frame resets them.
    pub counters: Buffer<FastCounters>,
    pub dispatches: Buffer<FastDispatches>,
    pub gaussian_from_splat: Buffer<u32>,
    /// [`FastPipeline::splat_elements`](super::FastPipeline::splat_elements) elements each.
    pub splats: Buffer<[u32; 4]>,
    pub depth_keys: Buffer<u32>,
    /// For every block: the depth key at which its last pixel stopped, if levels depend on it.
    pub stop_keys: Buffer<u32>,
    pub span_ranges: Buffer<[u32; 2]>,
    pub spans: Buffer<u32>,
    pub listed_in_bins: Buffer<u32>,
    /// For every chunk of splats and every bin: the begin of the chunk list in `unsorted`; and the end of the last list
    /// of every chunk.
    pub list_starts: Buffer<u32>,
    pub bins: Buffer<Bin>,
    pub bin_order: Buffer<u32>,
    pub run_bins: Buffer<u32>,
    pub segment_bins: Buffer<u32>,
    /// The splat of every entry, as chunks list them.
    pub unsorted: Buffer<u32>,
    /// Depth key and splat of every entry of the lists that are merged, list by list.
    pub entries: Buffer<[u32; 2]>,
    /// The entries between merges of pairs.
    pub merged: Buffer<[u32; 2]>,
    /// The number of times that inputs of lists are merged in pairs. If 0, all runs of a list are merged at once.
    pair_merges: u32,
    /// There was too little memory for merges in pairs.
    has_no_room_for_pairs: bool,
    pub splat_ids: Buffer<u32>,
    /// A bit per entry and block of its bin: 32 words for every segment and block. It shares the memory of `unsorted`,
    /// which no stage reads after sort.
    pub masks: Buffer<u32>,
    splat_elements: usize,
}

impl FastWorkspace {
    /// A first guess for a scene, from the guess for the portable path.
    pub fn guess(device: &Device, guess: Capacity) -> Capacity {
        let most = |bytes: u64| device.capabilities().limits.storage_range / bytes;
        // Captured scenes at 1080p: a splat is in 1.2 rows of bins and in 2 bins.
        let visible = guess.visible.min(most(48));
        Capacity { visible, spans: visible / 2, listed: (2 * visible).max(1 << 15).min(most(8)), ..guess }
    }

    /// Makes buffers of this capacity, for short lists.
    ///
    /// # Errors
    /// If device memory runs out.
    pub fn new(device: &Device, capacity: Capacity, splat_elements: usize) -> Result<Self> {
        Self::with(device, capacity, splat_elements, 0)
    }

    fn with(device: &Device, capacity: Capacity, splat_elements: usize, pair_merges: u32) -> Result<Self> {
        let visible = length("visible splats", capacity.visible)?;
        let spans = length("rows of bins", capacity.spans)?;
        let entries = length("entries of bins", capacity.listed)?;
        let segments = entries / BIN_SEGMENT as usize + capacity.cells;
        let words = |name: &str, len: usize| Buffer::<u32>::new(device, name, len);
        // Masks take whole segments, so that there are at least as many words as entries.
        let unsorted = words("unsorted splats or masks", segments * BIN_SEGMENT as usize)?;
        // In each bin and past the last, for as many chunks as there may be with these or with fewer bins.
        let starts = |chunks: u32| chunks as usize * (capacity.cells + 1);
        let many = if visible < MANY_SPLATS as usize { 0 } else { (visible + 1).min(starts(MAX_BIN_CHUNKS)) };
        let list_starts = starts(BIN_CHUNKS).max(many + MAX_BIN_CHUNKS as usize);
        let work = Self {
            capacity,
            totals: Buffer::new(device, "totals", 1)?,
            counters: Buffer::new(device, "counters", 1)?,
            dispatches: Buffer::new(device, "dispatches", 1)?,
            gaussian_from_splat: words("gaussian from splat", visible)?,
            splats: Buffer::new(device, "splats", visible * splat_elements)?,
            depth_keys: words("depth keys", visible)?,
            stop_keys: words("stop keys", BLOCKS as usize * capacity.cells)?,
            span_ranges: Buffer::new(device, "span ranges", visible)?,
            spans: words("spans", spans)?,
            listed_in_bins: words("listed in bins", capacity.cells)?,
            list_starts: words("chunk list starts", list_starts)?,
            bins: Buffer::new(device, "bins", capacity.cells)?,
            bin_order: words("bin order", capacity.cells)?,
            run_bins: words("run bins", entries / BIN_RUN as usize + capacity.cells)?,
            segment_bins: words("segment bins", segments)?,
            masks: unsorted.words(),
            unsorted,
            entries: Buffer::new(device, "entries", entries)?,
            merged: Buffer::new(device, "merged entries", if pair_merges > 0 { entries } else { 1 })?,
            pair_merges,
            has_no_room_for_pairs: false,
            splat_ids: words("splat ids", entries)?,
            splat_elements,
        };
        if capacity.cells > 0 {
            let mut cmd = Commands::new(device)?;
            cmd.fill(&work.totals, 0);
            cmd.fill(&work.counters, 0);
            cmd.fill(&work.listed_in_bins, 0);
            drop(cmd.submit()?);
        }
        Ok(work)
    }

    /// Makes the buffers large enough for `demand`, and the merges enough for a list of length `longest_list`.
    ///
    /// # Errors
    /// If device memory runs out. The buffers are then empty.
    pub fn grow(&mut self, device: &Device, demand: Capacity, longest_list: u32) -> Result<()> {
        let (current, elements, no_room) = (self.capacity, self.splat_elements, self.has_no_room_for_pairs);
        let can_merge_at_once = longest_list.div_ceil(BIN_RUN) <= MERGE_RUNS;
        let merges = match no_room && can_merge_at_once {
            true => self.pair_merges,
            false => self.pair_merges.max(pair_merges(longest_list, demand.listed)),
        };
        if demand.fits(current) && merges == self.pair_merges {
            return Ok(());
        }
        *self = Self::new(device, Capacity::default(), elements)?; // frees the old buffers before larger ones are made
        let make = |merges| demand.grow(current, |capacity| Self::with(device, capacity, elements, merges));
        *self = match make(merges) {
            Err(error) if error.is::<OutOfMemory>() && merges > 0 && can_merge_at_once => {
                Self { has_no_room_for_pairs: true, ..make(0)? }
            }
            made => Self { has_no_room_for_pairs: no_room, ..made? },
        };
        Ok(())
    }

    /// The number of splats that fit.
    pub fn visible_capacity(&self) -> u32 {
        self.gaussian_from_splat.len() as u32
    }

    /// The most chunks in which the splats that fit are listed.
    pub fn bin_chunks(&self, grid: BinGrid) -> u32 {
        bin_chunks(self.visible_capacity(), grid)
    }

    /// The number of entries that fit.
    pub fn entry_capacity(&self) -> u32 {
        self.entries.len() as u32
    }

    /// One item per merge of pairs: length of its sorted inputs, input buffer, output buffer. Empty if all runs of a
    /// list are merged at once.
    pub fn pair_merges(&self) -> impl Iterator<Item = (u32, [&Buffer<[u32; 2]>; 2])> {
        let buffers = [[&self.entries, &self.merged], [&self.merged, &self.entries]];
        (0..self.pair_merges).map(move |merge| (BIN_RUN << merge, buffers[merge as usize % 2]))
    }

    /// The longest list of a bin that the merges sort.
    pub fn longest_list(&self) -> u32 {
        let runs = if self.pair_merges == 0 { MERGE_RUNS.into() } else { 1 << self.pair_merges };
        u32::try_from(u64::from(BIN_RUN) * runs).unwrap_or(u32::MAX)
    }

    /// The name and the bytes of every buffer.
    pub fn buffers(&self) -> Vec<(&str, u64)> {
        let words = [
            &self.gaussian_from_splat,
            &self.depth_keys,
            &self.stop_keys,
            &self.spans,
            &self.listed_in_bins,
            &self.list_starts,
            &self.bin_order,
            &self.run_bins,
            &self.segment_bins,
            &self.splat_ids,
            &self.unsorted,
        ];
        let mut all: Vec<_> = words.into_iter().map(Buffer::footprint).collect();
        all.extend([
            self.totals.footprint(),
            self.counters.footprint(),
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

/// Frames with at least as many entries merge runs in pairs. One merge of all runs takes fewer dispatches, but its work
/// grows with the square of their number.
const PAIRS_FROM: u64 = 4_000_000;

/// The number of chunks of so many splats: the rule of `glsl/fast/frame.glsl`.
pub fn bin_chunks(splats: u32, grid: BinGrid) -> u32 {
    match splats < MANY_SPLATS {
        true => splats.div_ceil(BIN_CHUNK).clamp(1, BIN_CHUNKS),
        false => (splats / grid.count()).clamp(BIN_CHUNKS, MAX_BIN_CHUNKS),
    }
}

/// How often inputs are merged in pairs in a frame with `listed` entries, of which a list has at most `longest_list`; 0
/// if all runs of a list are merged at once.
fn pair_merges(longest_list: u32, listed: u64) -> u32 {
    let runs = longest_list.div_ceil(BIN_RUN).max(1);
    let at_once = runs <= MERGE_RUNS && listed < PAIRS_FROM;
    if at_once { 0 } else { runs.next_power_of_two().ilog2().max(1) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::{DeviceChoice, Validation};

    #[test]
    fn where_merges_in_pairs_have_no_room_all_runs_are_merged_at_once() {
        let open =
            || Device::open(&DeviceChoice::Best, Validation::IfInstalled).expect("GPU tests need a Vulkan device");
        let device = open().with_small_limit(90 << 20).unwrap();
        let mut work = FastWorkspace::new(&device, Capacity::default(), 2).unwrap();
        let demand = |listed| Capacity { gaussians: 1000, visible: 1000, spans: 1000, listed, cells: 10 };
        work.grow(&device, demand(1_000_000), 20_000).unwrap();
        assert_eq!(work.pair_merges().count(), 0, "few entries");
        work.grow(&device, demand(4_000_000), 20_000).unwrap();
        assert_eq!(work.pair_merges().count(), 0, "24 bytes for each of 4 million entries are too many");
        let entries = work.entries.clone();
        work.grow(&device, demand(4_000_000), 20_000).unwrap();
        assert!(std::ptr::eq(entries.name(), work.entries.name()), "the next frame makes no new buffers");
        let error = work.grow(&device, demand(4_000_000), 140_000).unwrap_err();
        assert!(error.is::<OutOfMemory>(), "a list of 69 runs is merged in pairs: {error:#}");

        let device = open();
        let mut work = FastWorkspace::new(&device, Capacity::default(), 2).unwrap();
        for (longest_list, merges) in [(1, 1), (2049, 1), (4096, 1), (4097, 2), (20_000, 4), (40_000, 5)] {
            work.grow(&device, demand(4_000_000), longest_list).unwrap();
            assert_eq!(work.pair_merges().count(), merges, "{longest_list}");
            assert_eq!(work.longest_list(), BIN_RUN << merges);
        }
    }
}
