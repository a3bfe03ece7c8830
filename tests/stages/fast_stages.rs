//! Each stage of the fast path against its twin on the CPU, over the sizes where indices go wrong.

use crate::common::{Gpu, Random};
use glam::{DMat2, DVec2, DVec3, dvec2};
use smalto::gpu::{Access, Commands, Image};
use smalto::options::Options;
use smalto::reference::{self, BinBlocks, Lists, Tiling};
use smalto::render::shaders::fast::{
    BIN_CHUNKS, BIN_COLUMNS, BIN_PIECES, BIN_ROWS, BIN_RUN, BIN_STRETCH, BLOCK_WIDTH, BLOCKS, LONG_LIST,
};
use smalto::render::shaders::{Bin, Totals};
use smalto::render::{BLOCK_HEIGHTS, BinGrid, Capacity, FastPipeline, FastWorkspace, GpuScene, Target};
use smalto::rules::{ALPHA_MIN, Background, Rules, TILE};
use smalto::scene::synthetic;

const RULES: &Rules = &Rules::TRAINED;

/// A picture of 3 x 2 bins of the middle height.
const GRID_SIZE: [u32; 2] = [3 * 64, 2 * 32];

/// The stages with their buffers, and made-up input of a frame.
struct Bench {
    gpu: Gpu,
    pipeline: FastPipeline,
    work: FastWorkspace,
    grid: BinGrid,
}

/// Splats, each with the bins that it touches.
struct Input {
    span_ranges: Vec<[u32; 2]>,
    spans: Vec<u32>,
    depth_keys: Vec<u32>,
    gaussian_from_splat: Vec<u32>,
}

impl Input {
    /// One splat for each of these (row, first column, end column), in one row each; keys by `key`.
    fn of_spans(spans: impl Iterator<Item = (u32, u32, u32)>, key: impl Fn(u32) -> u32) -> Self {
        let span_ranges: Vec<_> = spans.map(|(row, begin, end)| [begin | end << 16, row | 1 << 16]).collect();
        Self::with(span_ranges, Vec::new(), key)
    }

    fn with(span_ranges: Vec<[u32; 2]>, spans: Vec<u32>, key: impl Fn(u32) -> u32) -> Self {
        let count = span_ranges.len() as u32;
        // Another order than that of the splats, so that ties are broken by the Gaussian and not by the splat.
        let mut gaussian_from_splat: Vec<u32> = (0..count).collect();
        let mut random = Random(count.into());
        (1..count).for_each(|i| gaussian_from_splat.swap(i as usize, random.below(i + 1) as usize));
        Self { span_ranges, spans, depth_keys: (0..count).map(key).collect(), gaussian_from_splat }
    }

    /// Splats of one bin each: so many in every bin of a row.
    fn of_lengths(lengths: &[usize], key: impl Fn(u32) -> u32) -> Self {
        let bins = lengths.iter().enumerate().flat_map(|(bin, length)| std::iter::repeat_n(bin as u32, *length));
        Self::of_spans(bins.map(|bin| (0, bin, bin + 1)), key)
    }

    fn counts(&self, grid: BinGrid) -> Vec<u32> {
        reference::count_bins(&self.span_ranges, &self.spans, grid.bins[0], grid.count() as usize)
    }

    fn lists(&self, grid: BinGrid) -> Vec<Vec<reference::Entry>> {
        let bins = grid.count() as usize;
        reference::fill_bins(&self.span_ranges, &self.spans, &self.depth_keys, grid.bins[0], bins)
    }
}

impl Bench {
    /// With the capacity for `input` and so many entries.
    fn new(size_px: [u32; 2], height: usize, input: &Input, entries: usize, longest_list: u32) -> Self {
        let gpu = Gpu::new();
        let scene = GpuScene::new(&gpu.0, &synthetic::cactus(1).unwrap().gaussians, &Options::EXACT).unwrap();
        let pipeline = FastPipeline::new(&gpu.0, &Options::EXACT, scene.layout()).unwrap();
        let mut pipeline = pipeline.expect("the device has a fast path");
        let grid = BinGrid::new(size_px, height);
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
        pipeline.prepare(&gpu.0, grid, work.has_long_lists()).unwrap();
        let bench = Self { gpu, pipeline, work, grid };
        bench.run(|bench, cmd| {
            let totals = Totals { visible: count as u32, ..bytemuck::Zeroable::zeroed() };
            cmd.upload(&bench.work.totals, 0, 1, |memory| memory[0] = totals).unwrap();
            cmd.fill(&bench.work.listed_in_bins, 0);
            let work = &bench.work;
            cmd.upload(&work.span_ranges, 0, count, |m| m.copy_from_slice(&input.span_ranges)).unwrap();
            cmd.upload(&work.spans, 0, input.spans.len(), |m| m.copy_from_slice(&input.spans)).unwrap();
            cmd.upload(&work.depth_keys, 0, count, |m| m.copy_from_slice(&input.depth_keys)).unwrap();
            cmd.upload(&work.gaussian_from_splat, 0, count, |m| m.copy_from_slice(&input.gaussian_from_splat)).unwrap();
        });
        bench
    }

    /// Runs one stage after everything before it.
    fn run(&self, record: impl FnOnce(&Self, &mut Commands)) {
        self.gpu.run(|cmd| {
            record(self, cmd);
            cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        });
    }

    /// count, offsets and fill.
    fn list(&self) {
        self.run(|b, cmd| b.pipeline.count(cmd, &b.work, b.grid));
        self.run(|b, cmd| b.pipeline.offsets(cmd, &b.work, b.grid));
        self.run(|b, cmd| b.pipeline.fill(cmd, &b.work, b.grid));
    }

    fn bins(&self) -> Vec<reference::BinRange> {
        let range = |bin: Bin| reference::BinRange {
            first: bin.first,
            count: bin.count,
            first_run: bin.first_run,
            first_stretch: bin.first_stretch,
        };
        self.gpu.download(&self.work.bins).into_iter().map(range).collect()
    }
}

/// The parts of `all` that the bins take.
fn parts<'a, T>(all: &'a [T], bins: &'a [reference::BinRange]) -> impl Iterator<Item = &'a [T]> {
    bins.iter().map(|bin| &all[bin.first as usize..][..bin.count as usize])
}

/// Splats over 40 x 30 bins: small ones of one row, some of several rows, few that cover the picture.
fn scattered(count: usize) -> Input {
    let mut random = Random(count as u64);
    let (mut span_ranges, mut spans) = (Vec::new(), Vec::new());
    for i in 0..count {
        let rows = match i % 50 {
            0 => 30,
            n if n < 10 => 1 + random.below(4),
            _ => 1,
        };
        let first_row = random.below(31 - rows);
        let mut row_span = || {
            let begin = random.below(40);
            let width = if i % 50 == 0 { 40 - begin } else { 1 + random.below(5.min(40 - begin)) };
            begin | (begin + width) << 16
        };
        let place = if rows == 1 { row_span() } else { spans.len() as u32 };
        if rows > 1 {
            spans.extend((0..rows).map(|_| row_span()));
        }
        span_ranges.push([place, first_row | rows << 16]);
    }
    Input::with(span_ranges, spans, |i| i.wrapping_mul(0x9e37_79b9) >> 8)
}

/// Around a lane, a subgroup, a workgroup and the number of chunks.
const COUNTS: [usize; 13] = [0, 1, 7, 8, 31, 32, 33, 263, 264, 265, 1023, 8448, 20_001];

#[test]
fn count_offsets_and_fill_list_every_splat_in_its_bins() {
    for count in COUNTS {
        let input = scattered(count);
        let grid = BinGrid::new([40 * 64, 30 * 32], 1);
        let counts = input.counts(grid);
        let entries: u32 = counts.iter().sum();
        let bench = Bench::new([40 * 64, 30 * 32], 1, &input, entries as usize, 0);

        bench.run(|b, cmd| b.pipeline.count(cmd, &b.work, b.grid));
        assert_eq!(bench.gpu.download(&bench.work.listed_in_bins), counts, "{count} splats");
        // The places of a bin's chunks are disjoint and cover its list.
        let places = bench.gpu.download(&bench.work.chunk_places);
        assert_eq!(places.len(), BIN_CHUNKS as usize * counts.len());

        bench.run(|b, cmd| b.pipeline.offsets(cmd, &b.work, b.grid));
        let expected = reference::bin_offsets(&counts, entries, BIN_RUN, BIN_STRETCH);
        let bins = bench.bins();
        assert_eq!(bins, expected.bins, "{count} splats");
        let runs = bench.gpu.download(&bench.work.run_bins);
        assert_eq!(runs[..expected.run_bins.len()], expected.run_bins);
        let stretches = bench.gpu.download(&bench.work.stretch_bins);
        assert_eq!(stretches[..expected.stretch_bins.len()], expected.stretch_bins);
        let totals = bench.gpu.download(&bench.work.totals)[0];
        assert_eq!([totals.listed_high, totals.listed_low, totals.listed_kept], [0, entries, entries]);
        assert_eq!(totals.longest_list, counts.iter().copied().max().unwrap());

        bench.run(|b, cmd| b.pipeline.fill(cmd, &b.work, b.grid));
        let entries = bench.gpu.download(&bench.work.entries);
        for (list, expected) in parts(&entries, &bins).zip(input.lists(grid)) {
            let mut list = list.to_vec();
            list.sort_unstable_by_key(|[_, splat]| *splat);
            assert_eq!(list, expected, "{count} splats");
        }
    }
}

#[test]
fn offsets_order_bins_by_length_and_find_the_long_lists() {
    let lengths: Vec<u32> = (0..900).map(|i: u32| i.wrapping_mul(0x9e37_79b9) >> (12 + i % 20)).collect();
    let bench = Bench::new([30 * 64, 30 * 32], 1, &Input::of_lengths(&[], |_| 0), 0, 0);
    bench.run(|b, cmd| {
        cmd.upload(&b.work.listed_in_bins, 0, 900, |memory| memory.copy_from_slice(&lengths)).unwrap();
    });
    // Lists that do not fit are cut, and the demand is told: here nothing fits.
    bench.run(|b, cmd| b.pipeline.offsets(cmd, &b.work, b.grid));
    assert_eq!(bench.bins(), reference::bin_offsets(&lengths, 0, BIN_RUN, BIN_STRETCH).bins);
    let totals = bench.gpu.download(&bench.work.totals)[0];
    assert_eq!(totals.listed_low, lengths.iter().sum::<u32>());
    assert_eq!([totals.listed_kept, totals.longest_list], [0, 0]);

    // With the capacity for all.
    let demand: u32 = lengths.iter().sum();
    let mut bench = bench;
    let capacity = Capacity { listed: demand.into(), cells: 900, ..Capacity::default() };
    bench.work.grow(&bench.gpu.0, capacity, 0).unwrap();
    bench.run(|b, cmd| {
        cmd.fill(&b.work.totals, 0);
        cmd.upload(&b.work.listed_in_bins, 0, 900, |memory| memory.copy_from_slice(&lengths)).unwrap();
    });
    bench.run(|b, cmd| b.pipeline.offsets(cmd, &b.work, b.grid));
    let order = bench.gpu.download(&bench.work.bin_order);
    let mut bins = order.clone();
    bins.sort_unstable();
    assert!(bins.into_iter().eq(0..900), "every bin once");
    // Four classes for every power of two: within one, lengths differ by a quarter at most.
    let by_order: Vec<u32> = order.iter().map(|bin| lengths[*bin as usize]).collect();
    assert!(by_order.windows(2).all(|pair| f64::from(pair[1]) <= 1.25 * f64::from(pair[0].max(1))), "{by_order:?}");
    let long = lengths.iter().filter(|length| **length >= LONG_LIST).count();
    assert!(long > 0 && by_order[..long].iter().all(|length| *length >= LONG_LIST));
    let [x, y, _] = bench.gpu.download(&bench.work.dispatches)[0].over_long_blocks;
    assert!(x * y >= long as u32 * BLOCKS, "{x} x {y} workgroups for {long} long lists");
}

#[test]
fn offsets_refuse_more_entries_than_32_bits_count() {
    let bench = Bench::new(GRID_SIZE, 1, &Input::of_lengths(&[], |_| 0), 0, 0);
    let counts = [u32::MAX, 1, 0, 0, 0, 0];
    bench.run(|b, cmd| cmd.upload(&b.work.listed_in_bins, 0, 6, |memory| memory.copy_from_slice(&counts)).unwrap());
    bench.run(|b, cmd| b.pipeline.offsets(cmd, &b.work, b.grid));
    let totals = bench.gpu.download(&bench.work.totals)[0];
    assert!(totals.listed_high > 0, "the demand is told");
    assert_eq!(totals.listed_kept, 0);
    assert!(bench.bins().iter().all(|bin| bin.count == 0));
}

/// Around lanes, subgroups, runs, pieces.
const LENGTHS: [usize; 26] = [
    0, 1, 2, 7, 8, 9, 31, 32, 33, 511, 512, 513, 1023, 1024, 1025, 2047, 2048, 2049, 4095, 4096, 4097, 10_000, 32_767,
    32_768, 32_769, 70_000,
];

#[test]
fn sort_and_merge_order_lists_of_every_length() {
    let size = [LENGTHS.len() as u32 * 64, 32];
    let kinds: [(&str, fn(u32) -> u32); 6] = [
        ("random", |i| (u64::from(i).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33) as u32),
        ("close", |i| 0x3f80_0000 + (i.wrapping_mul(0x9e37_79b9) >> 22)),
        ("few", |i| i.wrapping_mul(0x9e37_79b9) >> 30),
        ("equal", |_| 0x7fff_ffff),
        ("ascending", |i| i),
        ("one far", |i| if i % 2000 == 1 { 0x7f00_0000 } else { i % 16 }),
    ];
    for (name, key) in kinds {
        let input = Input::of_lengths(&LENGTHS, key);
        let entries: usize = LENGTHS.iter().sum();
        let bench = Bench::new(size, 1, &input, entries, 70_000);
        bench.list();
        let bins = bench.bins();
        let listed = bench.gpu.download(&bench.work.entries);

        bench.run(|b, cmd| b.pipeline.sort(cmd, &b.work));
        let sorted = bench.gpu.download(&bench.work.entries);
        let ids = bench.gpu.download(&bench.work.splat_ids);
        let mut runs = Vec::new();
        for ((bin, list), now) in bins.iter().zip(parts(&listed, &bins)).zip(parts(&sorted, &bins)) {
            let mut expected = list.to_vec();
            expected.chunks_mut(BIN_RUN as usize).for_each(|run| reference::sort_run(run, &input.gaussian_from_splat));
            if bin.count <= BIN_RUN {
                let ids = &ids[bin.first as usize..][..bin.count as usize];
                assert!(expected.iter().map(|[_, splat]| splat).eq(ids), "{name}: a list of {}", bin.count);
            } else {
                assert!(now == expected, "{name}: runs of a list of {}", bin.count);
            }
            runs.push(expected);
        }

        bench.run(|b, cmd| b.pipeline.merge(cmd, &b.work));
        let ids = bench.gpu.download(&bench.work.splat_ids);
        for ((ids, runs), bin) in parts(&ids, &bins).zip(runs).zip(&bins) {
            let mut expected = runs;
            for level in 0..2 {
                let piece = (BIN_RUN * BIN_PIECES.pow(level)) as usize;
                expected =
                    reference::merge_pieces(&expected, piece, BIN_PIECES as usize, &input.gaussian_from_splat);
            }
            assert!(expected.iter().map(|[_, splat]| splat).eq(ids), "{name}: merged list of {}", bin.count);
        }
    }
}

/// A splat and its record in `work.splats`, three elements: the numbers of the record are exact in f64.
fn splat_of(mean: [f32; 2], factor: [f32; 3], opacity: f32, colour: [f32; 3]) -> (reference::Splat, [[u32; 4]; 3]) {
    let limit = (opacity / ALPHA_MIN).log2();
    let record = [
        [mean[0], mean[1], factor[0], factor[1]],
        [factor[2], limit, colour[0], colour[1]],
        [colour[2], 0.0, 0.0, 0.0],
    ];
    let [l0, l1, l2] = factor.map(f64::from);
    let to_e = 2.0 * std::f64::consts::LN_2;
    let conic = DMat2::from_cols_array(&[l0 * l0, l0 * l1, l0 * l1, l1 * l1 + l2 * l2].map(|v| v * to_e));
    let splat = reference::Splat {
        mean_px: DVec2::from(mean.map(f64::from)),
        covariance: conic.inverse(),
        conic,
        opacity: f64::from(ALPHA_MIN) * f64::from(limit).exp2(),
        colour: DVec3::from(colour.map(f64::from)),
        depth: 1.0,
        distance_world: 1.0,
    };
    (splat, record.map(|element| element.map(f32::to_bits)))
}

/// Splats in and around a picture: round ones, needles, huge ones.
fn splats(count: usize, size: [u32; 2], opacities: [f64; 2]) -> Vec<(reference::Splat, [[u32; 4]; 3])> {
    let mut random = Random(count as u64);
    let splat = |i: usize| {
        let mut unit = || random.between(0.0, 1.0);
        let mean = size.map(|side| ((1.4 * unit() - 0.2) * f64::from(side)) as f32);
        // Reciprocal half widths, px: down to the low-pass of sqrt(0.3) px.
        let width = |part: f64| (1.2 * (0.001 / 1.2_f64).powf(part)) as f32;
        let factor = match i % 4 {
            0 => [width(unit()), 0.0, width(unit())],
            1 => [width(0.1), 0.9 * width(unit()), width(0.9)],
            _ => [width(0.5 * unit()), (unit() - 0.5) as f32, width(0.5 * unit())],
        };
        let opacity = opacities[0] + (opacities[1] - opacities[0]) * unit();
        splat_of(mean, factor, opacity as f32, [unit(), unit(), unit()].map(|v| v as f32))
    };
    (0..count).map(splat).collect()
}

/// Uploads splats, in the order of their numbers in every bin: as sort and merge leave them.
fn upload_lists(bench: &Bench, splats: &[(reference::Splat, [[u32; 4]; 3])]) {
    let records: Vec<[u32; 4]> = splats.iter().flat_map(|(_, record)| *record).collect();
    let ids: Vec<u32> = (0..bench.grid.count()).flat_map(|_| 0..splats.len() as u32).collect();
    bench.run(|b, cmd| {
        cmd.upload(&b.work.splats, 0, records.len(), |m| m.copy_from_slice(&records)).unwrap();
        cmd.upload(&b.work.splat_ids, 0, ids.len(), |m| m.copy_from_slice(&ids)).unwrap();
    });
}

/// Every splat in every bin of a picture.
fn listed_everywhere(count: usize, grid: BinGrid) -> Input {
    let [columns, rows] = grid.bins;
    let spans: Vec<u32> = (0..count).flat_map(|_| (0..rows).map(|_| columns << 16)).collect();
    let place = |i: usize| if rows == 1 { columns << 16 } else { i as u32 * rows };
    Input::with((0..count).map(|i| [place(i), rows << 16]).collect(), spans, |i| i)
}

#[test]
fn masks_mark_every_block_that_a_splat_reaches_and_hardly_more() {
    // Around a word of bits and a stretch.
    for (count, height) in [(1, 0), (31, 1), (32, 2), (33, 0), (1023, 1), (1024, 2), (1025, 0), (2500, 1)] {
        let block_height = BLOCK_HEIGHTS[height];
        let size = [2 * 64, 2 * BIN_ROWS * block_height];
        let grid = BinGrid::new(size, height);
        let splats = splats(count, size, [0.003, 1.0]);
        let input = listed_everywhere(count, grid);
        let bench = Bench::new(size, height, &input, count * grid.count() as usize, 0);
        bench.list();
        upload_lists(&bench, &splats);
        bench.run(|b, cmd| b.pipeline.masks(cmd, &b.work, b.grid));
        let masks = bench.gpu.download(&bench.work.masks);
        for (number, bin) in bench.bins().iter().enumerate() {
            let number = number as u32;
            let corner = [number % grid.bins[0] * 64, number / grid.bins[0] * BIN_ROWS * block_height];
            let blocks =
                BinBlocks { corner_px: corner, counts: [BIN_COLUMNS, BIN_ROWS], block_px: [BLOCK_WIDTH, block_height] };
            for (entry, (splat, _)) in splats.iter().enumerate() {
                let stretch = bin.first_stretch as usize + entry / BIN_STRETCH as usize;
                let (word, bit) = (entry % BIN_STRETCH as usize / 32, entry % 32);
                let mask = (0..BLOCKS as usize)
                    .map(|block| (masks[(stretch * BLOCKS as usize + block) * 32 + word] >> bit & 1) << block)
                    .sum::<u32>();
                let must = reference::block_mask(splat, blocks, RULES, -1e-4, -1e-3);
                let may = reference::block_mask(splat, blocks, RULES, 2e-3, 1e-2);
                assert_eq!(must & !mask, 0, "blocks are missing: {splat:?}, bin {number}, {count} splats");
                assert_eq!(mask & !may, 0, "blocks are too many: {splat:?}, bin {number}, {count} splats");
            }
        }
    }
}

/// Draws lists of all splats in every bin through masks and blend, and holds the picture to the reference's blend of the
/// same lists.
fn blend_agrees(count: usize, height: usize, size: [u32; 2], opacities: [f64; 2]) {
    let grid = BinGrid::new(size, height);
    let splats = splats(count, size, opacities);
    let bench = Bench::new(size, height, &listed_everywhere(count, grid), count * grid.count() as usize, count as u32);
    bench.list();
    upload_lists(&bench, &splats);
    bench.run(|b, cmd| b.pipeline.masks(cmd, &b.work, b.grid));
    let image = Image::new(&bench.gpu.0, "image", size[0], size[1]).unwrap();
    let background = [0.1, 0.2, 0.3];
    let target = Target { image: &image, certificate: None, background: Background::Colour(background) };
    let mut cmd = Commands::new(&bench.gpu.0).unwrap();
    bench.pipeline.blend(&mut cmd, &bench.work, bench.grid, target);
    cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
    let rows = cmd.read_rows(&image, 0..size[1]).unwrap();
    let results = cmd.submit().unwrap().wait().unwrap();

    let tiling = Tiling::of(size);
    let ids: Vec<u32> = (0..count as u32).collect();
    let all: Vec<reference::Splat> = splats.iter().map(|(splat, _)| *splat).collect();
    let ranges = vec![[0, count as u32]; tiling.tiles()];
    let lists = Lists { splats: &all, ranges: &ranges, splat_ids: &ids, rays: None };
    let exact = reference::blend(&lists, tiling, DVec3::from(background.map(f64::from)), RULES);
    let pairs = results.view(&rows).iter().zip(&exact).enumerate();
    let mut in_doubt = 0;
    for (index, (pixel, exact)) in pairs {
        let error = (0..3).map(|i| (f64::from(pixel[i]) - exact.colour[i]).abs()).fold(0.0, f64::max);
        let place = dvec2((index as u32 % size[0]).into(), (index as u32 / size[0]).into());
        assert!(error <= 1e-4 + exact.doubt, "{error} at {place}, {count} splats, height {height}");
        in_doubt += usize::from(exact.doubt > 1e-4);
    }
    assert!(in_doubt * 5 < exact.len(), "{in_doubt} of {} pixels are in doubt", exact.len());
}

#[test]
fn blend_of_short_lists_agrees_with_its_twin() {
    // The last sizes leave blocks and bins that the picture cuts.
    for (count, height, size) in [
        (0, 0, [64, 16]),
        (1, 1, [64, 32]),
        (31, 2, [64, 64]),
        (33, 0, [100, 33]),
        (1024, 1, [65, 33]),
        (1025, 2, [33, 65]),
        (3000, 0, [64, 16]),
    ] {
        blend_agrees(count, height, size, [0.01, 0.999]);
    }
}

#[test]
fn blend_of_long_lists_agrees_with_its_twin() {
    // So faint that pixels stop late; opaque enough that they stop within a stretch.
    for (height, opacities) in [(0, [0.0041, 0.006]), (1, [0.005, 0.05]), (2, [0.0041, 0.006])] {
        blend_agrees(LONG_LIST as usize + 7, height, [40, 20], opacities);
    }
    assert_eq!(TILE, 16, "bins are whole tiles");
}
