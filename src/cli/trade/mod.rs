//! `smalto trade`: the cost of accuracy on a scene.
//!
//! - `tables` - tables on the terminal

mod tables;

use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Result, ensure};
use clap::ValueEnum;

use crate::camera::{Camera, path};
use crate::cli::bench::{CameraPath, Cameras};
use crate::cli::budget::BudgetArgs;
use crate::cli::cameras::{LensArgs, SplitArg, named_or_found};
use crate::cli::devices::DeviceArgs;
use crate::cli::drawable::Drawable;
use crate::cli::headings::{CAMERAS, MEASURING, REPORTS};
use crate::cli::knobs::Knobs;
use crate::cli::scenes::SceneArg;
use crate::cli::sink::Sink;
use crate::cli::values::whole;
use crate::cli::{Usage, check_plots, complain, progress, say, size_text, values};
use crate::files::check_writable;
use crate::gpu::Device;
use crate::measure::bench::{DeviceReport, Protocol, SceneReport, VersionReport, copy_gb_s};
use crate::measure::trade::{
    self, Budget, BudgetReport, LevelTrade, LevelsReport, Point, Promise, Report, Study, mark_pareto, spread,
};
use crate::options::Options;
use crate::packing::Statistics;
use crate::render::{NoLevels, SceneSource};
use crate::rules::Background;
use crate::scene::{Focus, Gaussians, Scene};
use tables::{print_budget, print_certificate, print_levels, print_points, print_promises};

/// Measure the cost of accuracy: time, memory and error of every knob alone and of combinations that a search finds
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  smalto trade plush.spz --cameras cameras.json --json trade.json --plot trade.svg
  smalto trade plush.spz --parts promises,certificate
  smalto trade plush.spz --max-error 4/255 --held-out 100
  smalto trade city.smalto --parts levels --path street")]
pub(super) struct Args {
    #[command(flatten)]
    scene: SceneArg,
    /// Camera file or folder [default: the one found, or an orbit]
    ///
    /// It is found next to the scene or above it, as by `smalto render`.
    #[arg(long, help_heading = CAMERAS, value_name = "FILE|DIR", conflicts_with = "path")]
    cameras: Option<PathBuf>,
    #[command(flatten)]
    split: SplitArg,
    /// Camera path instead of a camera file, as in `smalto bench`
    #[arg(long, help_heading = CAMERAS, value_name = "PATH")]
    path: Option<CameraPath>,
    #[command(flatten)]
    lens: LensArgs,
    /// knobs, search, promises, certificate, levels: what to measure
    ///
    /// knobs (the presets and every knob alone), search (combinations of knobs), promises (checks the accuracy that the
    /// presets promise, over all cameras), certificate (certificates compared with the true errors), levels (the
    /// presets with all Gaussians and with fewer nodes of a file with levels, against the exact pictures and against
    /// pictures with 16 samples a pixel). With levels alone, the scene is not read as a whole. By default knobs and
    /// search, and levels if it is a page file with levels.
    #[arg(long, help_heading = MEASURING, value_name = "PART,...", value_delimiter = ',', hide_possible_values = true)]
    parts: Option<Vec<Part>>,
    /// Picture size for times and errors to exact pictures
    #[arg(long, help_heading = MEASURING, value_name = "WxH", default_value = "1920x1080", value_parser = values::size)]
    size: [u32; 2],
    /// Picture size for the float64 reference, on the CPU
    #[arg(long, help_heading = MEASURING, value_name = "WxH", default_value = "480x270", value_parser = values::size)]
    oracle_size: [u32; 2],
    /// Number of views to measure over, spread over the cameras
    #[arg(long, help_heading = MEASURING, value_name = "N", default_value_t = 8, value_parser = whole::<u16>(1..=1000))]
    views: u16,
    /// Least number of warm-up frames of every point; 0: no warm-up
    ///
    /// The warm-up goes on until the frame time is steady, as in `smalto bench`.
    #[arg(long, help_heading = MEASURING, value_name = "N", default_value_t = 8)]
    #[arg(value_parser = whole::<u16>(0..=10_000))]
    warmup: u16,
    /// Measured frames of every point [default: 64, or as many as 1 s allows]
    ///
    /// Where 1 s allows fewer than 64, the warm-up is short and fewer views are measured, too.
    #[arg(long, help_heading = MEASURING, value_name = "N", value_parser = whole::<u16>(1..=10_000))]
    frames: Option<u16>,
    /// Views between the cameras on which a budget is checked
    #[arg(long, help_heading = MEASURING, value_name = "N", default_value_t = 100)]
    #[arg(value_parser = whole::<u16>(1..=1000))]
    held_out: u16,
    #[command(flatten)]
    budget: BudgetArgs,
    #[command(flatten)]
    knobs: Knobs,
    #[command(flatten)]
    device: DeviceArgs,
    /// Write the report as JSON; - prints it instead of the tables
    ///
    /// Schema: docs/schemas/trade.schema.json.
    #[arg(long, help_heading = REPORTS, value_name = "FILE|-")]
    json: Option<Sink>,
    /// Plot error over time as SVG
    #[arg(long, help_heading = REPORTS, value_name = "FILE")]
    plot: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Part {
    Knobs,
    Search,
    Promises,
    Certificate,
    Levels,
}

/// Presets that promise an accuracy: name, options, least PSNR in dB, and largest difference in 8 bits.
const PROMISES: [(&str, Options, f64, Option<u8>); 4] = [
    ("exact", Options::EXACT, 90.0, None),
    ("balanced", Options::BALANCED, 60.0, Some(3)),
    ("fast", Options::FAST, 50.0, None),
    ("preview", Options::PREVIEW, 40.0, None),
];

/// Measured frames of every point, and the time for them on slow devices.
const FRAMES: usize = 64;
const PATIENCE: Duration = Duration::from_secs(1);
/// Cameras of a path.
const PATH_VIEWS: usize = 100;

pub(super) fn run(args: &Args) -> Result<()> {
    args.knobs.check_gpu()?;
    if args.knobs.trades() {
        return Err(Usage("trade sets the knobs itself; only rules of the picture can be set".to_owned()).into());
    }
    check_plots(args.plot.as_deref())?;
    let wants_levels = args.parts.as_ref().is_some_and(|parts| parts.contains(&Part::Levels));
    let paged = Drawable::in_pages(&args.scene, wants_levels)?.filter(|paged| paged.source.has_levels());
    let parts = checked_parts(args, paged.is_some())?;
    let budget = args.budget.budget()?;
    args.json.as_ref().map_or(Ok(()), Sink::check)?;
    args.plot.as_deref().map_or(Ok(()), check_writable)?;
    let device = args.device.open()?;
    // The points have most stages in common, which take a software device longer to compile than to run.
    device.keep_pipelines();
    // A scene without levels is read in any case, so that an error in its file is reported first.
    let whole = parts.iter().any(|part| *part != Part::Levels) || budget.is_some() || paged.is_none();
    let whole = whole.then(|| args.scene.read_for(Some(&device))).transpose()?;
    ensure!(paged.is_some() || !parts.contains(&Part::Levels), NoLevels);
    let (scene, is_antialiased, focus) = match (&whole, &paged) {
        (Some(Scene { gaussians, is_antialiased, .. }), _) => {
            (SceneReport::of(args.scene.title(), gaussians), *is_antialiased, Focus::of(gaussians))
        }
        (None, Some(paged)) => (paged.report(), paged.source.is_antialiased, paged.source.focus()),
        (None, None) => return Err(NoLevels.into()),
    };
    if scene.gaussians == 0 {
        return Err(Usage(format!("{}: the scene has no Gaussians", args.scene.title())).into());
    }
    let (all, nearest) = views(args, focus)?;
    let mut report = Report {
        format: Report::FORMAT.to_owned(),
        smalto: VersionReport::current(),
        device: DeviceReport::of(&device, copy_gb_s(&device)?),
        scene,
        size: args.size,
        oracle_size: args.oracle_size,
        views: 0,
        warmup: 0,
        frames: 0,
        points: Vec::new(),
        search: Vec::new(),
        promises: Vec::new(),
        levels: None,
        certificate: None,
        budget: None,
    };
    let exact = args.knobs.options(&Options::EXACT, is_antialiased, nearest);
    // A budget that cannot be met fails after the report of everything else is written.
    let mut held = Ok(());
    if let Some(Scene { gaussians, .. }) = &whole {
        let statistics = Statistics::of(gaussians);
        let bench = Bench { args, device: &device, gaussians, statistics: &statistics, exact };
        held = bench.measure(&parts, budget, &all, &mut report)?;
    }
    if let Some(Drawable { source, .. }) = paged.as_ref().filter(|_| parts.contains(&Part::Levels)) {
        let levels = levels(args, (&device, source), &exact, &spread(&all, args.views.into()))?;
        if whole.is_none() {
            (report.views, report.warmup, report.frames) = (levels.views, levels.warmup, levels.frames);
            say!("{}  {}  {} Gaussians", report.scene.name, size_text(args.size), report.scene.gaussians)?;
        }
        print_levels(&levels)?;
        report.levels = Some(levels);
    }
    complain(&device)?;
    if let Some(sink) = &args.json {
        sink.write_json(&report)?;
    }
    #[cfg(feature = "plots")]
    if let Some(file) = &args.plot {
        let presets = Options::PRESETS.map(|(name, _)| name);
        crate::measure::plot::trade(&report, &presets, file)?;
    }
    held
}

/// The parts to measure of a scene with or without levels of detail. Fails if arguments contradict each other.
fn checked_parts(args: &Args, has_levels: bool) -> Result<Vec<Part>> {
    let default = || [Part::Knobs, Part::Search].into_iter().chain(has_levels.then_some(Part::Levels)).collect();
    let parts: Vec<Part> = args.parts.clone().unwrap_or_else(default);
    if args.plot.is_some() && parts.iter().all(|part| matches!(part, Part::Promises | Part::Certificate)) {
        return Err(Usage("--plot needs --parts knobs, search or levels".to_owned()).into());
    }
    let rules = args.knobs.options(&Options::EXACT, false, f32::INFINITY);
    match rules.uncertifiable().filter(|_| parts.contains(&Part::Certificate)) {
        Some(why) => Err(Usage(format!("--parts certificate: {why}")).into()),
        None => Ok(parts),
    }
}

/// The views of the scene, and the largest distance of the near plane that they allow, in world units.
fn views(args: &Args, focus: Focus) -> Result<(Vec<Camera>, f32)> {
    let found = match args.path {
        None => named_or_found(args.cameras.as_deref(), &args.scene, &args.split, Some(args.size), &args.lens)?,
        Some(_) => None,
    };
    let count = if found.is_some() { usize::MAX } else { PATH_VIEWS };
    let path = args.path.as_ref().unwrap_or(&CameraPath::Orbit { zooms: true });
    let cameras = found.map_or_else(
        || Cameras::along(&args.split, path, args.size, &args.lens),
        |(file, numbered)| Ok(Cameras::of_file(&file, numbered)),
    )?;
    cameras.views((&|| focus, args.scene.town()?), args.size, count)
}

/// Measures levels of detail, with the rules of `exact`.
fn levels(
    args: &Args,
    (device, source): (&Device, &SceneSource),
    exact: &Options,
    views: &[Camera],
) -> Result<LevelsReport> {
    let by_rules = |preset: &Options| args.knobs.options(preset, exact.rules.antialiased, exact.rules.near);
    let presets = [("exact", *exact), ("balanced", by_rules(&Options::BALANCED)), ("fast", by_rules(&Options::FAST))];
    let bar = progress::Bar::new("levels");
    LevelTrade {
        device,
        source,
        presets: &presets,
        views: &resized(views, args.size),
        protocol: args.protocol(),
        patience: args.frames.is_none().then_some(PATIENCE),
    }
    .measure(&|done| bar.set(done))
}

impl Args {
    fn protocol(&self) -> Protocol {
        Protocol { warmup: self.warmup.into(), frames: self.frames.map_or(FRAMES, usize::from) }
    }
}

/// The scene and the settings that all parts share.
struct Bench<'a> {
    args: &'a Args,
    device: &'a Device,
    gaussians: &'a Gaussians,
    statistics: &'a Statistics,
    exact: Options,
}

impl<'a> Bench<'a> {
    /// Measures and prints the parts that need the whole scene, and chooses for a budget. The inner error is that of
    /// the budget.
    fn measure(
        &self,
        parts: &[Part],
        budget: Option<Budget>,
        all: &[Camera],
        report: &mut Report,
    ) -> Result<Result<()>> {
        let study = self.study("reference", &spread(all, self.args.views.into()))?;
        (report.views, report.frames) = (study.views.len(), study.protocol().frames);
        report.warmup = study.protocol().warmup;
        say!(
            "{}  {}  {} Gaussians, {} views, {} frames a point; reference at {}",
            report.scene.name,
            size_text(self.args.size),
            report.scene.gaussians,
            report.views,
            report.frames,
            size_text(self.args.oracle_size)
        )?;
        if parts.contains(&Part::Knobs) {
            report.points = self.points(&study)?;
        }
        if parts.contains(&Part::Search) {
            if report.points.is_empty() {
                report.points.push(study.point("exact", &self.exact)?);
            }
            let bar = progress::Bar::new("search");
            report.search = trade::search(&study, &|done| bar.set(done))?;
        }
        mark_pareto(&mut report.points.iter_mut().chain(&mut report.search).collect::<Vec<_>>());
        print_points(report)?;
        if parts.contains(&Part::Promises) {
            report.promises = self.promises(all)?;
            print_promises(&report.promises)?;
        }
        if parts.contains(&Part::Certificate) {
            let bar = progress::Bar::new("certificate");
            let certificate = trade::certify(&study, &|done| bar.set(done))?;
            drop(bar);
            print_certificate(&certificate)?;
            report.certificate = Some(certificate);
        }
        let held = budget.map(|budget| self.hold(&study, budget, all)).transpose();
        report.budget = held.as_ref().ok().cloned().flatten();
        Ok(held.map(drop))
    }

    /// A study of these views, at full size and at the size of the reference.
    fn study(&self, name: &str, views: &[Camera]) -> Result<Study<'a>> {
        self.study_at(name, [resized(views, self.args.size), resized(views, self.args.oracle_size)])
    }

    fn study_at(&self, name: &str, views: [Vec<Camera>; 2]) -> Result<Study<'a>> {
        let bar = progress::Bar::new(name);
        let (scene, drawn) = ((self.gaussians, self.statistics), (self.exact, Background::BLACK));
        let progress = |done| bar.advance(done);
        let study = Study::new(self.device, scene, drawn, views, self.args.protocol(), &progress)?.thorough();
        if self.args.frames.is_some() { Ok(study) } else { study.within(PATIENCE) }
    }

    /// Measures the presets and every knob alone, with the rules of the scene.
    fn points(&self, study: &Study) -> Result<Vec<Point>> {
        let mut all = vec![("exact".to_owned(), self.exact)];
        for (name, preset) in Options::PRESETS.iter().filter(|(name, _)| !["exact", "portable"].contains(name)) {
            all.push(((*name).to_owned(), self.by_rules(preset)));
        }
        all.extend(trade::knobs(&self.exact, &self.statistics.requirements));
        let bar = progress::Bar::new("knobs");
        let count = all.len() as f64;
        let point = |(i, (name, options)): (usize, (String, Options))| {
            bar.set(i as f64 / count);
            study.point(&name, &options)
        };
        all.into_iter().enumerate().map(point).collect()
    }

    /// Chooses options for a budget, and checks the choice on views between the cameras.
    fn hold(&self, study: &Study, budget: Budget, cameras: &[Camera]) -> Result<BudgetReport> {
        let bar = progress::Bar::new("choosing");
        let choice = trade::choose(study, budget, &|done| bar.advance(done))?;
        drop(bar);
        say!("{}", choice.explain())?;
        let count = usize::from(self.args.held_out);
        let between = path::through(cameras, count + 2);
        let held = choice.verify(&self.study("held-out views", &between[1..=count])?)?;
        print_budget(&held)?;
        Ok(held)
    }

    fn by_rules(&self, preset: &Options) -> Options {
        self.args.knobs.options(preset, self.exact.rules.antialiased, self.exact.rules.near)
    }

    /// Compares the worst picture of each preset over all cameras with the reference.
    fn promises(&self, cameras: &[Camera]) -> Result<Vec<Promise>> {
        // Only the reference is needed: nothing is drawn at full size.
        let study = self.study_at("promises", [Vec::new(), resized(cameras, self.args.oracle_size)])?;
        let promise = |(preset, options, min_psnr_db, max_step): &(&str, Options, f64, Option<u8>)| {
            let worst = study.from_oracle(&self.by_rules(options))?;
            let is_kept = worst.psnr_db.is_none_or(|db| db >= *min_psnr_db)
                && max_step.is_none_or(|step| worst.largest_step <= step);
            let (min_psnr_db, max_step, cameras) = (*min_psnr_db, *max_step, cameras.len());
            Ok(Promise { preset: (*preset).to_owned(), min_psnr_db, max_step, worst, cameras, is_kept })
        };
        PROMISES.iter().map(promise).collect()
    }
}

fn resized(views: &[Camera], size: [u32; 2]) -> Vec<Camera> {
    views.iter().map(|view| view.resized(size)).collect()
}
