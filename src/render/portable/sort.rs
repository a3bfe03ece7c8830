//! A stable radix sort of 32-bit keys with 32-bit values on the GPU: reduce-then-scan, one pass per digit.

use anyhow::Result;

use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Element, Shader, Stage};
use crate::render::shaders::portable::{
    SORT_CHUNK, SortHistogram, SortHistogramBindings, SortHistogramConstants, SortHistogramPush, SortOffsets,
    SortOffsetsBindings, SortOffsetsConstants, SortOffsetsPush, SortScatter, SortScatterBindings, SortScatterConstants,
    SortScatterPush,
};

/// Keys and values, twice: a pass reads one pair and writes the other.
pub struct Pairs {
    pub keys: [Buffer<u32>; 2],
    pub values: [Buffer<u32>; 2],
}

impl Pairs {
    pub fn new(device: &Device, name: &str, capacity: usize) -> Result<Self> {
        let buffer = |what: &str| Buffer::new(device, &format!("{name} {what}"), capacity);
        Ok(Self { keys: [buffer("keys")?, buffer("keys 2")?], values: [buffer("values")?, buffer("values 2")?] })
    }

    pub fn buffers(&self) -> [&Buffer<u32>; 4] {
        let ([a, b], [c, d]) = (&self.keys, &self.values);
        [a, b, c, d]
    }
}

/// The counts of a pass.
pub struct SortScratch {
    sums: Buffer<u32>,
    digit_totals: Buffer<u32>,
}

impl SortScratch {
    /// Makes the buffers of sorts of up to `capacity` keys.
    pub fn new(device: &Device, capacity: usize) -> Result<Self> {
        let sums = Buffer::new(device, "sort sums", capacity.div_ceil(SORT_CHUNK as usize) << MAX_DIGIT_BITS)?;
        Ok(Self { sums, digit_totals: Buffer::new(device, "digit totals", 1 << MAX_DIGIT_BITS)? })
    }

    pub fn buffers(&self) -> [&Buffer<u32>; 2] {
        [&self.sums, &self.digit_totals]
    }
}

const MAX_DIGIT_BITS: u32 = 8; // one lane of the workgroup serves one digit

/// The pipelines of the sort.
pub struct RadixSort {
    histogram: Stage<SortHistogram>,
    offsets: Stage<SortOffsets>,
    scatter: Stage<SortScatter>,
    digit_bits: u32,
}

/// The keys to sort: the first `lengths[length_index]`, by their lowest `bits` bits.
#[derive(Clone, Copy)]
pub struct SortRange<'a> {
    pub lengths: &'a Buffer<u32>,
    pub length_index: usize,
    pub bits: u32,
    /// True if the value of every key is its index. `values[0]` is then not read.
    pub values_are_indices: bool,
}

impl RadixSort {
    /// `smallest_subgroup` is the smallest subgroup size that the pipelines may run with, `ballot_words` the number of
    /// words in a ballot of the largest.
    ///
    /// # Errors
    /// If a pipeline cannot be made.
    pub fn new(device: &Device, smallest_subgroup: u32, ballot_words: u32) -> Result<Self> {
        let digit_bits = digit_bits(SortScatter::WORKGROUP[0] / smallest_subgroup, 16 << 10);
        let subgroups = SortScatter::WORKGROUP[0] / smallest_subgroup;
        Ok(Self {
            histogram: Stage::new(device, &SortHistogramConstants { digit_bits })?,
            offsets: Stage::new(device, &SortOffsetsConstants { digit_bits })?,
            scatter: Stage::new(device, &SortScatterConstants { digit_bits, subgroups, ballot_words })?,
            digit_bits,
        })
    }

    /// Passes over the keys that a sort by this many bits takes.
    pub fn passes(&self, bits: u32) -> u32 {
        bits.div_ceil(self.digit_bits)
    }

    /// The index of the pair that holds the result of a sort by this many bits.
    pub fn sorted(&self, bits: u32) -> usize {
        self.passes(bits) as usize % 2
    }

    /// Records a sort. Returns the index of the pair that holds the result. `groups` is a buffer and the byte in it
    /// where the workgroup counts of a dispatch over chunks of 2048 keys are. A barrier must come before; the sort ends
    /// with one.
    pub fn record<T: Element>(
        &self,
        cmd: &mut Commands,
        pairs: &Pairs,
        scratch: &SortScratch,
        range: SortRange,
        groups: (&Buffer<T>, usize),
    ) -> usize {
        let passes = self.passes(range.bits);
        // Digits of equal width: 13 bits are 7 + 6, not 8 + 5, and need fewer counts.
        let width = range.bits.div_ceil(passes.max(1));
        let length_index = range.length_index as u32;
        for pass in 0..passes {
            let (shift, from, to) = (pass * width, pass as usize % 2, 1 - pass as usize % 2);
            let bits = width.min(range.bits - shift);
            let histogram =
                SortHistogramBindings { lengths: range.lengths, keys: &pairs.keys[from], sums: &scratch.sums };
            let push = SortHistogramPush { length_index, shift, bits };
            cmd.dispatch_indirect(&self.histogram, histogram, push, groups.0, groups.1);
            cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
            let offsets = SortOffsetsBindings {
                lengths: range.lengths,
                sums: &scratch.sums,
                digit_totals: &scratch.digit_totals,
            };
            let digits = DispatchSize::Groups(1 << self.digit_bits);
            cmd.dispatch(&self.offsets, offsets, SortOffsetsPush { length_index }, digits);
            cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
            let scatter = SortScatterBindings {
                lengths: range.lengths,
                keys_in: &pairs.keys[from],
                values_in: &pairs.values[from],
                sums: &scratch.sums,
                digit_totals: &scratch.digit_totals,
                keys_out: &pairs.keys[to],
                values_out: &pairs.values[to],
            };
            let values_are_indices = u32::from(range.values_are_indices && pass == 0);
            let push = SortScatterPush { length_index, shift, bits, values_are_indices };
            cmd.dispatch_indirect(&self.scatter, scatter, push, groups.0, groups.1);
            cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        }
        self.sorted(range.bits)
    }
}

/// Bits of the widest digit whose counts, one per subgroup and digit, fit into `bytes` of workgroup memory.
pub(in crate::render) fn digit_bits(subgroups: u32, bytes: u32) -> u32 {
    (bytes / 4 / subgroups).ilog2().min(MAX_DIGIT_BITS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_narrow_with_the_subgroup() {
        assert_eq!([64, 32, 16, 8, 4, 2].map(|subgroups| digit_bits(subgroups, 16 << 10)), [6, 7, 8, 8, 8, 8]);
    }
}
