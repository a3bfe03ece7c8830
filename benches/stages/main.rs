//! Each stage alone on made-up input, beside a copy of as many bytes: `cargo bench --bench stages`, with a part of a
//! name to run only some.
//!
//! Times are between timestamps on the GPU. A row's limit is the time in which a copy, measured on the same device in
//! the same run, moves the fewest bytes that the stage can do with; the stages of the fit, which compute, have none.

mod arrays;
mod fast;
mod fit;
mod marks;

use std::cell::RefCell;
use std::time::Duration;

use anyhow::{Context, Result};
use bytemuck::Zeroable;
use criterion::{BenchmarkId, Criterion, Throughput};
use smalto::cli::environment::Environment;
use smalto::gpu::{
    Access, Buffer, Commands, Device, DeviceKind, DispatchSize, Element, Image, Stage, Staging, Validation,
};
use smalto::measure::bench::{Protocol, Statistics, WarmUpLimits, copy_gb_s};
use smalto::options::Options;
use smalto::pixels::Integers;
use smalto::render::shaders::PortableDispatches;
use smalto::render::shaders::portable::*;
use smalto::render::{Band, Packer, Pairs, RadixSort, SortRange, SortScratch, Splat, Totals, Unpacker};

/// A stage with its input, ready to run again and again.
struct Bench<'a> {
    stage: &'static str,
    input: String,
    /// Least bytes that it moves.
    bytes: u64,
    record: Box<dyn Fn(&mut Commands) + 'a>,
}

fn main() -> Result<()> {
    let environment = Environment::read()?;
    let device = Device::open(&environment.device, environment.validation.unwrap_or(Validation::Off))?;
    // A software device has a thousandth of the speed.
    let scale = if device.capabilities().kind == DeviceKind::Cpu { 64 } else { 1 };
    let copy_gb_s = copy_gb_s(&device)?;
    let mut criterion = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(50))
        .measurement_time(Duration::from_millis(100))
        .without_plots()
        .configure_from_args();
    let mut rows = Vec::new();
    for splats in [1 << 18, 1 << 20, 1 << 22] {
        run(&mut criterion, &device, scan(&device, splats / scale)?, &mut rows)?;
    }
    for (bits, keys) in [(8, 20), (16, 20), (24, 20), (32, 20), (16, 16), (16, 22), (16, 24), (32, 24)] {
        run(&mut criterion, &device, sort(&device, bits, (1 << keys) / scale)?, &mut rows)?;
    }
    for splats in [1 << 18, 1 << 20, 1 << 22] {
        run(&mut criterion, &device, duplicate(&device, splats / scale)?, &mut rows)?;
    }
    for instances in [1 << 20, 1 << 22, 1 << 24] {
        run(&mut criterion, &device, ranges(&device, instances / scale)?, &mut rows)?;
    }
    for list in [64, 512, 2048] {
        run(&mut criterion, &device, blend(&device, list / scale.min(16))?, &mut rows)?;
    }
    for integers in [Integers::Rgb8, Integers::Rgb16, Integers::Grey8] {
        run(&mut criterion, &device, pack(&device, integers, [1920, 1080 / scale])?, &mut rows)?;
    }
    run(&mut criterion, &device, unpack(&device, [1920, 1080 / scale])?, &mut rows)?;
    for bench in arrays::benches(&device, (1 << 20) / scale as usize)? {
        run(&mut criterion, &device, bench, &mut rows)?;
    }
    for bench in marks::benches(&device, 1_800_000 / scale as usize)? {
        run(&mut criterion, &device, bench, &mut rows)?;
    }
    if let Some(fast) = fast::Fast::new(&device, (1 << 20) / scale)? {
        for bench in fast.benches() {
            run(&mut criterion, &device, bench, &mut rows)?;
        }
    }
    fit::run(&mut criterion, &device, 4096 / scale as usize, &mut rows)?;
    criterion.final_summary();
    println!("\n{}, copies at {copy_gb_s:.0} GB/s", device.capabilities().name);
    println!("{:<10} {:<32} {:>10} {:>8} {:>16}", "stage", "input", "us", "GB/s", "of a copy's speed");
    for (stage, input, bytes, ms) in rows {
        let speed = bytes.map(|bytes| bytes as f64 / (ms * 1e6));
        let [gb_s, percent] = speed
            .map_or_else(Default::default, |gb_s| [format!("{gb_s:.1}"), format!("{:.0} %", gb_s / copy_gb_s * 100.0)]);
        println!("{stage:<10} {input:<32} {:>10.1} {gb_s:>8} {percent:>16}", ms * 1e3);
    }
    Ok(())
}

/// Stage, input, the least bytes that it moves, and median time in milliseconds.
type Row = (&'static str, String, Option<u64>, f64);

fn run(criterion: &mut Criterion, device: &Device, bench: Bench, rows: &mut Vec<Row>) -> Result<()> {
    let once = || -> Result<f64> {
        let mut cmd = Commands::new(device)?;
        (bench.record)(&mut cmd);
        let results = cmd.submit()?.wait()?;
        Ok(results.timings().first().context("the stage was not timed")?.duration_ms)
    };
    time(criterion, (bench.stage, bench.input, Some(bench.bytes)), &once, rows)
}

/// Measures a stage with this input. `once` runs the stage, and returns its time in milliseconds.
fn time(
    criterion: &mut Criterion,
    (stage, input, bytes): (&'static str, String, Option<u64>),
    once: &dyn Fn() -> Result<f64>,
    rows: &mut Vec<Row>,
) -> Result<()> {
    // What cannot run at all fails here, with its reason.
    Protocol { warmup: 1, frames: 1 }.warm_up(1, WarmUpLimits::BRIEF, |_| once())?;
    let times = RefCell::new(Vec::new());
    let mut group = criterion.benchmark_group(stage);
    if let Some(bytes) = bytes {
        group.throughput(Throughput::Bytes(bytes));
    }
    group.bench_function(BenchmarkId::from_parameter(&input), |bencher| {
        bencher.iter_custom(|iterations| {
            let ms: f64 = (0..iterations)
                .map(|_| {
                    let ms = once().expect("what ran once runs again");
                    times.borrow_mut().push(ms);
                    ms
                })
                .sum();
            Duration::from_secs_f64(ms * 1e-3)
        });
    });
    group.finish();
    let times = times.into_inner();
    if !times.is_empty() {
        rows.push((stage, input, bytes, Statistics::of(times).median));
    }
    Ok(())
}

fn pack(device: &Device, integers: Integers, size: [u32; 2]) -> Result<Bench<'_>> {
    let image = Image::new(device, "image", size[0], size[1])?;
    let mut packer = Packer::new(device, integers)?;
    packer.fit(device, size)?;
    let bytes = u64::from(size[0]) * u64::from(size[1]) * 16 + integers.bytes(size);
    let pack = move |cmd: &mut Commands| cmd.scope("pack", |cmd| _ = packer.record(cmd, &image));
    Ok(Bench { stage: "pack", input: format!("{}x{} {integers:?}", size[0], size[1]), bytes, record: Box::new(pack) })
}

/// The way back of half a picture, with the copy from host memory.
fn unpack(device: &Device, size: [u32; 2]) -> Result<Bench<'_>> {
    let image = Image::new(device, "image", size[0], size[1])?;
    let band = Band { top: size[1] / 2, rows: size[1] / 2 };
    let half = band.size(size);
    let packed = Staging::new(device, "bands", Integers::Rgb8.words(half))?;
    let mut unpacker = Unpacker::new(device)?;
    unpacker.fit(device, size, &[(band, &packed)])?;
    let bytes = u64::from(half[0]) * u64::from(half[1]) * 16 + 3 * Integers::Rgb8.bytes(half);
    let unpack = move |cmd: &mut Commands| cmd.scope("unpack", |cmd| unpacker.record(cmd, &[(band, &packed)], &image));
    Ok(Bench { stage: "unpack", input: format!("{}x{}", half[0], half[1]), bytes, record: Box::new(unpack) })
}

/// Hashes an index (SplitMix64).
fn random(index: u32) -> u32 {
    let mut z = u64::from(index).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (z ^ (z >> 31)) as u32
}

fn upload<T: Element>(device: &Device, name: &str, content: &[T]) -> Result<Buffer<T>> {
    let buffer = Buffer::new(device, name, content.len())?;
    let mut cmd = Commands::new(device)?;
    cmd.upload(&buffer, 0, content.len(), |memory| memory.copy_from_slice(content))?;
    cmd.submit()?.wait()?;
    Ok(buffer)
}

fn totals(device: &Device, splats: u32, instances: u32) -> Result<Buffer<Totals>> {
    let totals = Totals { visible_kept: splats, listed_low: instances, listed_kept: instances, ..Totals::zeroed() };
    upload(device, "totals", &[totals])
}

/// Splats in six tiles on average, as at 1080p; each in one row.
fn tile_counts(splats: u32) -> Vec<u32> {
    (0..splats).map(|i| 1 + random(i) % 11).collect()
}

/// Input and output of a scan, and its stages.
struct Scanned {
    totals: Buffer<Totals>,
    identity: Buffer<u32>,
    tile_counts: Buffer<u32>,
    sums: Buffer<u32>,
    dispatches: Buffer<PortableDispatches>,
    offsets: Buffer<u32>,
    first_ranks: Buffer<u32>,
    instances: u32,
    stages: (Stage<ScanSums>, Stage<ScanTotals>, Stage<Scan>),
}

impl Scanned {
    fn new(device: &Device, splats: u32) -> Result<Self> {
        let counts = tile_counts(splats);
        let instances = counts.iter().sum();
        Ok(Self {
            totals: totals(device, splats, instances)?,
            identity: upload(device, "identity", &(0..splats).collect::<Vec<_>>())?,
            tile_counts: upload(device, "tile counts", &counts)?,
            sums: Buffer::new(device, "sums", splats.div_ceil(2048) as usize)?,
            dispatches: Buffer::new(device, "dispatches", 1)?,
            offsets: Buffer::new(device, "offsets", splats as usize)?,
            first_ranks: Buffer::new(device, "first ranks", instances.div_ceil(1024) as usize)?,
            instances,
            stages: (Stage::new(device, &())?, Stage::new(device, &())?, Stage::new(device, &())?),
        })
    }

    fn record(&self, cmd: &mut Commands) {
        let (totals, splat_from_rank, tile_counts) = (&self.totals, &self.identity, &self.tile_counts);
        let groups = || DispatchSize::Groups(self.identity.len().div_ceil(2048) as u64);
        let bindings = ScanSumsBindings { totals, splat_from_rank, tile_counts, sums: &self.sums };
        cmd.dispatch(&self.stages.0, bindings, (), groups());
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        let bindings = ScanTotalsBindings { sums: &self.sums, totals, dispatches: &self.dispatches };
        let push = ScanTotalsPush { instance_capacity: self.instances };
        cmd.dispatch(&self.stages.1, bindings, push, DispatchSize::Groups(1));
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        let (sums, instance_offsets, first_ranks) = (&self.sums, &self.offsets, &self.first_ranks);
        let bindings = ScanBindings { totals, splat_from_rank, tile_counts, sums, instance_offsets, first_ranks };
        cmd.dispatch(&self.stages.2, bindings, (), groups());
    }
}

fn scan(device: &Device, splats: u32) -> Result<Bench<'_>> {
    let scanned = Scanned::new(device, splats)?;
    Ok(Bench {
        stage: "scan",
        input: format!("{splats} splats"),
        bytes: 20 * u64::from(splats),
        record: Box::new(move |cmd| cmd.scope("scan", |cmd| scanned.record(cmd))),
    })
}

fn sort(device: &Device, bits: u32, keys: u32) -> Result<Bench<'_>> {
    let facts = device.capabilities();
    let sort = RadixSort::new(device, facts.subgroup_size[0], facts.subgroup_size[1].div_ceil(32))?;
    let pairs = Pairs::new(device, "sort", keys as usize)?;
    let scratch = SortScratch::new(device, keys as usize)?;
    let lengths = upload(device, "lengths", &[keys])?;
    let [x, y] = DispatchSize::Groups(keys.div_ceil(2048).into()).groups(1);
    let groups = upload(device, "groups", &[x, y, 1])?;
    let mut input = Staging::<u32>::new(device, "unsorted keys", keys as usize)?;
    input.map().iter_mut().zip(0..).for_each(|(key, i)| *key = random(i));
    Ok(Bench {
        stage: "sort",
        input: format!("{keys} keys of {bits} bits"),
        bytes: 20 * u64::from(keys) * u64::from(sort.passes(bits)),
        record: Box::new(move |cmd| {
            // A sort of sorted keys would be a faster one.
            cmd.upload_staged(&input, &pairs.keys[0], keys as usize);
            cmd.fill(&pairs.values[0], 0);
            cmd.barrier(Access::COPY_WRITE, Access::SHADER);
            let range = SortRange { lengths: &lengths, length_index: 0, bits, values_are_indices: false };
            cmd.scope("sort", |cmd| sort.record(cmd, &pairs, &scratch, range, (&groups, 0)));
        }),
    })
}

fn duplicate(device: &Device, splats: u32) -> Result<Bench<'_>> {
    let scanned = Scanned::new(device, splats)?;
    let mut cmd = Commands::new(device)?;
    scanned.record(&mut cmd);
    cmd.submit()?.wait()?;
    let spans: Vec<u32> = tile_counts(splats).iter().map(|count| count << 16).collect();
    let ranges: Vec<[u32; 2]> = (0..splats).map(|i| [i, (random(i) % 45) | (1 << 16)]).collect();
    let (spans, span_ranges) = (upload(device, "spans", &spans)?, upload(device, "span ranges", &ranges)?);
    let instances = scanned.instances;
    let buffer = |name| Buffer::<u32>::new(device, name, instances as usize);
    let (tile_keys, splat_ids) = (buffer("tile keys")?, buffer("splat ids")?);
    let stage = Stage::<Duplicate>::new(device, &())?;
    Ok(Bench {
        stage: "duplicate",
        input: format!("{splats} splats, {instances} instances"),
        bytes: 20 * u64::from(splats) + 8 * u64::from(instances),
        record: Box::new(move |cmd| {
            let bindings = DuplicateBindings {
                totals: &scanned.totals,
                splat_from_rank: &scanned.identity,
                instance_offsets: &scanned.offsets,
                first_ranks: &scanned.first_ranks,
                span_ranges: &span_ranges,
                spans: &spans,
                tile_keys: &tile_keys,
                splat_ids: &splat_ids,
            };
            let groups = DispatchSize::Groups(instances.div_ceil(1024).into());
            cmd.scope("duplicate", |cmd| cmd.dispatch(&stage, bindings, DuplicatePush { tiles_x: 45 }, groups));
        }),
    })
}

fn ranges(device: &Device, instances: u32) -> Result<Bench<'_>> {
    const TILES: u32 = 2025; // of 720x720
    let totals = totals(device, 0, instances)?;
    let keys: Vec<u32> =
        (0..instances).map(|i| (u64::from(i) * u64::from(TILES) / u64::from(instances)) as u32).collect();
    let tile_keys = upload(device, "tile keys", &keys)?;
    let ranges = Buffer::new(device, "ranges", TILES as usize)?;
    let stage = Stage::<Ranges>::new(device, &())?;
    Ok(Bench {
        stage: "ranges",
        input: format!("{instances} instances"),
        bytes: 4 * u64::from(instances) + 8 * u64::from(TILES),
        record: Box::new(move |cmd| {
            let bindings = RangesBindings { totals: &totals, tile_keys: &tile_keys, ranges: &ranges };
            cmd.scope("ranges", |cmd| cmd.dispatch(&stage, bindings, (), DispatchSize::Invocations(instances.into())));
        }),
    })
}

/// Tiles of 720x720, each with a list of splats that cover it, so faint that no pixel ends before the list: every alpha
/// is computed and blended.
fn blend(device: &Device, list: u32) -> Result<Bench<'_>> {
    const SIDE: u32 = 720;
    let (tiles_x, tiles) = (SIDE / TILE, (SIDE / TILE).pow(2));
    let splat = |i: u32| {
        let (tile, unit) = (i / list, |n: u32| random(i * 2 + n) as f32 / u32::MAX as f32);
        let corner = [tile % tiles_x, tile / tiles_x].map(|t| (t * TILE) as f32);
        Splat {
            mean_px: [corner[0] + 16.0 * unit(0), corner[1] + 16.0 * unit(1)],
            factor: [0.001, 0.0, 0.001],
            opacity: 0.0041,
            colour: [unit(0), unit(1), 0.5],
        }
    };
    let count = tiles * list;
    let splats = upload(device, "splats", &(0..count).map(splat).collect::<Vec<_>>())?;
    let splat_ids = upload(device, "splat ids", &(0..count).collect::<Vec<_>>())?;
    let ranges = upload(device, "ranges", &(0..tiles).map(|t| [t * list, (t + 1) * list]).collect::<Vec<_>>())?;
    let mut in_class = Totals::zeroed();
    in_class.tiles_in_class[0] = tiles;
    let totals = upload(device, "totals", &[in_class])?;
    let tiles_by_class = upload(device, "tiles by class", &(0..6 * tiles).collect::<Vec<_>>())?;
    let image = Image::new(device, "image", SIDE, SIDE)?;
    let ballot_words = device.capabilities().subgroup_size[1].div_ceil(32);
    let constants =
        BlendConstants { cull_pixel_blocks: !Options::default().portable, ballot_words, ..BlendConstants::default() };
    let stage = Stage::<Blend>::new(device, &constants)?;
    Ok(Bench {
        stage: "blend",
        input: format!("{tiles} lists of {list}"),
        bytes: u64::from(count) * (4 + size_of::<Splat>() as u64) + 16 * u64::from(SIDE * SIDE),
        record: Box::new(move |cmd| {
            let bindings = BlendBindings {
                ranges: &ranges,
                splat_ids: &splat_ids,
                splats: &splats,
                totals: &totals,
                tiles_by_class: &tiles_by_class,
                image: &image,
            };
            let (size_px, background) = ([SIDE; 2], [0.0; 3]);
            let push =
                BlendPush { size_px, top_px: 0, tiles, background, pass_begin: 0, pass_limit: u32::MAX, last_pass: 1 };
            cmd.scope("blend", |cmd| cmd.dispatch(&stage, bindings, push, DispatchSize::Groups(tiles.into())));
        }),
    })
}
