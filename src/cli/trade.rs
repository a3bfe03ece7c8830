//! `smalto trade`: the cost of accuracy on a scene.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::Result;
use clap::ValueEnum;

use super::bench::{CameraPath, Cameras};
use super::budget::BudgetArgs;
use super::table::{say_table, table};
use super::{
    DeviceArgs, Knobs, SceneArg, Sink, SplitArg, Usage, check_plots, complain, named_or_found, parse_size, progress,
    remark, say, size_text,
};
use crate::camera::{Camera, path};
use crate::files::check_writable;
use crate::gpu::Device;
use crate::measure::bench::{DeviceReport, Protocol, SceneReport, VersionReport, copy_gb_s};
use crate::measure::metrics::Difference;
use crate::measure::trade::{
    self, Budget, BudgetReport, CertificateReport, Point, Promise, Report, Study, mark_pareto, spread,
};
use crate::options::Options;
use crate::rules::Background;
use crate::scene::Focus;
use crate::scene::Gaussians;
use crate::storage::Statistics;

/// Measure the cost of accuracy: time, memory and error of every knob alone and of combinations that a search finds
#[derive(clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    scene: SceneArg,
    /// Camera file or folder, as `smalto render` takes it [default: the one found in the scene's folder or above it,
    /// else one orbit with zoom]
    #[arg(long, value_name = "FILE|DIR")]
    cameras: Option<PathBuf>,
    #[command(flatten)]
    split: SplitArg,
    /// Parts to measure: knobs (the presets and every knob alone), search (combinations of knobs), promises (checks the
    /// accuracy that the presets promise, over all cameras), certificate (certificates compared with the true errors)
    #[arg(long, value_name = "PART,...", default_value = "knobs,search", value_delimiter = ',')]
    parts: Vec<Part>,
    /// Picture size at which time and the error against the exact picture are measured
    #[arg(long, value_name = "WxH", default_value = "1920x1080", value_parser = parse_size)]
    size: [u32; 2],
    /// Picture size at which the float64 reference is drawn, on the CPU
    #[arg(long, value_name = "WxH", default_value = "480x270", value_parser = parse_size)]
    oracle_size: [u32; 2],
    /// Number of views to measure over, spread over the cameras
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=1000))]
    views: u16,
    /// Least number of warm-up frames of every point; 0: no warm-up. The warm-up goes on until the frame time is
    /// steady, as in `smalto bench`
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(0..=10_000))]
    warmup: u16,
    /// Number of measured frames of every point [default: 64, or fewer so that they take at most about 1 s; then
    /// the warm-up is short and fewer views are measured, too]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=10_000))]
    frames: Option<u16>,
    #[command(flatten)]
    device: DeviceArgs,
    /// Write the report as JSON (docs/trade.schema.json); - prints it instead of the tables
    #[arg(long, value_name = "FILE|-")]
    json: Option<Sink>,
    /// Plot error over time as SVG
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    budget: BudgetArgs,
    /// Number of views between the cameras on which the choice for --max-error or --min-psnr is checked
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u16).range(1..=1000))]
    held_out: u16,
    #[command(flatten)]
    knobs: Knobs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Part {
    Knobs,
    Search,
    Promises,
    Certificate,
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
/// Cameras of the orbit if there is no camera file.
const ORBIT_VIEWS: usize = 100;

pub(super) fn run(args: &Args) -> Result<()> {
    args.knobs.check_gpu()?;
    check_parts(args)?;
    let budget = args.budget.budget()?;
    args.json.as_ref().map_or(Ok(()), Sink::check)?;
    args.plot.as_deref().map_or(Ok(()), check_writable)?;
    let device = args.device.open()?;
    // The points have most stages in common, which take a software device longer to compile than to run.
    device.keep_pipelines();
    let scene = args.scene.read_for(Some(&device))?;
    let gaussians = &scene.gaussians;
    if gaussians.is_empty() {
        return Err(Usage(format!("{}: the scene has no Gaussians", args.scene.title())).into());
    }
    let statistics = Statistics::of(gaussians);
    let file = named_or_found(args.cameras.as_deref(), &args.scene);
    let cameras = Cameras::read(file.as_deref(), &args.split, &CameraPath::Orbit { zooms: true }, args.size)?;
    let count = if file.is_some() { usize::MAX } else { ORBIT_VIEWS };
    let (all, nearest) = cameras.views((&|| Focus::of(gaussians), None), args.size, count)?;
    let exact = args.knobs.options(&Options::EXACT, scene.is_antialiased, nearest);
    let bench = Bench { args, device: &device, gaussians, statistics: &statistics, exact };
    let has = |part| args.parts.contains(&part);

    let study = bench.study("reference", &spread(&all, args.views.into()))?;
    let mut report = Report {
        format: Report::FORMAT.to_owned(),
        smalto: VersionReport::current(),
        device: DeviceReport::of(&device, copy_gb_s(&device)?),
        scene: SceneReport::of(args.scene.title(), gaussians),
        size: args.size,
        oracle_size: args.oracle_size,
        views: study.views.len(),
        warmup: study.protocol.warmup,
        frames: study.protocol.frames,
        points: Vec::new(),
        search: Vec::new(),
        promises: Vec::new(),
        certificate: None,
        budget: None,
    };
    say!(
        "{}  {}  {} Gaussians, {} views, {} frames a point; reference at {}",
        report.scene.name,
        size_text(args.size),
        gaussians.len(),
        report.views,
        report.frames,
        size_text(args.oracle_size)
    )?;
    if has(Part::Knobs) {
        report.points = bench.points(&study)?;
    }
    if has(Part::Search) {
        if report.points.is_empty() {
            report.points.push(study.point("exact", &exact)?);
        }
        let bar = progress::Bar::new("search");
        report.search = trade::search(&study, &|done| bar.set(done))?;
    }
    mark_pareto(&mut report.points.iter_mut().chain(&mut report.search).collect::<Vec<_>>());
    print_points(&report)?;
    if has(Part::Promises) {
        report.promises = bench.promises(&all)?;
        print_promises(&report.promises)?;
    }
    if has(Part::Certificate) {
        let bar = progress::Bar::new("certificate");
        let certificate = trade::certify(&study, &|done| bar.set(done))?;
        drop(bar);
        print_certificate(&certificate)?;
        report.certificate = Some(certificate);
    }
    // A budget that cannot be met fails after the report of everything else is written.
    let held = budget.map(|budget| bench.hold(&study, budget, &all)).transpose();
    report.budget = held.as_ref().ok().cloned().flatten();
    complain(&device)?;
    if let Some(sink) = &args.json {
        sink.write_json(&report)?;
    }
    #[cfg(feature = "plots")]
    if let Some(file) = &args.plot {
        let presets = Options::PRESETS.map(|(name, _)| name);
        trade::plot(&report, &presets, file)?;
    }
    held.map(drop)
}

/// Fails if arguments contradict each other.
fn check_parts(args: &Args) -> Result<(), Usage> {
    let has = |part| args.parts.contains(&part);
    if args.knobs.trades() {
        return Err(Usage("trade sets the knobs itself; only rules of the picture can be set".to_owned()));
    }
    check_plots(args.plot.as_deref())?;
    if args.plot.is_some() && !has(Part::Knobs) && !has(Part::Search) {
        return Err(Usage("--plot needs --parts knobs or search".to_owned()));
    }
    let rules = args.knobs.options(&Options::EXACT, false, f32::INFINITY);
    match rules.uncertifiable().filter(|_| has(Part::Certificate)) {
        Some(why) => Err(Usage(format!("--parts certificate: {why}"))),
        None => Ok(()),
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
    /// A study of these views, at full size and at the size of the reference.
    fn study(&self, name: &str, views: &[Camera]) -> Result<Study<'a>> {
        self.study_at(name, [resized(views, self.args.size), resized(views, self.args.oracle_size)])
    }

    fn study_at(&self, name: &str, views: [Vec<Camera>; 2]) -> Result<Study<'a>> {
        let bar = progress::Bar::new(name);
        let (scene, drawn) = ((self.gaussians, self.statistics), (self.exact, Background::BLACK));
        let frames = self.args.frames.map_or(FRAMES, usize::from);
        let protocol = Protocol { warmup: self.args.warmup.into(), frames };
        let study = Study::new(self.device, scene, drawn, views, protocol, &|done| bar.set(done))?.thorough();
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
        let choice = trade::choose(study, budget, &|done| bar.set(done))?;
        drop(bar);
        say!("{}", choice.explain())?;
        let count = usize::from(self.args.held_out);
        let between = path::through(cameras, count + 2);
        let held = choice.hold(&self.study("held-out views", &between[1..=count])?)?;
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

fn print_points(report: &Report) -> Result<()> {
    let Some(exact) = report.points.first() else {
        return Ok(());
    };
    let header = ["", "path", "ms", "saved", "MB", "dB", "max error", "step", "SSIM", "FLIP", "dB to exact", "max", ""];
    let mut rows = table(&header);
    for point in report.points.iter().chain(&report.search) {
        let (oracle, full) = (&point.from_oracle, &point.from_exact);
        rows.add_row([
            point.name.clone(),
            point.drawn_by.to_string(),
            format!("{:.3}", point.gpu_ms),
            format!("{:.3}", exact.gpu_ms - point.gpu_ms),
            format!("{:.0}", (point.scene_bytes + point.work_bytes) as f64 / 1e6),
            decibels(oracle),
            format!("{:.4}", oracle.max_error),
            oracle.largest_step.to_string(),
            oracle.ssim.map_or_else(String::new, |ssim| format!("{ssim:.5}")),
            format!("{:.5}", oracle.flip),
            decibels(full),
            format!("{:.4}", full.max_error),
            if point.is_pareto { "*" } else { "" }.to_owned(),
        ]);
    }
    say_table(&rows)?;
    say!(
        "  errors of the worst view; step: largest difference in 8 bits; \
         *: no other is both faster and more accurate"
    )?;
    let all = || report.points.iter().chain(&report.search);
    let notices: BTreeSet<&str> = all().filter_map(|point| point.notice.as_deref()).collect();
    notices.iter().for_each(|notice| remark(&format!("note: {}: {notice}", report.scene.name)));
    let unsteady = all().filter(|point| point.warm_up.is_some_and(|warm_up| !warm_up.is_steady)).count();
    match unsteady {
        0 => Ok(()),
        _ => {
            let points = all().count();
            say!("  warning: the frame time of {unsteady} of {points} points was not steady after the warm-up")
        }
    }
}

fn print_promises(promises: &[Promise]) -> Result<()> {
    let mut rows = table(&["preset", "promise", "dB", "max error", "step", "SSIM", "FLIP", "cameras", "kept"]);
    for promise in promises {
        let step = promise.max_step.map_or_else(String::new, |step| format!(", {step} steps"));
        let worst = &promise.worst;
        rows.add_row([
            promise.preset.clone(),
            format!("{} dB{step}", promise.min_psnr_db),
            decibels(worst),
            format!("{:.4}", worst.max_error),
            worst.largest_step.to_string(),
            worst.ssim.map_or_else(String::new, |ssim| format!("{ssim:.5}")),
            format!("{:.5}", worst.flip),
            promise.cameras.to_string(),
            if promise.is_kept { "yes" } else { "NO" }.to_owned(),
        ]);
    }
    say_table(&rows)
}

fn print_certificate(report: &CertificateReport) -> Result<()> {
    let header =
        ["certificate", "pixels", "violations", "max error", "max bound", "mean error", "mean bound", "tightest"];
    let mut rows = table(&header);
    for setting in &report.settings {
        rows.add_row([
            setting.name.clone(),
            setting.pixel_tests.to_string(),
            setting.violations.to_string(),
            format!("{:.5}", setting.max_error),
            format!("{:.5}", setting.max_certificate),
            format!("{:.2e}", setting.mean_error),
            format!("{:.2e}", setting.mean_certificate),
            format!("{:.3}", setting.tightest),
        ]);
    }
    say_table(&rows)?;
    say!("  {} pixels tested, {} violations", report.pixel_tests, report.violations)
}

fn print_budget(held: &BudgetReport) -> Result<()> {
    let BudgetReport { held_out_views, exceeded, from_oracle, from_exact, .. } = held;
    say!(
        "  on {held_out_views} other views: {exceeded} over the budget; worst {} dB and {:.4} to the reference, \
         {} dB and {:.4} to exact",
        decibels(from_oracle),
        from_oracle.max_error,
        decibels(from_exact),
        from_exact.max_error
    )
}

fn decibels(difference: &Difference) -> String {
    difference.psnr_db.map_or_else(|| "equal".to_owned(), |db| format!("{db:.1}"))
}
