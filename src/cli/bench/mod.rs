//! `smalto bench`: the speed of frames and their stages.
//!
//! - `views` - cameras of a file or a path
//! - `table` - tables on the terminal

mod table;
mod views;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};

use crate::camera::Camera;
use crate::cli::cameras::{EyeArgs, LensArgs, SplitArg};
use crate::cli::devices::{DevicesArgs, SHARE_NEEDS_SEVERAL, say_memory};
use crate::cli::drawable::{Drawable, read_places};
use crate::cli::headings::{ACCURACY, CAMERAS, DEVICE, LEVELS, MEASURING, REPORTS};
use crate::cli::knobs::Knobs;
use crate::cli::levels::{Measurement, parse_measurement};
use crate::cli::scenes::{ReadingArgs, SceneArg};
use crate::cli::sink::Sink;
use crate::cli::values::whole;
use crate::cli::{OverThreshold, Usage, check_plots, complain, knobs, one_of, progress, remark, values};
use crate::files::check_writable;
use crate::gpu::Device;
use crate::measure::bench::{
    self, Bench, Change, DetailReport, DeviceReport, Protocol, Report, SceneReport, Statistics, Subject, VersionReport,
};
use crate::measure::metrics::psnr;
use crate::options::Options;
use crate::procedural::Procedural;
use crate::reference;
use crate::render::{GpuScene, Renderer, Upload};
use crate::rules::{Background, Rules};
use crate::scene::{Gaussians, SceneInstances, Unreadable};
pub(super) use views::{CameraPath, Cameras};

/// Measure the speed of rendering: whole frames, every stage, counts, memory
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  smalto bench plush.spz --cameras cameras.json --size 720x720,1920x1080
  smalto bench cactus --preset exact,balanced,fast,preview
  smalto bench town:3M --path street
  smalto bench cactus few-large --json now.json --plot now.svg
  smalto bench cactus few-large --baseline now.json --threshold 3")]
pub(super) struct Args {
    /// Scenes, as `smalto render` takes them [default: cactus]
    scenes: Vec<PathBuf>,
    /// Camera file or folder: each frame is drawn from its next camera
    #[arg(long, help_heading = CAMERAS, value_name = "FILE|DIR", conflicts_with = "path")]
    cameras: Option<PathBuf>,
    #[command(flatten)]
    split: SplitArg,
    /// orbit, orbit-zoom, turn, street, roof, air, FILE
    ///
    /// One turn around the scene (orbit), the same with two approaches to it (orbit-zoom), one turn on the spot in the
    /// middle of the scene (turn), or a smooth path through the cameras of a file. In the town: along streets, one turn
    /// on a roof, over the houses.
    #[arg(long, help_heading = CAMERAS, value_name = "PATH", default_value = "orbit-zoom", conflicts_with = "eye")]
    path: CameraPath,
    #[command(flatten)]
    eye: EyeArgs,
    #[command(flatten)]
    lens: LensArgs,
    /// Draw the scene at every place of a list (docs/side-files.md)
    ///
    /// The list is JSON like {"places": [{"position": [0, 0, 5], "rotation": [1, 0, 0, 0], "scale": 2}]}. All places
    /// share the memory of one. Only the fast path draws them.
    #[arg(long, help_heading = CAMERAS, value_name = "FILE")]
    place: Option<PathBuf>,
    /// Picture sizes in pixels
    #[arg(long, help_heading = MEASURING, value_name = "WxH,...", default_value = "720x720", value_delimiter = ',')]
    #[arg(value_parser = values::size)]
    size: Vec<[u32; 2]>,
    /// Least number of warm-up frames; 0: no warm-up
    ///
    /// The warm-up goes on until the frame time is steady: the median GPU times of two consecutive windows of a second
    /// agree within 2 %, or after 10 s, with a warning (docs/commands.md).
    #[arg(long, help_heading = MEASURING, value_name = "N", default_value_t = 30)]
    #[arg(value_parser = whole::<usize>(0..=MOST_FRAMES))]
    warmup: usize,
    /// Measured frames of each kind [default: 100, or as many as 10 s allow]
    #[arg(long, help_heading = MEASURING, value_name = "N", value_parser = whole::<usize>(1..=MOST_FRAMES))]
    frames: Option<usize>,
    /// Also compare the first view with the float64 reference. Slow
    #[arg(long, help_heading = MEASURING, conflicts_with = "place")]
    check: bool,
    /// Also bound the error of every pixel of every view
    ///
    /// The certificate bounds the difference of each value from a picture that leaves nothing out. Storage on the GPU
    /// and the order of splats are taken as they are.
    #[arg(long, help_heading = MEASURING, conflicts_with = "place")]
    certificate: bool,
    /// Compare with an earlier report; exit code 6 if a frame is slower
    #[arg(long, help_heading = MEASURING, value_name = "FILE")]
    baseline: Option<PathBuf>,
    /// Largest increase of the frame time, in percent
    #[arg(long, help_heading = MEASURING, value_name = "PERCENT", default_value_t = 5.0)]
    #[arg(value_parser = values::number(0.0..=1e6))]
    threshold: f64,
    /// Presets, like exact,balanced,fast,preview
    ///
    /// exact, balanced, fast, preview: accuracy for speed. inria, gsplat, khr: exactly by the rules of another
    /// renderer. portable: balanced by the stages that run on every device.
    #[arg(long, help_heading = ACCURACY, value_name = "NAME,...", default_value = "balanced", value_delimiter = ',')]
    #[arg(value_parser = knobs::preset_names(), hide_possible_values = true)]
    preset: Vec<String>,
    #[command(flatten)]
    knobs: Knobs,
    /// Measure the PSNR of levels of detail; =sample estimates it
    ///
    /// The PSNR is that of the picture by levels of detail against the one of all Gaussians. Without a value, every
    /// picture is drawn with all Gaussians, too. =sample draws about 64 patches of 64x64 pixels with all Gaussians, and
    /// =sample:N about N; the PSNR is then an estimate with a standard error.
    #[arg(long, help_heading = LEVELS, value_name = "sample[:N]")]
    #[arg(value_parser = parse_measurement, num_args = 0..=1, require_equals = true, default_missing_value = "whole")]
    measure_levels: Option<Measurement>,
    #[command(flatten)]
    reading: ReadingArgs,
    #[command(flatten)]
    device: DevicesArgs,
    /// What several devices share at the end: views or frame
    ///
    /// views: each draws whole pictures, and the speed of all together is measured. frame: all draw bands of each
    /// picture, and the time until its last pixel is in host memory is measured, with the band, the stages, the wait
    /// and the transfer of each device.
    #[arg(long, help_heading = DEVICE, value_name = "HOW", default_value = "views", hide_possible_values = true)]
    #[arg(value_parser = one_of(SHARES))]
    share: Share,
    /// Write the report as JSON; - prints it instead of the tables
    ///
    /// Schema: docs/schemas/bench.schema.json.
    #[arg(long, help_heading = REPORTS, value_name = "FILE|-")]
    json: Option<Sink>,
    /// Write the report's statistics as CSV; - prints them instead of the tables
    #[arg(long, help_heading = REPORTS, value_name = "FILE|-")]
    csv: Option<Sink>,
    /// Plot the time of every stage as SVG
    #[arg(long, help_heading = REPORTS, value_name = "FILE")]
    plot: Option<PathBuf>,
}

/// What several devices share in the last measurement.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Share {
    Views,
    Frame,
}

const SHARES: [(&str, &str, Share); 2] = [
    ("views", "Each device draws whole pictures", Share::Views),
    ("frame", "All devices draw bands of each picture", Share::Frame),
];

/// Most frames of each kind.
const MOST_FRAMES: u64 = 1_000_000;

/// Measured frames of each kind, and the time for them on slow devices.
const FRAMES: usize = 100;
const PATIENCE: Duration = Duration::from_secs(10);

pub(super) fn run(args: &Args) -> Result<()> {
    check_usage(args)?;
    // Files that cannot be written are reported before anything is measured.
    [&args.json, &args.csv].into_iter().flatten().try_for_each(Sink::check)?;
    args.plot.as_deref().map_or(Ok(()), check_writable)?;
    let devices = args.device.open(usize::MAX)?;
    let device = devices[0].clone();
    if args.share == Share::Frame && devices.len() == 1 {
        remark(SHARE_NEEDS_SEVERAL);
    }
    let baseline = args.baseline.as_deref().map(read_baseline).transpose()?;
    let lens = &args.lens;
    let cameras = match &args.cameras {
        _ if args.eye.is_given()? => Cameras::at(args.eye, &args.split, lens)?,
        Some(file) => Cameras::of_file(file, args.split.read(file, Some(args.size[0]), lens)?),
        None => Cameras::along(&args.split, &args.path, args.size[0], lens)?,
    };
    let bench = Bench::new(&device, Protocol { warmup: args.warmup, frames: args.frames() })?;
    let bench = if args.frames.is_some() { bench } else { bench.patient(PATIENCE) };
    let mut report = Report {
        format: Report::FORMAT.to_owned(),
        smalto: VersionReport::current(),
        device: DeviceReport::of(&device, bench.copy_gb_s),
        warmup: args.warmup,
        frames: args.frames(),
        path: cameras.name.clone(),
        runs: Vec::new(),
    };
    let instances = read_places(args.place.as_deref())?;
    let mut changes = Vec::new();
    if let Some(baseline) = &baseline {
        baseline.same_conditions(&report).map_err(other_conditions)?;
    }
    for scene in args.scenes() {
        let scene = Loaded::read(&scene, args, instances.clone(), &device)?;
        let checked = args.check.then(|| scene.drawable.in_memory("--check")).transpose()?;
        for (preset, size) in args.preset.iter().flat_map(|p| args.size.iter().map(move |s| (p, *s))) {
            let (views, nearest) =
                cameras.views((&|| scene.drawable.source.focus(), scene.town), size, args.frames())?;
            let options = Options::preset(preset).context("the preset is unknown")?;
            let rules = args.knobs.options(&options.untraded(), scene.drawable.source.is_antialiased, nearest).rules;
            let options = args.knobs.options(&options, scene.drawable.source.is_antialiased, nearest);
            if let Some(why) = options.uncertifiable().filter(|_| args.certificate) {
                return Err(Usage(format!("--certificate: {why}")).into());
            }
            let gpu = scene.drawable.source.upload_with(&device, &options, Upload::reserving(reserve(size)))?;
            let subject = Subject::new(&scene.report, preset, &options, &views);
            let before = baseline.as_ref().map(|b| b.run_of(&subject)).transpose().map_err(other_conditions)?;
            let bar = progress::Bar::new(subject.title());
            let mut run = bench.measure(subject, &gpu, &options, &views, &|done| bar.set(done))?;
            drop(bar);
            if let Some(notice) = &run.notice {
                remark(&format!("note: {}: {notice}", run.subject.title()));
            }
            if let Some((gaussians, _)) = checked {
                run.psnr_db = accuracy(&device, (gaussians, &gpu), &views[0], (&options, &rules))?;
            }
            if args.certificate {
                run.certified_error = Some(certified_error(&device, &scene, &views, &options)?);
            }
            if let (Some(detail), Some(measurement)) = (&mut run.detail, args.measure_levels) {
                measure_levels(measurement, Renderer::new(&device, &options, &gpu)?, &views, detail)?;
            }
            if devices.len() > 1 {
                let bring = |device: &Device| {
                    scene.drawable.source.upload_with(device, &options, Upload::reserving(reserve(size)))
                };
                let whole = views.iter().find_map(|view| Renderer::whole_because(&options, view));
                if let Some(why) = whole.filter(|_| args.share == Share::Frame) {
                    remark(&format!("note: --share frame: {why}; each device draws its own"));
                }
                if args.share == Share::Frame && whole.is_none() {
                    run.split = Some(bench::split(&devices, &bring, &options, &views, args.frames())?);
                } else {
                    run.together = Some(bench::together(&devices, &bring, &options, &views)?);
                }
            }
            table::print_run(&run, args.check)?;
            changes.extend(before.map(|before| Change::between(before, &run)));
            report.runs.push(run);
        }
    }
    table::print_machine(&report.device, &report.smalto, bench.protocol, &report.path)?;
    devices.iter().try_for_each(say_memory)?;
    devices.iter().try_for_each(complain)?;
    write(args, &report)?;
    baseline.map_or(Ok(()), |baseline| judge(&changes, baseline.runs.len(), args.threshold))
}

impl Args {
    /// The most frames of each kind.
    fn frames(&self) -> usize {
        self.frames.unwrap_or(FRAMES)
    }

    /// The scenes of the arguments, or the default if there are none.
    fn scenes(&self) -> Vec<PathBuf> {
        if self.scenes.is_empty() { vec!["cactus".into()] } else { self.scenes.clone() }
    }
}

/// A scene and its entry in the report.
struct Loaded {
    report: SceneReport,
    drawable: Drawable,
    /// The scene, if it is a town.
    town: Option<Procedural>,
}

impl Loaded {
    fn read(path: &Path, args: &Args, instances: Option<SceneInstances>, device: &Device) -> Result<Self> {
        let scene = SceneArg { scene: path.to_owned(), reading: args.reading };
        let drawable = Drawable::read(&scene, args.knobs.wants_levels(), Some(device))?.placed(instances);
        let report = drawable.report();
        ensure!(report.gaussians > 0, "{}: the scene has no Gaussians", scene.title());
        Ok(Self { report, drawable, town: scene.town()? })
    }
}

fn check_usage(args: &Args) -> Result<()> {
    args.knobs.check_gpu()?;
    check_plots(args.plot.as_deref())?;
    Ok(())
}

fn read_baseline(file: &Path) -> Result<Report> {
    Report::read(file).map_err(|problem| Unreadable::new(file, &problem).into())
}

/// PSNR of a view against the float64 reference in dB; `None` if both are equal.
fn accuracy(
    device: &Device,
    (gaussians, scene): (&Gaussians, &GpuScene),
    view: &Camera,
    (options, rules): (&Options, &Rules),
) -> Result<Option<f64>> {
    let mut renderer = Renderer::new(device, options, scene)?;
    renderer.render(view, Background::BLACK)?;
    let exact = reference::render(gaussians, view, rules, Background::BLACK).to_pixels();
    Ok(Some(psnr(&renderer.pixels()?, &exact)).filter(|db| db.is_finite()))
}

/// Measures the PSNR of the pictures of views by levels of detail.
fn measure_levels(
    measurement: Measurement,
    mut renderer: Renderer,
    views: &[Camera],
    report: &mut DetailReport,
) -> Result<()> {
    let (mut measured, mut times) = (Vec::new(), Vec::new());
    for view in views {
        let frame = renderer.render(view, Background::BLACK)?;
        let pixels = renderer.pixels()?;
        let Some(detail) = frame.detail else { continue };
        let started = Instant::now();
        measured.push(measurement.of(&mut renderer, (view, Background::BLACK), &pixels, detail)?);
        times.push(1e3 * started.elapsed().as_secs_f64());
    }
    report.set_measured(&measured);
    report.measurement_ms = (!times.is_empty()).then(|| Statistics::of(times));
    Ok(())
}

/// The largest certified bound of any pixel of any view.
fn certified_error(device: &Device, scene: &Loaded, views: &[Camera], options: &Options) -> Result<f32> {
    let gpu = scene.drawable.source.upload_with(
        device,
        options,
        Upload { is_certifiable: true, reserve_bytes: reserve(views[0].size_px) },
    )?;
    let mut renderer = Renderer::certified(device, options, &gpu)?;
    let mut largest = 0.0_f32;
    for view in views {
        renderer.render(view, Background::BLACK)?;
        largest = renderer.certificate()?.map_or(largest, |certificate| largest.max(certificate.largest()));
    }
    Ok(largest)
}

/// Bytes of device memory for the pictures of a measurement.
fn reserve(size: [u32; 2]) -> u64 {
    4 * 16 * size.iter().map(|side| u64::from(*side)).product::<u64>()
}

fn write(args: &Args, report: &Report) -> Result<()> {
    if let Some(sink) = &args.json {
        sink.write_json(report)?;
    }
    if let Some(sink) = &args.csv {
        sink.write(|out| report.write_csv(out))?;
    }
    #[cfg(feature = "plots")]
    if let Some(file) = &args.plot {
        crate::measure::plot::stage_breakdown(report, file)?;
    }
    Ok(())
}

fn other_conditions(problem: bench::OtherConditions) -> Usage {
    Usage(format!("--baseline: {problem}"))
}

/// Prints the changes. Fails if a run is slower than the baseline by more than `threshold` percent.
fn judge(changes: &[Change], baseline_runs: usize, threshold: f64) -> Result<()> {
    table::print_changes(changes)?;
    for change in changes.iter().filter(|change| change.picture_differs) {
        remark(&format!("note: {}: the picture differs from the baseline's", change.title));
    }
    for (change, [before, now]) in changes.iter().filter_map(|change| Some((change, change.other_path?))) {
        remark(&format!("note: {}: drawn by the {now} path, in the baseline by the {before} path", change.title));
    }
    if changes.len() < baseline_runs {
        remark(&format!("note: only {} of the baseline's {baseline_runs} runs were measured", changes.len()));
    }
    let slower = changes.iter().filter(|c| c.is_regression(threshold / 100.0)).map(|c| c.title.as_str());
    let slower: Vec<_> = slower.collect();
    if slower.is_empty() {
        return Ok(());
    }
    let slower = slower.join(", ");
    Err(OverThreshold(format!("slower than the baseline by more than {threshold} %: {slower}")).into())
}
