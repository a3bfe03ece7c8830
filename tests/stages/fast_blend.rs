//! The stages of the fast path that draw blocks, masks and blend, each against its twin on the CPU.

use super::fast_input::{Bench, Input};
use crate::common::Random;
use glam::{DMat2, DVec2, DVec3, dvec2};
use smalto::gpu::{Access, Commands, Image};
use smalto::options::Options;
use smalto::reference::{self, BinBlocks, Lists, Tiling};
use smalto::render::shaders::FastDispatches;
use smalto::render::shaders::fast::{BIN_COLUMNS, BIN_ROWS, BIN_RUN, BIN_SEGMENT, BLOCK_WIDTH, BLOCKS, MERGE_RUNS};
use smalto::render::{BLOCK_FORMS, BinGrid, Target};
use smalto::rules::{ALPHA_MIN, Background, Rules, TILE};

const RULES: &Rules = &Rules::TRAINED;

/// The length from which on a list takes several merge levels.
const LONG_LIST: u32 = BIN_RUN * MERGE_RUNS;

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
    // Around a word of bits and a segment.
    for (count, form) in [(1, 1), (31, 2), (32, 3), (33, 1), (1023, 2), (1024, 3), (1025, 1), (2500, 2)] {
        let block_height = BLOCK_FORMS[form].height;
        let size = [2 * 64, 2 * BIN_ROWS * block_height];
        let grid = BinGrid::new(size, form);
        // Projection drops splats under the threshold of 1/255.
        let splats = splats(count, size, [0.004, 1.0]);
        let input = listed_everywhere(count, grid);
        let bench = Bench::new(size, form, &input, count * grid.count() as usize, 0);
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
                let segment = bin.first_segment as usize + entry / BIN_SEGMENT as usize;
                let (word, bit) = (entry % BIN_SEGMENT as usize / 32, entry % 32);
                let mask = (0..BLOCKS as usize)
                    .map(|block| (masks[(segment * BLOCKS as usize + block) * 32 + word] >> bit & 1) << block)
                    .sum::<u32>();
                let must = reference::block_mask(splat, blocks, RULES, -1e-4, -1e-3);
                let may = reference::block_mask(splat, blocks, RULES, 2e-3, 1e-2);
                assert_eq!(must & !mask, 0, "blocks are missing: {splat:?}, bin {number}, {count} splats");
                assert_eq!(mask & !may, 0, "blocks are too many: {splat:?}, bin {number}, {count} splats");
            }
        }
    }
}

/// A folded dispatch may have more workgroups than there are segments. Here it has twice as many, and there is memory
/// that those beyond could write.
#[test]
fn workgroups_without_a_segment_do_nothing() {
    const UNTOUCHED: u32 = 0xabcd_1234;
    let (size, count) = ([2 * 64, 32], 1500);
    let grid = BinGrid::new(size, 2);
    let bench = Bench::new(size, 2, &listed_everywhere(count, grid), 10_000, 0);
    bench.list();
    upload_lists(&bench, &splats(count, size, [0.004, 1.0]));
    let dispatches = bench.gpu.download(&bench.work.dispatches)[0];
    assert_eq!([dispatches.over_segments[0], dispatches.over_segments[1], dispatches.segments], [4, 1, 4]);
    bench.run(|b, cmd| {
        let folded = FastDispatches { over_segments: [4, 2, 1], ..dispatches };
        cmd.upload(&b.work.dispatches, 0, 1, |memory| memory[0] = folded).unwrap();
        cmd.upload(&b.work.segment_bins, 4, 4, |memory| memory.fill(1)).unwrap();
        cmd.fill(&b.work.masks, UNTOUCHED);
    });
    bench.run(|b, cmd| b.pipeline.masks(cmd, &b.work, b.grid));
    let masks = bench.gpu.download(&bench.work.masks);
    let (used, beyond) = masks.split_at(4 * BIN_SEGMENT as usize);
    assert!(beyond.len() >= used.len() && beyond.iter().all(|word| *word == UNTOUCHED));
    assert!(!used.contains(&UNTOUCHED));
}

const BACKGROUND: [f32; 3] = [0.1, 0.2, 0.3];

/// Draws lists of all splats in every bin through masks and blend.
fn blended(
    options: &Options,
    splats: &[(reference::Splat, [[u32; 4]; 3])],
    form: usize,
    size: [u32; 2],
) -> Vec<[f32; 4]> {
    let (count, grid) = (splats.len(), BinGrid::new(size, form));
    let (input, entries) = (listed_everywhere(count, grid), count * grid.count() as usize);
    let bench = Bench::with(options, size, form, &input, entries, count as u32);
    bench.list();
    upload_lists(&bench, splats);
    bench.run(|b, cmd| b.pipeline.masks(cmd, &b.work, b.grid));
    let image = Image::new(&bench.gpu.0, "image", size[0], size[1]).unwrap();
    let target = Target { image: &image, certificate: None, background: Background::Colour(BACKGROUND) };
    let mut cmd = Commands::new(&bench.gpu.0).unwrap();
    bench.pipeline.blend(&mut cmd, &bench.work, bench.grid, target);
    cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
    let rows = cmd.read_rows(&image, 0..size[1]).unwrap();
    let results = cmd.submit().unwrap().wait().unwrap();
    results.view(&rows).to_vec()
}

/// Compares a picture of lists of all splats in every bin with the reference's blend of the same lists.
fn blend_agrees(splats: &[(reference::Splat, [[u32; 4]; 3])], form: usize, size: [u32; 2]) {
    let drawn = blended(&Options::EXACT, splats, form, size);
    let count = splats.len();
    let tiling = Tiling::of(size);
    let ids: Vec<u32> = (0..count as u32).collect();
    let all: Vec<reference::Splat> = splats.iter().map(|(splat, _)| *splat).collect();
    let ranges = vec![[0, count as u32]; tiling.tiles()];
    let lists = Lists { splats: &all, ranges: &ranges, splat_ids: &ids, rays: None };
    let exact = reference::blend(&lists, tiling, DVec3::from(BACKGROUND.map(f64::from)), RULES);
    let pairs = drawn.iter().zip(&exact).enumerate();
    let mut in_doubt = 0;
    for (index, (pixel, exact)) in pairs {
        let error = (0..3).map(|i| (f64::from(pixel[i]) - exact.colour[i]).abs()).fold(0.0, f64::max);
        let place = dvec2((index as u32 % size[0]).into(), (index as u32 / size[0]).into());
        assert!(error <= 1e-4 + exact.doubt, "{error} at {place}, {count} splats, form {form}");
        // A doubtful stop moves a colour by 1e-4; the comparison would be worth little with more doubt than this.
        in_doubt += usize::from(exact.doubt > 1e-3);
    }
    assert!(in_doubt * 5 < exact.len(), "{in_doubt} of {} pixels are in doubt", exact.len());
}

#[test]
fn blend_of_short_lists_agrees_with_its_twin() {
    // The last sizes leave blocks and bins that the picture cuts.
    for (count, form, size) in [
        (0, 0, [64, 16]),
        (1, 2, [64, 32]),
        (31, 3, [64, 64]),
        (33, 1, [100, 33]),
        (1024, 2, [65, 33]),
        (1025, 3, [33, 65]),
        (3000, 0, [64, 16]),
    ] {
        blend_agrees(&splats(count, size, [0.01, 0.999]), form, size);
    }
}

/// A list of so many splats in which one of `every` covers the picture faintly. The others are outside of it.
fn faint(count: usize, every: usize) -> Vec<(reference::Splat, [[u32; 4]; 3])> {
    let mut random = Random(every as u64);
    let splat = |i: usize| {
        let mut unit = || random.between(0.0, 1.0);
        let colour = [unit(), unit(), unit()].map(|v| v as f32);
        match i % every {
            // Its alpha is 0.0042 or more in the whole picture: over the threshold, without doubt.
            0 => splat_of([20.0, 10.0], [0.002, 0.0, 0.002], (0.0045 + 0.0005 * unit()) as f32, colour),
            _ => splat_of([-1000.0, -1000.0], [1.0, 0.0, 1.0], 0.9, colour),
        }
    };
    (0..count).map(splat).collect()
}

/// Every entry reaches every block: the words of a mask have more entries than are taken at once.
#[test]
fn blend_of_crowded_blocks_agrees_with_its_twin() {
    for (count, form) in [(127, 0), (128, 0), (129, 0), (3000, 0), (3000, 1), (3000, 2)] {
        blend_agrees(&faint(count, 1), form, [40, 20]);
    }
}

#[test]
fn blend_of_long_lists_agrees_with_its_twin() {
    let count = LONG_LIST as usize + 7;
    // Pixels that see the end of the list, and pixels that stop within it.
    for (form, every) in [(0, 40), (1, 40), (2, 5), (3, 40)] {
        blend_agrees(&faint(count, every), form, [40, 20]);
    }
    assert_eq!(TILE, 16, "bins are whole tiles");
}

#[test]
fn a_ring_changes_no_bit() {
    let size = [40, 20];
    // The density of the last two changes within the list, and the last has more entries than 16 bits count.
    let lists = [
        splats(3000, size, [0.01, 0.1]),
        faint(5000, 40),
        [faint(9000, 90), faint(700, 1), faint(9000, 90), faint(700, 2)].concat(),
        [faint(70_000, 500), faint(1000, 1)].concat(),
    ];
    for (number, list) in lists.iter().enumerate() {
        let [with_ring, without] = [0, 1].map(|form| blended(&Options::EXACT, list, form, size));
        assert!(with_ring == without, "list {number}");
        blend_agrees(list, 0, size);
    }
}

/// Splats are blended four or eight at once. Here up to nine that reach only the first pixel of a block come before the
/// others and so move the groups.
#[test]
fn where_a_pixel_stops_does_not_depend_on_the_splats_that_are_blended_at_once() {
    let options = Options { stop: 0.05, ..Options::EXACT };
    let others = splats(60, [8, 8], [0.2, 0.6]);
    for (form, size) in [(0, [8, 4]), (1, [8, 4]), (2, [8, 8]), (3, [8, 16])] {
        let picture = |before: usize| {
            let first_pixel = splat_of([0.5, 0.5], [6.0, 0.0, 6.0], 0.1, [1.0; 3]);
            let all: Vec<_> = std::iter::repeat_n(first_pixel, before).chain(others.iter().copied()).collect();
            blended(&options, &all, form, size)[1..].to_vec()
        };
        let alone = picture(0);
        assert!(alone.iter().any(|pixel| pixel[3] > 0.95), "some pixels stop");
        assert!(alone.iter().all(|pixel| pixel[3] < 0.999), "no pixel takes all splats");
        for before in 1..10 {
            assert_eq!(picture(before), alone, "{before} before, form {form}");
        }
    }
}
