//! The ladder of optimizations that this renderer started from: the paper's baseline, and each step from it to the
//! portable path, measured on the same scenes: `cargo bench --bench ladder -- --help`.
//!
//! A rung is one step ahead of the rung it is compared with. The bench fails if two rungs that must agree count or draw
//! differently.
//!
//! - `rungs` - the table of the rungs
//! - `variant` - the frame of one rung, from the stages of the portable path and those of `glsl/ladder`
//! - `host_stages` - the stages that the baseline runs on the CPU
//! - `steps` - a frame that waits for the CPU between stages, and its times
//! - `climb` - measures all rungs on one scene and compares their pictures
//! - `report`, `table`, `plot` - the results as JSON and CSV, on the terminal, as SVG

pub mod climb;
pub mod host_stages;
#[cfg(feature = "plots")]
mod plot;
pub mod report;
pub mod rungs;
mod steps;
mod table;
pub mod variant;

use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result, anyhow, bail, ensure};
use clap::Parser;
use glam::DVec3;
use smalto::camera::{self, Camera};
use smalto::cli::environment::Environment;
use smalto::formats;
use smalto::gpu::{Device, Validation};
use smalto::measure::bench::{Bench, DeviceReport, Protocol, SceneReport, VersionReport};
use smalto::options::Options;
use smalto::procedural::Procedural;
use smalto::render::GpuScene;
use smalto::scene::{Focus, Scene};

use report::LadderReport;
use variant::tiles;

/// Measure the paper's baseline and every optimization on top of it, up to the portable path. SMALTO_DEVICE chooses the
/// device
#[derive(Parser)]
#[command(name = "cargo bench --bench ladder --", version)]
struct Args {
    /// Scene files or procedural scenes [default: cactus at four levels of detail, few-large and many-small]
    scenes: Vec<PathBuf>,
    /// Camera file or folder: each frame is drawn from the next of its cameras
    #[arg(long, value_name = "FILE|DIR", conflicts_with = "path")]
    cameras: Option<PathBuf>,
    /// Camera path: one turn around the scene, or the same with two approaches to it
    #[arg(long, value_name = "NAME", default_value = "orbit-zoom", value_parser = ["orbit", "orbit-zoom"])]
    path: String,
    /// Picture size in pixels
    #[arg(long, value_name = "WxH", default_value = "720x720", value_parser = parse_size)]
    size: [u32; 2],
    /// Least number of warm-up frames; 0: no warm-up
    #[arg(long, value_name = "N", default_value_t = 30)]
    warmup: usize,
    /// Measured frames of every rung [default: 100, or fewer so that they take at most about 10 s]
    #[arg(long, value_name = "N")]
    frames: Option<usize>,
    /// Distance of the near plane in world units [default: the preset's, or less for a small scene]
    #[arg(long, value_name = "DISTANCE")]
    near: Option<f32>,
    /// Write the report as JSON (docs/schemas/ladder.schema.json)
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the times as CSV
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Plot the times as SVG
    #[cfg(feature = "plots")]
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Print the schema of the report and measure nothing
    #[arg(long)]
    schema: bool,
}

/// Default scenes: the paper's object at its four levels of detail, and two scenes with few and many splats per tile.
const SCENES: [&str; 6] =
    ["cactus:139410", "cactus:452000", "cactus:1440000", "cactus:1940000", "few-large", "many-small"];

/// Measured frames of every rung, and the time for them on slow devices.
const FRAMES: usize = 100;
const PATIENCE: Duration = Duration::from_secs(10);

/// Most subgroups of a workgroup; sums over a workgroup loop over them.
const MAX_SUBGROUPS: u32 = 64;

#[cfg_attr(test, allow(dead_code))] // tests call `run`
fn main() -> Result<()> {
    // Cargo adds `--bench` to the arguments of benches.
    run(std::env::args().filter(|argument| argument != "--bench"))
}

/// Measures by command line arguments; the first is the name of the program.
///
/// # Errors
/// If an argument is wrong, a file cannot be read or written, rungs that must agree differ, or rendering fails.
pub fn run(arguments: impl Iterator<Item = String>) -> Result<()> {
    let args = Args::parse_from(arguments);
    if args.schema {
        println!("{:#}", schemars::schema_for!(LadderReport).as_value());
        return Ok(());
    }
    let environment = Environment::read()?;
    let device = Device::open(&environment.device, environment.validation.unwrap_or(Validation::Off))?;
    check_loops(&device, args.size)?;
    let frames = args.frames.unwrap_or(FRAMES).max(1);
    let bench = Bench::new(&device, Protocol { warmup: args.warmup, frames })?;
    let bench = if args.frames.is_some() { bench } else { bench.patient(PATIENCE) };
    let cameras = args.cameras.as_deref().map(|file| read_cameras(file, args.size)).transpose()?;
    let mut climbs = Vec::new();
    let scenes: Vec<_> = if args.scenes.is_empty() { SCENES.map(PathBuf::from).into() } else { args.scenes.clone() };
    for path in scenes {
        let Scene { gaussians, is_antialiased, .. } = read(&path)?;
        ensure!(!gaussians.is_empty(), "{}: the scene has no Gaussians", path.display());
        let (views, nearest) = match &cameras {
            Some(cameras) => (cameras[..frames.min(cameras.len())].to_vec(), f32::INFINITY),
            None => {
                let focus = Focus::of(&gaussians);
                let (centre, zooms) = (DVec3::from(focus.centre), args.path == "orbit-zoom");
                let views = camera::path::orbit(centre, focus.radius, zooms, args.size, frames);
                (views, focus.radius as f32 / 100.0)
            }
        };
        let mut options = Options::EXACT;
        options.rules.near = args.near.unwrap_or(options.rules.near.min(nearest));
        options.rules.antialiased = is_antialiased;
        let gpu = GpuScene::new(&device, &gaussians, &options)?;
        let scene = SceneReport::of(name(&path), &gaussians);
        let climb = climb::climb(&bench, &scene, &gpu, &options, &views)?;
        print!("{}", table::of(&climb));
        climbs.push(climb);
    }
    let path = args.cameras.as_deref().map_or(args.path.clone(), name);
    let report = LadderReport {
        format: LadderReport::FORMAT.to_owned(),
        smalto: VersionReport::current(),
        device: DeviceReport::of(&device, bench.copy_gb_s),
        warmup: args.warmup,
        frames,
        path,
        climbs,
    };
    print!("{}", table::conditions(&report));
    let messages = device.validation_messages();
    ensure!(messages.is_empty(), "validation: {}", messages.join("\n"));
    write(&args, &report)
}

fn write(args: &Args, report: &LadderReport) -> Result<()> {
    let create = |file: &PathBuf| File::create(file).with_context(|| format!("cannot write {}", file.display()));
    if let Some(file) = &args.json {
        serde_json::to_writer_pretty(create(file)?, report)?;
    }
    if let Some(file) = &args.csv {
        report.write_csv(create(file)?)?;
    }
    #[cfg(feature = "plots")]
    if let Some(file) = &args.plot {
        plot::plot(report, file)?;
    }
    Ok(())
}

/// Fails if the device ends the loops of the ladder early: in the paper's duplication one invocation walks all tiles of
/// a splat, and some devices end long loops silently.
fn check_loops(device: &Device, size: [u32; 2]) -> Result<()> {
    let [columns, rows] = tiles(size);
    let iterations = columns * rows + rows + MAX_SUBGROUPS;
    if device.capabilities().loop_limit.is_some_and(|limit| iterations > limit) {
        let (name, tiles) = (&device.capabilities().name, columns * rows);
        bail!("{name} limits loops to fewer iterations than {tiles} tiles need");
    }
    Ok(())
}

/// Reads a scene file, or makes a procedural scene.
fn read(path: &Path) -> Result<Scene> {
    match path.to_str().and_then(Procedural::parse) {
        Some(procedural) => Ok(procedural?.make()?),
        None => formats::read(path),
    }
}

fn read_cameras(file: &Path, size: [u32; 2]) -> Result<Vec<Camera>> {
    let read = camera::read_at(file, Some(size)).with_context(|| file.display().to_string())?;
    Ok(read.cameras.into_iter().map(|named| named.camera.resized(size)).collect())
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Parses `WIDTHxHEIGHT` in pixels.
fn parse_size(text: &str) -> Result<[u32; 2]> {
    let sides = text.split_once('x').and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]));
    sides
        .filter(|size: &[u32; 2]| size.iter().all(|side| (1..=camera::MAX_SIDE).contains(side)))
        .ok_or_else(|| anyhow!("expected WIDTHxHEIGHT in pixels, like 1280x720"))
}
