//! `smalto bench --ladder`: the paper's baseline and every optimization on top of it.

use anyhow::Result;

use super::views::Cameras;
use super::{Args, Loaded, table};
use crate::bench::{DeviceReport, VersionReport};
use crate::cli::{Usage, complain, progress};
use crate::gpu::Device;
use crate::ladder::{self, LadderReport};
use crate::options::{Options, TILE};

/// The paper's object at its four levels of detail, and scenes at both ends of tile density.
const SCENES: [&str; 6] =
    ["cactus:139410", "cactus:452000", "cactus:1440000", "cactus:1940000", "few-large", "many-small"];

/// The single-pass duplication walks a splat's tiles in one loop, and some devices end loops beyond this.
const MAX_TILES: u32 = 65_535;

pub(super) fn run(args: &Args, device: &Device, cameras: &Cameras, copy_gb_s: f64) -> Result<()> {
    let size = args.size[0];
    if size.iter().map(|side| u64::from(side.div_ceil(TILE))).product::<u64>() > MAX_TILES.into() {
        return Err(Usage(format!("--ladder measures images of up to {MAX_TILES} tiles of {TILE}x{TILE}")).into());
    }
    let mut climbs = Vec::new();
    for scene in args.scenes(&SCENES) {
        let scene = Loaded::read(device, &scene)?;
        let (views, near) = cameras.views(&scene.gaussians, size, args.frames);
        let options = Options { near: args.near.unwrap_or(near), ..Options::default() };
        let bar = progress::Bar::new(format!("{} ladder", scene.report.name));
        let measured = (&scene.report, &scene.gpu);
        let climb = ladder::climb(device, measured, &options, &views, args.protocol(), &|done| bar.set(done))?;
        drop(bar);
        table::print_climb(&climb)?;
        climbs.push(climb);
    }
    let report = LadderReport {
        format: LadderReport::FORMAT.to_owned(),
        smalto: VersionReport::current(),
        device: DeviceReport::of(device, copy_gb_s),
        warmup: args.warmup,
        frames: args.frames,
        path: cameras.name.clone(),
        climbs,
    };
    table::print_machine(&report.device, &report.smalto, args.protocol(), &report.path)?;
    complain(device)?;
    if let Some(file) = &args.json {
        report.write_json(file)?;
    }
    if let Some(file) = &args.csv {
        report.write_csv(file)?;
    }
    args.plot.as_ref().map_or(Ok(()), |file| ladder::plot(&report, file))
}
