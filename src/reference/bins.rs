//! The lists of the fast path: the bins that splats touch, the order of their lists, the blocks that splats reach.
//!
//! Numbers lie as the shaders of `glsl/fast/` have them. An entry is one splat in the list of one bin: depth key,
//! splat. The shader of `list` leaves the key to `sort`, which finds it by the splat.

use glam::DVec2;

use super::Splat;
use super::duplicate::least_distance;
use crate::rules::Rules;

/// An entry of a list: depth key, splat.
pub type Entry = [u32; 2];

/// Where the list of one bin lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BinRange {
    pub first: u32,
    pub count: u32,
    pub first_run: u32,
    pub first_segment: u32,
}

/// What [`bin_offsets`] makes of the counts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BinOffsets {
    pub bins: Vec<BinRange>,
    /// The bin of every run.
    pub run_bins: Vec<u32>,
    /// The bin of every segment.
    pub segment_bins: Vec<u32>,
    /// Entries of all bins.
    pub demand: u64,
}

/// The bins that a splat touches, row by row. A range holds `row | rows << 16` in its second word; in its first the
/// place of the splat's spans, or its only span. A span is `begin | end << 16`, in columns of bins.
pub fn bins_of([place, rows]: [u32; 2], spans: &[u32], bins_x: u32) -> Vec<u32> {
    let (first_row, rows) = (rows & 0xffff, rows >> 16);
    let row_bins = |row: u32| {
        let span = if rows == 1 { place } else { spans[(place + row) as usize] };
        (span & 0xffff..span >> 16).map(move |column| (first_row + row) * bins_x + column)
    };
    (0..rows).flat_map(row_bins).collect()
}

/// The number of splats that each bin lists.
pub fn count_bins(span_ranges: &[[u32; 2]], spans: &[u32], bins_x: u32, bins: usize) -> Vec<u32> {
    let mut counts = vec![0; bins];
    span_ranges.iter().flat_map(|range| bins_of(*range, spans, bins_x)).for_each(|bin| counts[bin as usize] += 1);
    counts
}

/// The position of every bin's list among `capacity` entries, in runs of `run` and segments of `segment` entries.
/// Nothing is listed if the capacity is not enough or a list is longer than `longest`.
pub fn bin_offsets(counts: &[u32], capacity: u32, longest: u32, run: u32, segment: u32) -> BinOffsets {
    let demand = counts.iter().map(|count| u64::from(*count)).sum();
    let fits = demand <= u64::from(capacity) && counts.iter().all(|count| *count <= longest);
    let (mut run_bins, mut segment_bins, mut first) = (Vec::new(), Vec::new(), 0_u32);
    let place = |(bin, listed): (usize, &u32)| {
        let count = if fits { *listed } else { 0 };
        let range =
            BinRange { first, count, first_run: run_bins.len() as u32, first_segment: segment_bins.len() as u32 };
        run_bins.extend(std::iter::repeat_n(bin as u32, count.div_ceil(run) as usize));
        segment_bins.extend(std::iter::repeat_n(bin as u32, count.div_ceil(segment) as usize));
        first += count;
        range
    };
    let bins = counts.iter().enumerate().map(place).collect();
    BinOffsets { bins, run_bins, segment_bins, demand }
}

/// The entries of every bin, in the order of the splats.
pub fn list_bins(
    span_ranges: &[[u32; 2]],
    spans: &[u32],
    depth_keys: &[u32],
    bins_x: u32,
    bins: usize,
) -> Vec<Vec<Entry>> {
    let mut lists = vec![Vec::new(); bins];
    for (splat, range) in span_ranges.iter().enumerate() {
        for bin in bins_of(*range, spans, bins_x) {
            lists[bin as usize].push([depth_keys[splat], splat as u32]);
        }
    }
    lists
}

/// The order of entries: by depth key, then by Gaussian.
fn rank([key, splat]: Entry, gaussian_from_splat: &[u32]) -> (u32, u32) {
    (key, gaussian_from_splat[splat as usize])
}

/// Sorts one run.
pub fn sort_run(run: &mut [Entry], gaussian_from_splat: &[u32]) {
    run.sort_by_key(|entry| rank(*entry, gaussian_from_splat));
}

/// Merges sorted inputs of `length` entries into sorted outputs of `inputs` times as many.
pub fn merge_inputs(list: &[Entry], length: usize, inputs: usize, gaussian_from_splat: &[u32]) -> Vec<Entry> {
    let merge = |group: &[Entry]| {
        let mut heads: Vec<&[Entry]> = group.chunks(length).collect();
        let next = |heads: &mut Vec<&[Entry]>| {
            let least = heads.iter_mut().filter(|head| !head.is_empty());
            let least = least.min_by_key(|head| rank(head[0], gaussian_from_splat))?;
            let (entry, rest) = least.split_first()?;
            *least = rest;
            Some(*entry)
        };
        std::iter::from_fn(|| next(&mut heads)).collect::<Vec<_>>()
    };
    list.chunks(length * inputs).flat_map(merge).collect()
}

/// The blocks of one bin, from `corner_px` on, row by row.
#[derive(Clone, Copy, Debug)]
pub struct BinBlocks {
    pub corner_px: [u32; 2],
    /// Columns and rows of blocks.
    pub counts: [u32; 2],
    pub block_px: [u32; 2],
}

/// The blocks of a bin that a splat reaches, a bit each: in whose box of pixel centres its alpha reaches the threshold
/// of `rules`. The box is widened by `slack_px`, the threshold lowered by the factor exp(-`slack`).
pub fn block_mask(splat: &Splat, blocks: BinBlocks, rules: &Rules, slack: f64, slack_px: f64) -> u32 {
    let level = splat.level(rules) + 2.0 * slack;
    let size = DVec2::from(blocks.block_px.map(f64::from));
    let reaches = |block: &u32| {
        let place = [block % blocks.counts[0], block / blocks.counts[0]];
        let corner: [u32; 2] = std::array::from_fn(|axis| blocks.corner_px[axis] + place[axis] * blocks.block_px[axis]);
        let corner = DVec2::from(corner.map(f64::from));
        level >= 0.0 && least_distance(splat, corner + 0.5 - slack_px, corner + size - 0.5 + slack_px) <= level
    };
    (0..blocks.counts[0] * blocks.counts[1]).filter(reaches).map(|block| 1 << block).sum()
}
