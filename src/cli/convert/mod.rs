//! `smalto convert`: writes one or several scenes to another file, optionally changed.
//!
//! - `target` - the file that a scene is written to: its format, checks before the work, the write itself
//! - `pages` - conversion to a page file, of scenes that need not fit into memory
//! - `lod` - `smalto lod`: levels of detail with their errors, or one level as a scene

pub(super) mod lod;
mod pages;
mod target;

use std::path::PathBuf;

use anyhow::{Result, ensure};
use comfy_table::Cell;
use glam::{DQuat, DVec3, EulerRot};
use schemars::JsonSchema;
use serde::Serialize;

use crate::cli::headings::{OUTPUT, SCENE};
use crate::cli::scenes::{ReadingArgs, SceneArg};
use crate::cli::sink::Sink;
use crate::cli::table::{say_table, table};
use crate::cli::values::whole;
use crate::cli::{Usage, numbers, one_of, say, values};
use crate::formats::{Loss, written_labels};
use crate::measure::prune::Written;
use crate::options::Options;
use crate::scene::{Gaussians, LoadReport, MAX_SH_DEGREE, Scene, Transform};

pub(super) use pages::write_pages;
pub(super) use target::{Target, formats, write_scene};

/// Convert a scene, or several joined, to another file, and report what the format loses
#[derive(clap::Args)]
#[command(
    override_usage = "smalto convert [OPTIONS] <IN>... <OUT>",
    after_help = "\
Examples:
  smalto convert garden.ply garden.spz
  smalto convert garden.ply table.ply --crop sphere=0,1,2.5,3 --min-opacity 0.02
  smalto convert robot.spz ground.ply both.ply --transform scale=2 --transform translate=1,0,0
  smalto convert garden.ply garden.smalto --host-memory 8GB
  smalto convert zup.ply upright.ply --up z

Order of the steps: --flip and --up for each input, join, --transform, --crop, --min-opacity, --sh-degree.
The file is read back and compared before it replaces an existing one, but for a .smalto file, whose pages have \
checksums."
)]
pub(super) struct Args {
    /// Scene files as for `smalto render`, then the file to write
    #[arg(required = true, value_name = "FILE", long_help = format!(
        "Scene files as for `smalto render`, then the file to write: {}", written_labels()
    ))]
    files: Vec<PathBuf>,
    /// Format of the file to write [default: by its name]
    ///
    /// Needed for standard output (-) and for names without an ending, like /dev/stdout.
    #[arg(long, help_heading = OUTPUT, value_name = "FORMAT", value_parser = one_of(formats()))]
    #[arg(hide_possible_values = true)]
    format: Option<Target>,
    /// Version of the .spz file [default: 4]
    #[arg(long, help_heading = OUTPUT, value_name = "3|4", value_parser = whole::<u32>(3..=4))]
    spz_version: Option<u32>,
    /// Number formats of a .smalto file: lossless, balanced, fast, preview, u8
    ///
    /// lossless (the default) holds 32-bit floats: everything that the source holds; balanced 16-bit floats, as the
    /// preset stores a scene on the GPU; fast and preview the same, with the alpha threshold of the preset; u8 8 bits
    /// for spherical harmonics, scales and opacities.
    #[arg(long, help_heading = OUTPUT, value_name = "NAME", value_parser = one_of(pages::STORAGES))]
    #[arg(hide_possible_values = true)]
    storage: Option<Options>,
    /// Refuse to replace an existing file
    #[arg(long, help_heading = OUTPUT)]
    no_clobber: bool,
    #[command(flatten)]
    writing: WritingArgs,
    #[command(flatten)]
    edits: Edits,
    #[command(flatten)]
    reading: ReadingArgs,
}

/// The options that `smalto convert` and `smalto lod` share.
#[derive(clap::Args)]
struct WritingArgs {
    /// Memory for sorting the Gaussians of a .smalto file [default: 2GiB]
    #[arg(long, help_heading = OUTPUT, value_name = "SIZE", value_parser = values::memory)]
    host_memory: Option<u64>,
    /// Write the report as JSON; - prints it instead of the table
    #[arg(long, help_heading = OUTPUT, value_name = "FILE|-")]
    json: Option<Sink>,
}

/// Changes of a scene before it is written.
#[derive(clap::Args, Default)]
#[command(next_help_heading = SCENE)]
struct Edits {
    /// Leave out spherical harmonics above this degree
    #[arg(long, value_name = "DEGREE", value_parser = whole::<u32>(0..=u64::from(MAX_SH_DEGREE)))]
    sh_degree: Option<u32>,
    /// translate=X,Y,Z, rotate=X,Y,Z or scale=FACTOR; may be repeated
    ///
    /// Rotations are in degrees, about x, then y, then z. The steps are applied in order.
    #[arg(long, value_name = "STEP", allow_hyphen_values = true, value_parser = parse_step)]
    transform: Vec<Transform>,
    /// Keep the means in box=X,Y,Z,X,Y,Z or sphere=X,Y,Z,RADIUS
    ///
    /// The box is given by two corners.
    #[arg(long, value_name = "SHAPE", value_parser = parse_shape)]
    crop: Option<Shape>,
    /// Leave out Gaussians with a lower opacity, from 0 to 1
    #[arg(long, value_name = "OPACITY", value_parser = values::number(0.0..=1.0))]
    min_opacity: Option<f64>,
}

/// The scene files that are joined, and what changes them.
#[derive(Clone, Copy)]
struct Inputs<'a> {
    files: &'a [PathBuf],
    reading: ReadingArgs,
    edits: &'a Edits,
}

/// The region in which Gaussians are kept, in world units.
#[derive(Clone, Copy, Debug)]
enum Shape {
    Box([f64; 3], [f64; 3]),
    Sphere(DVec3, f64),
}

/// The report of `smalto convert --json`.
#[derive(Serialize, JsonSchema)]
#[schemars(title = "Report of `smalto convert`")]
pub(super) struct Report {
    /// The file that was written.
    file: String,
    format: String,
    bytes: u64,
    gaussians: usize,
    sh_degree: u32,
    /// Gaussians left out by --crop or --min-opacity.
    removed: usize,
    /// Gaussians left out because the format rounds their opacity to 0.
    transparent: usize,
    /// What the input files state and the output lacks or draws in another way, and what was dropped or changed.
    notices: Vec<String>,
    /// Differences between the file, read back, and the scene as it would be drawn: of opacities after the sigmoid, of
    /// unit rotations; of positions with their rounding when the scene was read. Empty for pages.
    loss: Vec<Loss>,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let Some((output, files)) = args.files.split_last().filter(|(_, files)| !files.is_empty()) else {
        return Err(Usage("expected the files to read, then the file to write".to_owned()).into());
    };
    let target = Target::of(output, args.format, args.spz_version)?;
    for (option, is_given) in
        [("--storage", args.storage.is_some()), ("--host-memory", args.writing.host_memory.is_some())]
    {
        if is_given && target != Target::Pages {
            return Err(Usage(format!("{option} needs a .smalto file to write")).into());
        }
    }
    target.check(output, files.iter().map(PathBuf::as_path), args.no_clobber, args.writing.json.as_ref())?;
    let inputs = Inputs { files, reading: args.reading.then(args.edits.placement()?), edits: &args.edits };
    let (written, removed, notices) = match target {
        Target::Pages => pages::convert(inputs, output, pages::settings(args.storage, args.writing.host_memory), None)?,
        Target::Scene(kind) => {
            let Scene { gaussians, report, is_antialiased, mut notices, .. } = read(inputs)?;
            let before = gaussians.len();
            let gaussians = args.edits.applied(gaussians)?;
            ensure!(!gaussians.is_empty(), "none of {before} Gaussians is left");
            let removed = before - gaussians.len();
            let written = write_scene(output, kind, gaussians, is_antialiased)?;
            notices.extend(report.notice());
            let loss = Loss::with_reading(written.loss, &report);
            (Written { loss, ..written }, removed, notices)
        }
    };
    say_written(written, removed, notices, args.writing.json.as_ref())
}

/// Prints what was written, and writes the report.
fn say_written(written: Written, removed: usize, notices: Vec<String>, json: Option<&Sink>) -> Result<()> {
    let Written { file, format, bytes, gaussians, sh_degree, transparent, loss } = written;
    let report = Report { file, format, bytes, gaussians, sh_degree, removed, transparent, notices, loss };
    print(&report)?;
    json.map_or(Ok(()), |sink| sink.write_json(&report))
}

/// Reads the inputs as one scene.
fn read(Inputs { files, reading, .. }: Inputs) -> Result<Scene> {
    let (mut parts, mut notices, mut is_antialiased) = (Vec::new(), Vec::new(), None);
    let mut report = LoadReport::default();
    for input in files {
        let scene = SceneArg { scene: input.clone(), reading }.read()?;
        if files.len() == 1 {
            return Ok(scene);
        }
        if is_antialiased.is_some_and(|others| others != scene.is_antialiased) {
            return Err(Usage(format!(
                "{} was trained {} antialiasing, unlike the files before it: one file cannot record both",
                input.display(),
                if scene.is_antialiased { "with" } else { "without" }
            ))
            .into());
        }
        is_antialiased = Some(scene.is_antialiased);
        notices.extend(scene.notices.iter().map(|notice| format!("{}: {notice}", input.display())));
        report = report.and(&scene.report);
        parts.push(scene.gaussians);
    }
    let gaussians = Gaussians::joined(parts.iter())?;
    let is_antialiased = is_antialiased.unwrap_or(false);
    Ok(Scene { gaussians, report, is_antialiased, notices, ..Scene::empty("several files") })
}

impl Edits {
    /// The steps of `--transform`, one after another. They are applied when the scene is read.
    fn placement(&self) -> Result<Transform> {
        self.transform.iter().try_fold(Transform::IDENTITY, |all, step| all.then(step))
    }

    /// The Gaussians after all other changes.
    fn applied(&self, mut gaussians: Gaussians) -> Result<Gaussians> {
        if self.crop.is_some() || self.min_opacity.is_some() {
            let least = self.min_opacity.unwrap_or(0.0) as f32;
            let is_kept = |i: &u32| {
                let mean = gaussians.means()[*i as usize].map(f64::from);
                gaussians.opacities()[*i as usize] >= least && self.crop.is_none_or(|shape| shape.contains(mean))
            };
            let kept: Vec<u32> = (0..gaussians.len() as u32).filter(is_kept).collect();
            gaussians = gaussians.selected(&kept)?;
        }
        Ok(match self.sh_degree {
            Some(degree) => gaussians.of_degree(degree),
            None => gaussians,
        })
    }
}

impl Shape {
    fn contains(self, mean: [f64; 3]) -> bool {
        match self {
            Self::Box(low, high) => (0..3).all(|axis| (low[axis]..=high[axis]).contains(&mean[axis])),
            Self::Sphere(centre, radius) => DVec3::from(mean).distance(centre) <= radius,
        }
    }
}

fn print(report: &Report) -> Result<()> {
    let Report { file, format, bytes, gaussians, sh_degree, removed, transparent, loss, .. } = report;
    say_file((file, format, *bytes), *gaussians, *sh_degree)?;
    if *removed > 0 {
        say!("  {removed} left out by --crop or --min-opacity")?;
    }
    say_loss(*transparent, loss)
}

/// Prints what a file that was written holds.
pub(super) fn say_file((file, format, bytes): (&str, &str, u64), gaussians: usize, sh_degree: u32) -> Result<()> {
    let (megabytes, each) = (bytes as f64 / 1e6, bytes as f64 / gaussians as f64);
    say!("{file}  {format}, {gaussians} Gaussians, SH degree {sh_degree}, {megabytes:.1} MB, {each:.1} bytes each")
}

/// Prints what a format lost.
pub(super) fn say_loss(transparent: usize, loss: &[Loss]) -> Result<()> {
    if transparent > 0 {
        say!("  {transparent} left out: the format rounds their opacity to 0")?;
    }
    if loss.is_empty() {
        return Ok(());
    }
    let mut rows = table(&["lost", "largest", "rms", "unit"]);
    for loss in loss {
        let number = |value: f64| if value == 0.0 { "0".to_owned() } else { format!("{value:.2e}") };
        rows.add_row(
            [loss.attribute.to_owned(), number(loss.largest), number(loss.rms), loss.unit.to_owned()].map(Cell::new),
        );
    }
    say_table(&rows)
}

fn parse_step(text: &str) -> Result<Transform> {
    let (rotation, translation, scale) = match text.split_once('=') {
        Some(("translate", by)) => (DQuat::IDENTITY, DVec3::from(numbers(by)?), 1.0),
        Some(("rotate", by)) => {
            let [x, y, z] = numbers::<3>(by)?.map(f64::to_radians);
            (DQuat::from_euler(EulerRot::ZYX, z, y, x), DVec3::ZERO, 1.0)
        }
        Some(("scale", by)) => (DQuat::IDENTITY, DVec3::ZERO, numbers::<1>(by)?[0]),
        _ => anyhow::bail!("expected translate=X,Y,Z, rotate=X,Y,Z or scale=FACTOR"),
    };
    Transform::new(rotation, translation, scale)
}

fn parse_shape(text: &str) -> Result<Shape> {
    match text.split_once('=') {
        Some(("box", corners)) => {
            let [x, y, z, u, v, w] = numbers(corners)?;
            let (a, b) = (DVec3::new(x, y, z), DVec3::new(u, v, w));
            Ok(Shape::Box(a.min(b).to_array(), a.max(b).to_array()))
        }
        Some(("sphere", ball)) => {
            let [x, y, z, radius] = numbers(ball)?;
            ensure!(radius > 0.0, "the radius of a sphere must be above 0, not {radius}");
            Ok(Shape::Sphere(DVec3::new(x, y, z), radius))
        }
        _ => anyhow::bail!("expected box=X,Y,Z,X,Y,Z or sphere=X,Y,Z,RADIUS"),
    }
}
