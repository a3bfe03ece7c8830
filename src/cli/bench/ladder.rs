//! `smalto bench --ladder`: the paper's baseline and every optimization on top of it, up to the portable path.

use anyhow::Result;

use super::views::Cameras;
use super::{Args, Loaded, table};
use crate::cli::{Usage, complain, progress};
use crate::measure::bench::{Bench, DeviceReport, VersionReport};
use crate::measure::ladder::{self, LadderReport};
use crate::options::Options;
use crate::render::{GpuScene, tiles};

/// Default scenes: the paper's object at its four levels of detail, and two scenes with few and many splats per tile.
const SCENES: [&str; 6] =
    ["cactus:139410", "cactus:452000", "cactus:1440000", "cactus:1940000", "few-large", "many-small"];

/// Most subgroups of a workgroup; sums over a workgroup loop over them.
const MAX_SUBGROUPS: u32 = 64;

pub(super) fn run(args: &Args, bench: &Bench, cameras: &Cameras) -> Result<()> {
    let (device, size) = (&bench.device, args.size[0]);
    // In the paper's duplication one invocation walks all tiles of a splat, and some devices end long loops silently.
    let [columns, rows] = tiles(size);
    let iterations = columns * rows + rows + MAX_SUBGROUPS;
    if device.capabilities().loop_limit.is_some_and(|limit| iterations > limit) {
        let (name, tiles) = (&device.capabilities().name, columns * rows);
        let problem = format!("--ladder: {name} limits loops to fewer iterations than {tiles} tiles need");
        return Err(Usage(problem).into());
    }
    let mut climbs = Vec::new();
    for scene in args.scenes(&SCENES) {
        let scene = Loaded::read(&scene, args.reading, None, device)?;
        let drawable = &scene.drawable;
        let (views, nearest) = cameras.views((&|| drawable.source.focus(), scene.town), size, args.frames())?;
        let options = args.knobs.options(&Options::EXACT, drawable.is_antialiased, nearest);
        let (gaussians, statistics) = drawable.in_memory("--ladder")?;
        let gpu = GpuScene::with(device, gaussians, statistics, &options)?;
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
        frames: args.frames(),
        path: cameras.name.clone(),
        climbs,
    };
    table::print_machine(&report.device, &report.smalto, bench.protocol, &report.path)?;
    complain(device)?;
    if let Some(sink) = &args.json {
        sink.write_json(&report)?;
    }
    if let Some(sink) = &args.csv {
        sink.write(|out| report.write_csv(out))?;
    }
    #[cfg(feature = "plots")]
    if let Some(file) = &args.plot {
        ladder::plot(&report, file)?;
    }
    Ok(())
}
