//! `smalto bench`: how fast a scene is drawn, stage by stage.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context, Result, bail, ensure};
use clap::builder::PossibleValuesParser;
use glam::DVec3;

use super::{DeviceArgs, SceneArg, Usage, bench_table, parse_size, progress, read_cameras, remark, size_text};
use crate::bench::{self, DeviceReport, Protocol, Report, SceneReport, VersionReport};
use crate::camera::{Camera, path};
use crate::gpu::Device;
use crate::metrics::psnr;
use crate::options::{Background, Options};
use crate::reference;
use crate::render::{GpuScene, Still};
use crate::scene::{Focus, Gaussians, Unreadable};

/// Measure how fast scenes are drawn: whole frames, every stage, counts, memory
#[derive(clap::Args)]
pub(super) struct Args {
    /// Scenes, as `smalto render` takes them [default: cactus]
    scenes: Vec<PathBuf>,
    /// Camera file of the original 3DGS: frame after frame from its cameras
    #[arg(long, value_name = "FILE", conflicts_with = "path")]
    cameras: Option<PathBuf>,
    /// Where the camera moves: one turn around the scene (orbit), the same nearing and leaving twice (orbit-zoom), or
    /// smoothly through the cameras of a file
    #[arg(long, value_name = "orbit|orbit-zoom|keyframes:FILE", default_value = "orbit-zoom")]
    path: CameraPath,
    /// Picture sizes in pixels
    #[arg(long, value_name = "WxH,...", default_value = "720x720", value_delimiter = ',', value_parser = parse_size)]
    size: Vec<[u32; 2]>,
    /// Frames before the measured ones
    #[arg(long, value_name = "N", default_value_t = 30)]
    warmup: usize,
    /// Measured frames
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..))]
    frames: usize,
    /// Choices of quality and speed to measure
    #[arg(long, value_name = "NAME,...", default_value = "default", value_delimiter = ',', value_parser = preset_names())]
    preset: Vec<String>,
    /// Distance of the near plane in world units [default: 0.2, less where an orbit around a small scene needs it]
    #[arg(long, value_name = "DISTANCE")]
    near: Option<f32>,
    /// Also compare the first view with the float64 reference. Slow
    #[arg(long)]
    check: bool,
    #[command(flatten)]
    device: DeviceArgs,
    /// Write the report as JSON (docs/bench.schema.json)
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the report's statistics as CSV
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Draw where the time goes, as SVG
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Compare with an earlier report; exit code 6 if a frame takes longer than --threshold allows
    #[arg(long, value_name = "FILE")]
    baseline: Option<PathBuf>,
    /// How much longer than in the baseline a frame may take, in percent
    #[arg(long, value_name = "PERCENT", default_value_t = 5.0)]
    threshold: f64,
}

fn preset_names() -> PossibleValuesParser {
    PossibleValuesParser::new(Options::PRESETS.map(|(name, _)| name))
}

/// A camera path by name.
#[derive(Clone, Debug, PartialEq)]
enum CameraPath {
    Orbit { zooms: bool },
    Keyframes(PathBuf),
}

impl FromStr for CameraPath {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        match text {
            "orbit" => Ok(Self::Orbit { zooms: false }),
            "orbit-zoom" => Ok(Self::Orbit { zooms: true }),
            _ => match text.strip_prefix("keyframes:") {
                Some(file) if !file.is_empty() => Ok(Self::Keyframes(file.into())),
                _ => bail!("expected orbit, orbit-zoom or keyframes:FILE"),
            },
        }
    }
}

/// The frames of a run became slower than the baseline allows.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(super) struct Regression(String);

pub(super) fn run(args: &Args) -> Result<()> {
    check_usage(args)?;
    let device = args.device.open()?;
    // Whatever the files lack is known before anything is measured.
    let baseline = args.baseline.as_deref().map(read_baseline).transpose()?;
    let cameras = Cameras::read(args)?;
    let copy_gb_s = bench::copy_gb_s(&device)?;
    let protocol = Protocol { warmup: args.warmup, frames: args.frames };
    let mut runs = Vec::new();
    let default = vec![PathBuf::from("cactus")];
    for scene in if args.scenes.is_empty() { &default } else { &args.scenes } {
        let scene = SceneArg { scene: scene.clone() };
        let gaussians = scene.read()?.gaussians;
        ensure!(!gaussians.is_empty(), "{}: there is nothing to draw", scene.title());
        let (report, gpu_scene) = (SceneReport::of(scene.title(), &gaussians), GpuScene::new(&device, &gaussians)?);
        for (preset, size) in args.preset.iter().flat_map(|p| args.size.iter().map(move |s| (p, *s))) {
            let (views, near) = cameras.views(&gaussians, size, args.frames);
            let options = Options::preset(preset).context("clap lets known presets pass alone")?;
            let options = Options { near: args.near.unwrap_or(near), ..options };
            let bar = progress::Bar::new(format!("{} {} {preset}", report.name, size_text(size)));
            let measured = (&report, &gpu_scene);
            let mut run = bench::measure(&device, measured, (preset, &options), &views, protocol, copy_gb_s, &|done| {
                bar.set(done);
            })?;
            drop(bar);
            if args.check {
                run.psnr_db = Some(accuracy(&device, &gaussians, &gpu_scene, &views[0], &options)?);
            }
            bench_table::print_run(&run)?;
            runs.push(run);
        }
    }
    let report = Report {
        format: bench::FORMAT.to_owned(),
        smalto: VersionReport::current(),
        device: DeviceReport::of(&device, copy_gb_s),
        warmup: args.warmup,
        frames: args.frames,
        path: cameras.name,
        runs,
    };
    bench_table::print_machine(&report)?;
    super::complain(&device)?;
    write(args, &report)?;
    baseline.map_or(Ok(()), |before| compare(&before, &report, args.threshold / 100.0))
}

fn check_usage(args: &Args) -> Result<()> {
    if let Some(near) = args.near.filter(|near| !(near.is_finite() && *near > 0.0)) {
        return Err(Usage(format!("--near {near} is not a distance ahead of the camera")).into());
    }
    if !(args.threshold >= 0.0 && args.threshold.is_finite()) {
        return Err(Usage(format!("--threshold {} is not a percentage from 0 on", args.threshold)).into());
    }
    Ok(())
}

fn read_baseline(file: &Path) -> Result<Report> {
    Report::read(file).map_err(|problem| Unreadable::new(file, &problem).into())
}

/// Where the views come from.
struct Cameras {
    /// As the report calls it.
    name: String,
    source: Source,
}

enum Source {
    Orbit { zooms: bool },
    File(Vec<Camera>),
    Keyframes(Vec<Camera>),
}

impl Cameras {
    fn read(args: &Args) -> Result<Self> {
        let name = |file: &Path| file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let read = |file: &Path| Ok::<_, anyhow::Error>(read_cameras(file)?.into_iter().map(|c| c.camera).collect());
        Ok(match (&args.cameras, &args.path) {
            (Some(file), _) => Self { name: name(file), source: Source::File(read(file)?) },
            (None, CameraPath::Keyframes(file)) => {
                Self { name: format!("keyframes:{}", name(file)), source: Source::Keyframes(read(file)?) }
            }
            (None, CameraPath::Orbit { zooms }) => {
                let name = if *zooms { "orbit-zoom" } else { "orbit" };
                Self { name: name.to_owned(), source: Source::Orbit { zooms: *zooms } }
            }
        })
    }

    /// The views at this size, at most `frames`, and where the near plane is.
    fn views(&self, gaussians: &Gaussians, size: [u32; 2], frames: usize) -> (Vec<Camera>, f32) {
        let resized = |cameras: &[Camera]| cameras.iter().map(|c| c.resized(size)).collect::<Vec<_>>();
        let near = Options::default().near;
        match &self.source {
            Source::File(cameras) => (resized(&cameras[..frames.min(cameras.len())]), near),
            Source::Keyframes(cameras) => (path::through(&resized(cameras), frames), near),
            Source::Orbit { zooms } => {
                let focus = Focus::of(gaussians);
                let views = path::orbit(DVec3::from(focus.centre), focus.radius, *zooms, size, frames);
                (views, near.min(focus.radius as f32 / 100.0))
            }
        }
    }
}

/// PSNR of a view against the f64 reference in dB.
fn accuracy(
    device: &Device,
    gaussians: &Gaussians,
    scene: &GpuScene,
    view: &Camera,
    options: &Options,
) -> Result<f64> {
    let mut still = Still::new(device, options, scene)?;
    still.render(view, Background::BLACK)?;
    let exact = reference::render(gaussians, view, options, Background::BLACK).to_pixels();
    Ok(psnr(&still.pixels()?, &exact))
}

fn write(args: &Args, report: &Report) -> Result<()> {
    if let Some(file) = &args.json {
        report.write_json(file)?;
    }
    if let Some(file) = &args.csv {
        report.write_csv(file)?;
    }
    if let Some(file) = &args.plot {
        bench::plot::stage_breakdown(report, file)?;
    }
    Ok(())
}

fn compare(before: &Report, now: &Report, threshold: f64) -> Result<()> {
    let changes = bench::compare(before, now).map_err(|foreign| Usage(format!("--baseline: {foreign}")))?;
    bench_table::print_changes(&changes)?;
    for change in changes.iter().filter(|change| change.picture_differs) {
        remark(&format!("note: {}: the picture is not the baseline's", change.title));
    }
    let slower: Vec<_> = changes.iter().filter(|c| c.is_regression(threshold)).map(|c| c.title.clone()).collect();
    if slower.is_empty() {
        return Ok(());
    }
    Err(Regression(format!("slower than the baseline by more than {} %: {}", threshold * 100.0, slower.join(", "))).into())
}
