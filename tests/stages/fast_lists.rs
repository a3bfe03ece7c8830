//! The stages of the fast path that make lists, each against its twin on the CPU, at the sizes where indices go wrong.

use super::fast_input::{Bench, Input, parts};
use crate::common::Random;
use smalto::options::Options;
use smalto::reference;
use smalto::render::shaders::fast::{
    BIN_CHUNK, BIN_CHUNKS, BIN_RUN, BIN_SEGMENT, MANY_SPLATS, MAX_BIN_CHUNKS, MERGE_RUNS,
};
use smalto::render::shaders::{FastCounters, FastDispatches};
use smalto::render::{BinGrid, Capacity};

/// The longest list whose runs are merged at once.
const LONG_LIST: u32 = BIN_RUN * MERGE_RUNS;

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

/// Around a lane, a subgroup and a chunk.
const COUNTS: [usize; 12] = [0, 1, 7, 8, 31, 32, 33, 1023, 1024, 1025, 2049, 20_001];

fn counters_are_zero(bench: &Bench) {
    let FastCounters { visible, spans, listed_low, listed_high } = bench.gpu.download(&bench.work.counters)[0];
    assert_eq!([visible, spans, listed_low, listed_high], [0; 4]);
    assert!(bench.gpu.download(&bench.work.listed_in_bins).iter().all(|count| *count == 0));
}

#[test]
fn list_and_offsets_list_every_splat_in_its_bins() {
    for count in COUNTS {
        let input = scattered(count);
        let grid = BinGrid::new([40 * 64, 30 * 32], 2);
        let counts = input.counts(grid);
        let entries: u32 = counts.iter().sum();
        let bench = Bench::new([40 * 64, 30 * 32], 2, &input, entries as usize, 0);

        bench.run(|b, cmd| b.pipeline.list(cmd, &b.work, b.grid));
        assert_eq!(bench.gpu.download(&bench.work.listed_in_bins), counts, "{count} splats");
        let counters = bench.gpu.download(&bench.work.counters)[0];
        assert_eq!([counters.visible, counters.listed_high, counters.listed_low], [count as u32, 0, entries]);
        // The regions of the chunks are disjoint and cover all entries.
        let mut regions: Vec<_> = bench.list_starts().iter().map(|row| (row[0], row[row.len() - 1])).collect();
        regions.sort_unstable();
        let end = regions.into_iter().fold(0, |end, (begin, next)| {
            assert_eq!(begin, end, "{count} splats");
            next
        });
        assert_eq!(end, entries as usize, "{count} splats");
        let mut lists = bench.lists();
        lists.iter_mut().for_each(|list| list.sort_unstable_by_key(|[_, splat]| *splat));
        assert_eq!(lists, input.lists(grid), "{count} splats");

        bench.run(|b, cmd| b.pipeline.offsets(cmd, &b.work, b.grid));
        let expected = reference::bin_offsets(&counts, entries, LONG_LIST - 1, BIN_RUN, BIN_SEGMENT);
        let bins = bench.bins();
        assert_eq!(bins, expected.bins, "{count} splats");
        let runs = bench.gpu.download(&bench.work.run_bins);
        assert_eq!(runs[..expected.run_bins.len()], expected.run_bins);
        let segments = bench.gpu.download(&bench.work.segment_bins);
        assert_eq!(segments[..expected.segment_bins.len()], expected.segment_bins);
        let dispatches = bench.gpu.download(&bench.work.dispatches)[0];
        let parts = [expected.run_bins.len(), expected.segment_bins.len()];
        assert_eq!([dispatches.runs, dispatches.segments].map(|count| count as usize), parts, "{count} splats");
        let totals = bench.gpu.download(&bench.work.totals)[0];
        assert_eq!([totals.visible, totals.visible_kept], [count as u32; 2]);
        assert_eq!([totals.listed_high, totals.listed_low, totals.listed_kept], [0, entries, entries]);
        assert_eq!(totals.longest_list, counts.iter().copied().max().unwrap());
        counters_are_zero(&bench);
    }
}

#[test]
fn entries_that_do_not_fit_are_counted_and_none_is_listed() {
    let input = scattered(2000);
    let size = [40 * 64, 30 * 32];
    let counts = input.counts(BinGrid::new(size, 2));
    let entries: u32 = counts.iter().sum();
    for capacity in [0, 1, entries / 2, entries - 1] {
        let bench = Bench::new(size, 2, &input, capacity as usize, 0);
        bench.list();
        let totals = bench.gpu.download(&bench.work.totals)[0];
        assert_eq!([totals.listed_high, totals.listed_low, totals.listed_kept], [0, entries, 0]);
        assert_eq!(Some(totals.longest_list), counts.iter().copied().max());
        assert!(bench.bins().iter().all(|bin| bin.count == 0));
        assert_eq!(bench.gpu.download(&bench.work.dispatches)[0].over_runs[0], 0);
        counters_are_zero(&bench);
    }
}

/// The chunks before have taken almost all of 2^32 entries.
#[test]
fn a_demand_of_more_than_32_bits_is_counted() {
    let input = scattered(2000);
    let bench = Bench::new([40 * 64, 30 * 32], 2, &input, 5000, 0);
    let taken = FastCounters { visible: 2000, listed_low: u32::MAX - 100, ..bytemuck::Zeroable::zeroed() };
    bench.run(|b, cmd| cmd.upload(&b.work.counters, 0, 1, |memory| memory[0] = taken).unwrap());
    bench.list();
    let totals = bench.gpu.download(&bench.work.totals)[0];
    let entries: u32 = input.counts(bench.grid).iter().sum();
    assert_eq!([totals.listed_high, totals.listed_low], [1, entries - 101]);
    assert_eq!(totals.listed_kept, 0);
    assert!(bench.bins().iter().all(|bin| bin.count == 0));
    counters_are_zero(&bench);
}

#[test]
fn offsets_order_bins_by_length() {
    let mut lengths: Vec<u32> = (0..900).map(|i: u32| i.wrapping_mul(0x9e37_79b9) >> (15 + i % 17)).collect();
    lengths[450] = LONG_LIST + 1;
    let bench = Bench::new([30 * 64, 30 * 32], 2, &Input::of_lengths(&[], |_| 0), 0, 0);
    let demand: u32 = lengths.iter().sum();
    let counted = FastCounters { listed_low: demand, ..bytemuck::Zeroable::zeroed() };
    let mut bench = bench;
    let most = lengths.iter().copied().max().unwrap();
    // First there is no room for any, then the merges do not sort the longest: nothing may be listed that is not drawn.
    for (capacity, longest, kept) in [(0, LONG_LIST - 1, 0), (demand, LONG_LIST - 1, 0), (demand, most, demand)] {
        let room = Capacity { listed: capacity.into(), cells: 900, ..Capacity::default() };
        bench.work.grow(&bench.gpu.0, room, longest).unwrap();
        bench.run(|b, cmd| {
            cmd.upload(&b.work.counters, 0, 1, |memory| memory[0] = counted).unwrap();
            cmd.upload(&b.work.listed_in_bins, 0, 900, |memory| memory.copy_from_slice(&lengths)).unwrap();
        });
        bench.run(|b, cmd| b.pipeline.offsets(cmd, &b.work, b.grid));
        assert_eq!(bench.bins(), reference::bin_offsets(&lengths, capacity, longest, BIN_RUN, BIN_SEGMENT).bins);
        let totals = bench.gpu.download(&bench.work.totals)[0];
        assert_eq!([totals.listed_low, totals.listed_kept, totals.longest_list], [demand, kept, most]);
    }
    let order = bench.gpu.download(&bench.work.bin_order);
    let mut bins = order.clone();
    bins.sort_unstable();
    assert!(bins.into_iter().eq(0..900), "every bin once");
    // Four classes for every power of two: within one, lengths differ by a quarter at most.
    let by_order: Vec<u32> = order.iter().map(|bin| lengths[*bin as usize]).collect();
    assert!(by_order.windows(2).all(|pair| f64::from(pair[1]) <= 1.25 * f64::from(pair[0].max(1))), "{by_order:?}");
    assert!(by_order[0] > LONG_LIST, "some lists are merged in pairs");
}

/// Around lanes, subgroups, runs, merge inputs.
const LENGTHS: [usize; 26] = [
    0, 1, 2, 7, 8, 9, 31, 32, 33, 511, 512, 513, 1023, 1024, 1025, 2047, 2048, 2049, 4095, 4096, 4097, 10_000, 32_768,
    70_000, 131_072, 131_073,
];

/// The depth key of a splat.
type Key = fn(u32) -> u32;

#[test]
fn sort_and_merge_order_lists_of_every_length() {
    let kinds: [(&str, Key); 6] = [
        ("random", |i| (u64::from(i).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33) as u32),
        ("close", |i| 0x3f80_0000 + (i.wrapping_mul(0x9e37_79b9) >> 22)),
        ("few", |i| i.wrapping_mul(0x9e37_79b9) >> 30),
        ("equal", |_| 0x7fff_ffff),
        ("ascending", |i| i),
        ("one far", |i| if i % 2000 == 1 { 0x7f00_0000 } else { i % 16 }),
    ];
    let forms = [(LENGTHS.as_slice(), 2), (&LENGTHS[..LENGTHS.len() - 1], MERGE_RUNS as usize)];
    let cases = kinds.map(|kind| [(forms[0], kind, false), (forms[0], kind, true), (forms[1], kind, true)]);
    for ((lengths, inputs), (name, key), is_shuffled) in cases.into_iter().flatten() {
        let size = [lengths.len() as u32 * 64, 32];
        // In the order of the splats a list has entries of few chunks, shuffled it has entries of all.
        let input = Input::of_lengths(lengths, key);
        let input = if is_shuffled { input.shuffled() } else { input };
        let entries: usize = lengths.iter().sum();
        let longest = lengths[lengths.len() - 1];
        let bench = Bench::new(size, 2, &input, entries, longest as u32);
        assert_eq!(bench.work.pair_merges().count() > 0, inputs == 2);
        bench.list();
        let bins = bench.bins();
        let listed = bench.lists();

        bench.run(|b, cmd| b.pipeline.sort(cmd, &b.work, b.grid));
        let sorted = bench.gpu.download(&bench.work.entries);
        let ids = bench.gpu.download(&bench.work.splat_ids);
        let mut runs = Vec::new();
        for ((bin, mut expected), now) in bins.iter().zip(listed).zip(parts(&sorted, &bins)) {
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
            let mut length = BIN_RUN as usize;
            while length < longest {
                expected = reference::merge_inputs(&expected, length, inputs, &input.gaussian_from_splat);
                length *= inputs;
            }
            assert!(expected.iter().map(|[_, splat]| splat).eq(ids), "{name}: merged list of {}", bin.count);
        }
    }
}

/// Sorts and merges the lists of a bench, and checks each. Returns the splats of all lists.
fn sort_and_check(bench: &Bench, input: &Input) -> Vec<u32> {
    bench.run(|b, cmd| b.pipeline.sort(cmd, &b.work, b.grid));
    bench.run(|b, cmd| b.pipeline.merge(cmd, &b.work));
    let ids = bench.gpu.download(&bench.work.splat_ids);
    for (ids, mut expected) in parts(&ids, &bench.bins()).zip(input.lists(bench.grid)) {
        reference::sort_run(&mut expected, &input.gaussian_from_splat);
        assert!(expected.iter().map(|[_, splat]| splat).eq(ids), "a list of {}", ids.len());
    }
    ids
}

/// More splats are listed in chunks of more splats than lanes, and many in more chunks, whose lists begin at other
/// places.
#[test]
fn many_splats_are_listed_in_many_chunks() {
    for (count, chunks) in [(BIN_CHUNKS * BIN_CHUNK + 1000, BIN_CHUNKS), (MANY_SPLATS + 1000, MAX_BIN_CHUNKS)] {
        let mut random = Random(5);
        let spans = (0..count).map(|_| (random.below(40), random.below(25))).collect::<Vec<_>>();
        let spans = spans.into_iter().map(|(column, row)| (row, column, column + 1));
        let input = Input::of_spans(spans, |i| i.wrapping_mul(0x9e37_79b9) >> 4);
        let bench = Bench::with(&Options::BALANCED, [40 * 64, 25 * 32], 2, &input, count as usize, 0);
        assert_eq!(bench.work.bin_chunks(bench.grid), chunks);
        bench.list();
        sort_and_check(&bench, &input);
    }
}

/// A folded dispatch may have more workgroups than there are runs. Here it has twice as many, those beyond find the
/// longest list, and there is memory that they could write. The lists take up to nine merges of pairs.
#[test]
fn workgroups_without_a_run_do_nothing() {
    const UNTOUCHED: u32 = 0xabcd_1234;
    let lengths = [1, 5000, 2048, 530_000];
    let input = Input::of_lengths(&lengths, |i| i.wrapping_mul(0x9e37_79b9));
    let entries = lengths.iter().sum::<usize>();
    let bench = Bench::new([4 * 64, 32], 2, &input, entries + 20_000, 530_000);
    bench.list();
    let dispatches = bench.gpu.download(&bench.work.dispatches)[0];
    let runs = lengths.iter().map(|length| length.div_ceil(BIN_RUN as usize)).sum::<usize>();
    assert_eq!([dispatches.over_runs[0], dispatches.over_runs[1], dispatches.runs], [runs as u32, 1, runs as u32]);
    bench.run(|b, cmd| {
        let folded = FastDispatches { over_runs: [runs as u32, 2, 1], ..dispatches };
        cmd.upload(&b.work.dispatches, 0, 1, |memory| memory[0] = folded).unwrap();
        cmd.upload(&b.work.run_bins, runs, b.work.run_bins.len() - runs, |memory| memory.fill(3)).unwrap();
        cmd.fill(&b.work.splat_ids, !UNTOUCHED); // another word, which a merge of untouched entries would not write
        cmd.fill(&b.work.entries, UNTOUCHED);
        cmd.fill(&b.work.merged, UNTOUCHED);
    });
    let ids = sort_and_check(&bench, &input);
    assert!(ids[entries..].iter().all(|id| *id == !UNTOUCHED));
    for buffer in [&bench.work.entries, &bench.work.merged] {
        assert!(bench.gpu.download(buffer)[entries..].iter().flatten().all(|word| *word == UNTOUCHED));
    }
}
