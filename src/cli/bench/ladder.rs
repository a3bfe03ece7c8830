//! `smalto bench --ladder`: the paper's baseline and every optimization on top of it.

use anyhow::Result;

use super::views::Cameras;
use super::{Args, Loaded, table};
use crate::measure::bench::{Bench, DeviceReport, VersionReport};
use crate::cli::{Usage, complain, progress};
use crate::measure::ladder::{self, LadderReport};
use crate::options::Options;
use crate::render::{GpuScene, tiles};

/// The paper's object at its four levels of detail, and scenes at both ends of tile density.
const SCENES: [&str; 6] =
    ["cactus:139410", "cactus:452000", "cactus:1440000", "cactus:1940000", "few-large", "many-small"];

/// Of a workgroup; its sums loop over them.
const MAX_SUBGROUPS: u32 = 64;

pub(super) fn run(args: &Args, bench: &Bench, cameras: &Cameras) -> Result<()> {
    let (device, size) = (&bench.device, args.size[0]);
    // The paper's duplication walks all tiles of a splat in one invocation, and some devices end loops silently.
    let [columns, rows] = tiles(size);
    let iterations = columns * rows + rows + MAX_SUBGROUPS;
    if device.facts().loop_limit.is_some_and(|limit| iterations > limit) {
        let (name, tiles) = (&device.facts().name, columns * rows);
        return Err(Usage(format!("--ladder: {name} does not walk all {tiles} tiles of such an image")).into());
    }
    let mut climbs = Vec::new();
    for scene in args.scenes(&SCENES) {
        let scene = Loaded::read(&scene, args.reading)?;
        let (views, nearest) = cameras.views(&scene.gaussians, size, args.frames);
        let options = args.knobs.options(&Options::EXACT, scene.is_antialiased, nearest);
        let gpu = GpuScene::with(device, &scene.gaussians, &scene.requirements, &options)?;
        let bar = progress::Bar::new(format!("{} ladder", scene.report.name));
        let climb = ladder::climb(bench, &scene.report, &gpu, &options, &views, &|done| bar.set(done))?;
        drop(bar);
        table::print_climb(&climb)?;
        climbs.push(climb);
    }
    let report = LadderReport {
        format: LadderReport::FORMAT.to_owned(),
        smalto: VersionReport::current(),
        device: DeviceReport::of(device, bench.copy_gb_s),
        warmup: args.warmup,
        frames: args.frames,
        path: cameras.name.clone(),
        climbs,
    };
    table::print_machine(&report.device, &report.smalto, bench.protocol, &report.path)?;
    complain(device)?;
    if let Some(file) = &args.json {
        report.write_json(file)?;
    }
    if let Some(file) = &args.csv {
        report.write_csv(file)?;
    }
    args.plot.as_ref().map_or(Ok(()), |file| ladder::plot(&report, file))
}
