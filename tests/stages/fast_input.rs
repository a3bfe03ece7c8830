//! What the tests of the fast path's stages share: its pipeline and buffers, and made-up input of a frame.

use crate::common::{Gpu, Random};
use smalto::gpu::{Access, Commands};
use smalto::options::Options;
use smalto::procedural::cactus;
use smalto::reference;
use smalto::render::shaders::fast::BIN_CHUNKS;
use smalto::render::shaders::{Bin, FastCounters};
use smalto::render::{BinGrid, Capacity, FastPipeline, FastWorkspace, GpuScene};

/// The stages with their buffers, and made-up input of a frame.
pub struct Bench {
    pub gpu: Gpu,
    pub pipeline: FastPipeline,
    pub work: FastWorkspace,
    pub grid: BinGrid,
}

/// Splats, each with the bins that it touches.
pub struct Input {
    pub span_ranges: Vec<[u32; 2]>,
    pub spans: Vec<u32>,
    pub depth_keys: Vec<u32>,
    pub gaussian_from_splat: Vec<u32>,
}

impl Input {
    /// One splat for each of these (row, first column, end column), in one row each; keys by `key`.
    pub fn of_spans(spans: impl Iterator<Item = (u32, u32, u32)>, key: impl Fn(u32) -> u32) -> Self {
        let span_ranges: Vec<_> = spans.map(|(row, begin, end)| [begin | end << 16, row | 1 << 16]).collect();
        Self::with(span_ranges, Vec::new(), key)
    }

    pub fn with(span_ranges: Vec<[u32; 2]>, spans: Vec<u32>, key: impl Fn(u32) -> u32) -> Self {
        let count = span_ranges.len() as u32;
        // Another order than that of the splats, so that ties are broken by the Gaussian and not by the splat.
        let mut gaussian_from_splat: Vec<u32> = (0..count).collect();
        let mut random = Random(count.into());
        (1..count).for_each(|i| gaussian_from_splat.swap(i as usize, random.below(i + 1) as usize));
        Self { span_ranges, spans, depth_keys: (0..count).map(key).collect(), gaussian_from_splat }
    }

    /// Splats of one bin each: so many in every bin of a row, bin after bin.
    pub fn of_lengths(lengths: &[usize], key: impl Fn(u32) -> u32) -> Self {
        let bins = lengths.iter().enumerate().flat_map(|(bin, length)| std::iter::repeat_n(bin as u32, *length));
        Self::of_spans(bins.map(|bin| (0, bin, bin + 1)), key)
    }

    /// The same splats in another order.
    pub fn shuffled(mut self) -> Self {
        let mut random = Random(7);
        (1..self.span_ranges.len()).for_each(|i| self.span_ranges.swap(i, random.below(i as u32 + 1) as usize));
        self
    }

    pub fn counts(&self, grid: BinGrid) -> Vec<u32> {
        reference::count_bins(&self.span_ranges, &self.spans, grid.bins[0], grid.count() as usize)
    }

    pub fn lists(&self, grid: BinGrid) -> Vec<Vec<reference::Entry>> {
        let bins = grid.count() as usize;
        reference::list_bins(&self.span_ranges, &self.spans, &self.depth_keys, grid.bins[0], bins)
    }
}

impl Bench {
    /// With blocks of `BLOCK_FORMS[form]`, and the capacity for `input` and so many entries.
    pub fn new(size_px: [u32; 2], form: usize, input: &Input, entries: usize, longest_list: u32) -> Self {
        Self::with(&Options::EXACT, size_px, form, input, entries, longest_list)
    }

    /// The same for other options.
    pub fn with(
        options: &Options,
        size_px: [u32; 2],
        form: usize,
        input: &Input,
        entries: usize,
        longest_list: u32,
    ) -> Self {
        let gpu = Gpu::new();
        let scene = GpuScene::new(&gpu.0, &cactus(1).unwrap().gaussians, options).unwrap();
        let pipeline = FastPipeline::new(&gpu.0, options, scene.layout()).unwrap();
        let mut pipeline = pipeline.expect("the device has a fast path");
        pipeline.list_any_length();
        let grid = BinGrid::new(size_px, form);
        let count = input.span_ranges.len();
        let capacity = Capacity {
            gaussians: count,
            visible: count as u64,
            spans: input.spans.len() as u64,
            listed: entries as u64,
            cells: grid.count() as usize,
        };
        let elements = pipeline.splat_elements();
        let mut work = FastWorkspace::new(&gpu.0, capacity, elements).unwrap();
        work.grow(&gpu.0, capacity, longest_list).unwrap();
        pipeline.prepare(&gpu.0, grid).unwrap();
        let bench = Self { gpu, pipeline, work, grid };
        bench.run(|bench, cmd| {
            let counters = FastCounters { visible: count as u32, ..bytemuck::Zeroable::zeroed() };
            cmd.upload(&bench.work.counters, 0, 1, |memory| memory[0] = counters).unwrap();
            let work = &bench.work;
            cmd.upload(&work.span_ranges, 0, count, |m| m.copy_from_slice(&input.span_ranges)).unwrap();
            cmd.upload(&work.spans, 0, input.spans.len(), |m| m.copy_from_slice(&input.spans)).unwrap();
            cmd.upload(&work.depth_keys, 0, count, |m| m.copy_from_slice(&input.depth_keys)).unwrap();
            cmd.upload(&work.gaussian_from_splat, 0, count, |m| m.copy_from_slice(&input.gaussian_from_splat)).unwrap();
        });
        bench
    }

    /// Runs one stage after everything before it.
    pub fn run(&self, record: impl FnOnce(&Self, &mut Commands)) {
        self.gpu.run(|cmd| {
            record(self, cmd);
            cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        });
    }

    /// list and offsets.
    pub fn list(&self) {
        self.run(|b, cmd| b.pipeline.list(cmd, &b.work, b.grid));
        self.run(|b, cmd| b.pipeline.offsets(cmd, &b.work, b.grid));
    }

    /// For every chunk, the begin of its list in each bin; then the end of the last of these lists.
    pub fn list_starts(&self) -> Vec<Vec<usize>> {
        let (starts, bins) = (self.gpu.download(&self.work.list_starts), self.grid.count() as usize);
        let chunks = self.work.bin_chunks(self.grid) as usize;
        // The layout of `start_place` in glsl/fast/frame.glsl.
        let place =
            |chunk, bin| if chunks <= BIN_CHUNKS as usize { chunk * (bins + 1) + bin } else { bin * chunks + chunk };
        (0..chunks).map(|chunk| (0..=bins).map(|bin| starts[place(chunk, bin)] as usize).collect()).collect()
    }

    /// The lists of all bins before they are sorted: their chunk lists, one after another.
    pub fn lists(&self) -> Vec<Vec<reference::Entry>> {
        let (unsorted, starts) = (self.gpu.download(&self.work.unsorted), self.list_starts());
        let keys = self.gpu.download(&self.work.depth_keys);
        let chunk_list = |row: &Vec<usize>, bin: usize| unsorted[row[bin]..row[bin + 1]].to_vec();
        let list =
            |bin| starts.iter().flat_map(move |row| chunk_list(row, bin)).map(|splat| [keys[splat as usize], splat]);
        (0..self.grid.count() as usize).map(|bin| list(bin).collect()).collect()
    }

    pub fn bins(&self) -> Vec<reference::BinRange> {
        let range = |bin: Bin| reference::BinRange {
            first: bin.first,
            count: bin.count,
            first_run: bin.first_run,
            first_segment: bin.first_segment,
        };
        self.gpu.download(&self.work.bins).into_iter().map(range).collect()
    }
}

/// The parts of `all` that the bins take.
pub fn parts<'a, T>(all: &'a [T], bins: &'a [reference::BinRange]) -> impl Iterator<Item = &'a [T]> {
    bins.iter().map(|bin| &all[bin.first as usize..][..bin.count as usize])
}
