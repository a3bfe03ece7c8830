//! `smalto prune`: writes a scene without the Gaussians that contribute least to given views.

use std::cell::RefCell;
use std::path::PathBuf;

use anyhow::{Result, ensure};
use comfy_table::Cell;

use super::cameras::{LensArgs, SplitArg, named_or_found};
use super::convert::{Target, formats, say_file, say_loss, write_pages, write_scene};
use super::devices::DeviceArgs;
use super::headings::{CAMERAS, OUTPUT, REPORTS};
use super::knobs::RuleKnobs;
use super::render::{SelectedCamera, select_cameras};
use super::scenes::SceneArg;
use super::sink::Sink;
use super::table::{say_table, table};
use super::values::whole;
use super::{Usage, complain, one_of, progress, say, values};
use crate::camera::{self, Camera, CameraFile};
use crate::formats::written_labels;
use crate::gpu::Device;
use crate::measure::bench::{SceneReport, VersionReport};
use crate::measure::prune::{
    Change, Cut, Kept, Limit, Order, Others, Report, Step, Subject, ViewReport, Worst, Written, compare, search,
};
use crate::options::Options;
use crate::packing::Statistics;
use crate::pagefile::write::Settings;
use crate::render::Pruner;
use crate::scene::{Scene, Unreadable};

/// Drop the Gaussians that contribute least to given views, within a limit on the change, and write the rest
#[derive(clap::Args)]
#[command(
    after_help = "\
Examples:
  smalto prune plush.spz --cameras cameras.json --min-psnr 50 -o less.spz
  smalto prune plush.spz --cameras cameras.json --max-error 4/255 -o less.sog
  smalto prune plush.spz --split train --keep-unseen --min-psnr 50 -o less.spz",
    after_long_help = "\
A Gaussian contributes alpha * transmittance to a pixel. Those whose largest contribution is the
least are dropped first, as many as the limit allows. The limit is kept by measurement: every given
view is drawn with all Gaussians and with those that are left. It covers these views, at their
sizes, and no others: Gaussians that no given view sees are dropped whatever the limit, unless
--keep-unseen is given. Cameras of the file that are not given (--camera, --split) are measured and
reported. `bound` is what no pixel of the given views can exceed, by proof (docs/prune.md). The loss
of the written format comes on top and is reported."
)]
pub(super) struct Args {
    #[command(flatten)]
    scene: SceneArg,
    /// The file to write; - for standard output
    #[arg(short, long, help_heading = OUTPUT, value_name = "FILE", long_help = format!(
        "The file to write: {}; - for standard output", written_labels()
    ))]
    output: PathBuf,
    /// Format of the file [default: by its name]
    ///
    /// Needed for standard output and for names without an ending.
    #[arg(long, help_heading = OUTPUT, value_name = "FORMAT", value_parser = one_of(formats()))]
    #[arg(hide_possible_values = true)]
    format: Option<Target>,
    /// Version of the .spz file [default: 4]
    #[arg(long, help_heading = OUTPUT, value_name = "3|4", value_parser = whole::<u32>(3..=4))]
    spz_version: Option<u32>,
    /// Refuse to replace an existing file
    #[arg(long, help_heading = OUTPUT)]
    no_clobber: bool,
    /// Let no colour value of a given view change by more than ERROR, like 4/255
    ///
    /// From 0 to 1 (white is 1), or as steps of 8 bits.
    #[arg(long, help_heading = LIMIT, value_name = "ERROR", conflicts_with = "min_psnr")]
    #[arg(value_parser = values::error(1.0))]
    max_error: Option<f64>,
    /// Keep every given view at a PSNR of at least DB to the whole scene
    #[arg(long, help_heading = LIMIT, value_name = "DB", value_parser = values::decibels)]
    min_psnr: Option<f64>,
    /// Keep the Gaussians that no given view sees, for other views
    ///
    /// Without this option they are dropped.
    #[arg(long, help_heading = LIMIT)]
    keep_unseen: bool,
    /// Camera file or folder [default: found next to the scene or above it]
    #[arg(long, help_heading = CAMERAS, value_name = "FILE|DIR")]
    cameras: Option<PathBuf>,
    #[command(flatten)]
    split: SplitArg,
    /// The given views, as for `smalto render`
    #[arg(long, help_heading = CAMERAS, value_name = "CAMERAS", allow_hyphen_values = true, default_value = "all")]
    camera: String,
    /// Picture size in pixels of the views [default: the cameras']
    ///
    /// A limit holds at this size: larger pictures show more.
    #[arg(long, help_heading = CAMERAS, value_name = "WxH", value_parser = values::size)]
    size: Option<[u32; 2]>,
    #[command(flatten)]
    knobs: RuleKnobs,
    #[command(flatten)]
    device: DeviceArgs,
    /// Write the report as JSON; - prints it instead of the text
    ///
    /// Schema: docs/schemas/prune.schema.json.
    #[arg(long, help_heading = REPORTS, value_name = "FILE|-")]
    json: Option<Sink>,
}

const LIMIT: &str = "Limit";

/// The views of a camera file.
struct Views {
    given: Vec<SelectedCamera>,
    others: Vec<Camera>,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let limit = limit(args)?;
    args.knobs.0.check_gpu()?;
    let target = Target::of(&args.output, args.format, args.spz_version)?;
    let input = args.scene.path();
    target.check(&args.output, input.as_deref(), args.no_clobber, args.json.as_ref())?;
    let views = views(args)?;
    let device = args.device.open()?;
    device.keep_pipelines();
    let scene = args.scene.read_for(Some(&device))?;
    if scene.gaussians.is_empty() {
        return Err(Usage(format!("{}: the scene has no Gaussians", args.scene.title())).into());
    }
    let options = args.knobs.0.options(&Options::EXACT, scene.is_antialiased, f32::INFINITY);
    let pruned = prune(&device, &scene, &views, (limit, args.keep_unseen), options)?;
    complain(&device)?;
    let title = args.scene.title();
    let subject = Subject {
        device: device.capabilities().name.clone(),
        scene: SceneReport::of(title, &scene.gaussians),
        options,
    };
    print(&subject, limit, &views, &pruned)?;
    let output = write(args, target, scene, &pruned)?;
    let report = Report {
        format: Report::FORMAT.to_owned(),
        smalto: VersionReport::current(),
        subject,
        limit,
        gaussians: pruned.gaussians,
        bound: Worst::of(&pruned.cut.bounds),
        measured: Worst::of(&pruned.cut.measured),
        others: pruned.others,
        views: pruned.views(&views),
        output,
    };
    say_file((&report.output.file, &report.output.format, report.output.bytes), report.output.gaussians, {
        report.output.sh_degree
    })?;
    say_loss(report.output.transparent, &report.output.loss)?;
    args.json.as_ref().map_or(Ok(()), |sink| sink.write_json(&report))
}

fn limit(args: &Args) -> Result<Limit, Usage> {
    match (args.max_error, args.min_psnr) {
        (Some(error), _) => Ok(Limit::MaxError(error)),
        (None, Some(db)) => Ok(Limit::Psnr(db)),
        (None, None) => Err(Usage("prune needs a limit of what it may change: --max-error or --min-psnr".to_owned())),
    }
}

/// The given views and the other cameras of the file, at the size that is drawn.
fn views(args: &Args) -> Result<Views> {
    let found = named_or_found(args.cameras.as_deref(), &args.scene, &args.split, args.size, &LensArgs::pinholes())?;
    let (file, numbered) = found.ok_or_else(|| {
        Usage("prune needs views: no --cameras, and none found next to the scene or above it".to_owned())
    })?;
    let (mut given, _) = select_cameras(&numbered, &args.camera)?;
    given.sort_by_key(|chosen| chosen.index);
    given.dedup_by_key(|chosen| chosen.index);
    let all = camera::read_at(&file, args.size)
        .and_then(CameraFile::into_pinholes)
        .map_err(|problem| Unreadable::new(&file, &problem))?
        .cameras;
    let resized = |camera: &Camera| args.size.map_or_else(|| camera.clone(), |size| camera.resized(size));
    given.iter_mut().for_each(|chosen| chosen.camera = resized(&chosen.camera));
    let is_given = |index: &usize| given.binary_search_by_key(index, |chosen| chosen.index).is_ok();
    let others = all.iter().enumerate().filter(|(index, _)| !is_given(index));
    let others = others.map(|(_, named)| resized(&named.camera)).collect();
    Ok(Views { given, others })
}

/// The dropped Gaussians, and the change of the views.
struct Pruned {
    order: Order,
    cut: Cut,
    gaussians: Kept,
    others: Option<Others>,
}

fn prune(
    device: &Device,
    scene: &Scene,
    views: &Views,
    (limit, keeps_unseen): (Limit, bool),
    options: Options,
) -> Result<Pruned> {
    let statistics = Statistics::of(&scene.gaussians);
    let mut pruner = Pruner::new(device, &scene.gaussians, &statistics, &options)?;
    let given: Vec<Camera> = views.given.iter().map(|chosen| chosen.camera.clone()).collect();
    let bar = progress::Bar::new("contributions");
    for (done, view) in given.iter().enumerate() {
        pruner.note(view)?;
        bar.set_counted(done + 1, given.len(), "views");
    }
    drop(bar);
    let shares = pruner.shares()?;
    ensure!(shares.iter().any(|share| share.largest > 0.0), "no given view sees a Gaussian of the scene");
    let order = Order::of(&shares, keeps_unseen);
    let cut = search(&mut pruner, &given, &order, limit, &Steps::default().shown())?;
    let bar = progress::Bar::new("other views");
    let others = Others::of(&compare(&mut pruner, &views.others, &order, cut.dropped, &|done| bar.set(done))?);
    let last = order.dropped(cut.dropped).last();
    let gaussians = Kept {
        before: order.all(),
        kept: order.all() - cut.dropped,
        dropped: cut.dropped,
        unseen: order.unseen().min(cut.dropped),
        largest_dropped_share: last.map_or(0.0, |index| shares[*index as usize].largest),
    };
    Ok(Pruned { order, cut, gaussians, others })
}

/// The progress of the steps of a search, each with a bar of its own.
#[derive(Default)]
struct Steps(RefCell<Option<(Step, progress::Bar)>>);

impl Steps {
    fn shown(self) -> impl Fn(Step, f64) {
        move |step, fraction| {
            let mut current = self.0.borrow_mut();
            if current.as_ref().is_none_or(|(of, _)| *of != step) {
                let name = match step {
                    Step::Search => "search",
                    Step::Check => "check",
                    Step::Bound => "bound",
                };
                *current = Some((step, progress::Bar::new(name)));
            }
            current.as_ref().inspect(|(_, bar)| bar.set(fraction));
        }
    }
}

impl Pruned {
    fn views(&self, views: &Views) -> Vec<ViewReport> {
        let changes = self.cut.measured.iter().zip(&self.cut.bounds);
        let view = |(chosen, (measured, bound)): (&SelectedCamera, (&Change, &Change))| ViewReport {
            camera: chosen.index,
            name: chosen.name.clone().unwrap_or_default(),
            size: chosen.camera.size_px,
            bound: Worst::from(*bound),
            measured: Worst::from(*measured),
        };
        views.given.iter().zip(changes).map(view).collect()
    }
}

/// Writes the remaining Gaussians.
fn write(args: &Args, target: Target, scene: Scene, pruned: &Pruned) -> Result<Written> {
    let gaussians = scene.gaussians.selected(&pruned.order.kept(pruned.cut.dropped))?;
    match target {
        Target::Scene(kind) => {
            let is_antialiased = scene.is_antialiased;
            drop(scene);
            write_scene(&args.output, kind, gaussians, is_antialiased)
        }
        Target::Pages => {
            let format = format!("{}, pruned", scene.format);
            write_pages(&args.output, args.scene.title(), &Scene { gaussians, format, ..scene }, Settings::default())
        }
    }
}

fn print(subject: &Subject, limit: Limit, views: &Views, pruned: &Pruned) -> Result<()> {
    let Kept { before, kept, dropped, unseen, largest_dropped_share } = pruned.gaussians;
    let wanted = match limit {
        Limit::MaxError(error) => format!("no value changes by more than {error:.4}"),
        Limit::Psnr(db) => format!("at least {db} dB"),
    };
    say!("{}  {before} Gaussians, {} views: {wanted}", subject.scene.name, views.given.len())?;
    let part = |count: usize| format!("{:.1} %", 100.0 * count as f64 / before as f64);
    say!("  {dropped} dropped ({}), {kept} kept ({})", part(dropped), part(kept))?;
    say!("  {unseen} of the dropped have no share in any view, the others at most {largest_dropped_share:.2e}")?;
    let mut rows = table(&["", "views", "largest change", "worst dB"]);
    let mut row = |name: &str, views: usize, worst: Worst| {
        let decibels = worst.psnr_db.map_or_else(|| "equal".to_owned(), |db| format!("{db:.2}"));
        rows.add_row([name.to_owned(), views.to_string(), format!("{:.5}", worst.max_error), decibels].map(Cell::new));
    };
    row("bound", views.given.len(), Worst::of(&pruned.cut.bounds));
    row("measured", views.given.len(), Worst::of(&pruned.cut.measured));
    if let Some(others) = pruned.others {
        row("not covered", others.views, others.measured);
    }
    say_table(&rows)
}
