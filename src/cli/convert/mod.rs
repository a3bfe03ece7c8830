//! `smalto convert`: writes one or several scenes to another file, optionally changed.

pub(super) mod lod;
mod pages;

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use anyhow::{Result, ensure};
use comfy_table::Cell;
use glam::{DQuat, DVec3, EulerRot};
use schemars::JsonSchema;
use serde::Serialize;

use super::table::{say_table, table};
use super::{REPORTS_TO_STDOUT, ReadingArgs, SceneArg, Sink, Usage, numbers, one_of, progress, remark, say};
use crate::files::{check_absent, check_binary_writable, is_stdout, write_checked};
use crate::options::Options;
use crate::scene::{self, Gaussians, Loss, MAX_SH_DEGREE, Scene, SceneFile, Transform, write_sog_folder};

/// Convert a scene, or several joined, to another file, and report what the format loses
#[derive(clap::Args)]
#[command(
    override_usage = "smalto convert [OPTIONS] <IN>... <OUT>",
    after_help = "\
Order of the steps: --flip and --up for each input, join, --transform, --crop, --min-opacity, --sh-degree.
The file is read back and compared before it replaces an existing one, but for a .smalto file, whose pages have
checksums."
)]
pub(super) struct Args {
    /// Scene files as for `smalto render`, then the file to write: .ply, .compressed.ply, .splat, .spz, .sog, meta.json
    /// (a SOG in a folder), .glb or .smalto (pages)
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Format of the file to write [default: by its name]. Needed for standard output (-) and for names without an
    /// ending, like /dev/stdout
    #[arg(long, value_name = "FORMAT", value_parser = one_of(FORMATS))]
    format: Option<Target>,
    /// Refuse to replace an existing file
    #[arg(long)]
    no_clobber: bool,
    /// Leave out spherical harmonics above this degree
    #[arg(long, value_name = "DEGREE", value_parser = clap::value_parser!(u32).range(0..=i64::from(MAX_SH_DEGREE)))]
    sh_degree: Option<u32>,
    /// translate=X,Y,Z, rotate=X,Y,Z (degrees about x, then y, then z) or scale=FACTOR. May be given several times; the
    /// steps are applied in order
    #[arg(long, value_name = "STEP", allow_hyphen_values = true, value_parser = parse_step)]
    transform: Vec<Transform>,
    /// Keep the Gaussians whose means lie in box=X,Y,Z,X,Y,Z (two corners) or sphere=X,Y,Z,RADIUS
    #[arg(long, value_name = "SHAPE", value_parser = parse_shape)]
    crop: Option<Shape>,
    /// Leave out Gaussians with a lower opacity, from 0 to 1
    #[arg(long, value_name = "OPACITY")]
    min_opacity: Option<f32>,
    /// Version of the .spz file [default: 4]
    #[arg(long, value_name = "3|4", value_parser = clap::value_parser!(u32).range(3..=4))]
    spz_version: Option<u32>,
    /// Number formats of a .smalto file [default: lossless]
    #[arg(long, value_name = "NAME", value_parser = one_of(pages::STORAGES))]
    storage: Option<Options>,
    /// Megabytes of memory in which the Gaussians of a .smalto file are sorted [default: 2048]
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    memory: Option<u32>,
    /// Write the report as JSON; - prints it instead of the table
    #[arg(long, value_name = "FILE|-")]
    json: Option<Sink>,
    #[command(flatten)]
    reading: ReadingArgs,
}

/// What is written.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Target {
    Scene(SceneFile),
    /// A page file.
    Pages,
}

const FORMATS: [(&str, &str, Target); 7] = [
    ("ply", "32-bit floats", Target::Scene(SceneFile::Ply)),
    ("compressed.ply", "The compressed PLY of PlayCanvas", Target::Scene(SceneFile::CompressedPly)),
    ("splat", "32 bytes per Gaussian", Target::Scene(SceneFile::Splat)),
    ("spz", "SPZ", Target::Scene(SceneFile::Spz { version: 4 })),
    ("sog", "SOG in one file", Target::Scene(SceneFile::Sog)),
    ("glb", "Binary glTF, 32-bit floats", Target::Scene(SceneFile::Glb)),
    ("smalto", "Pages, for scenes larger than memory", Target::Pages),
];

/// The region in which Gaussians are kept, in world units.
#[derive(Clone, Copy, Debug)]
enum Shape {
    Box([f64; 3], [f64; 3]),
    Sphere(DVec3, f64),
}

/// The report of `smalto convert --json`.
#[derive(Serialize, JsonSchema)]
#[schemars(title = "Report of `smalto convert`")]
struct Report {
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
    /// Differences between the file, read back, and the scene as it would be drawn: of opacities after the sigmoid, of
    /// unit rotations. Empty for pages.
    loss: Vec<Loss>,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let Some((output, inputs)) = args.files.split_last().filter(|(_, inputs)| !inputs.is_empty()) else {
        return Err(Usage("expected the files to read, then the file to write".to_owned()).into());
    };
    let mut kind = kind(output, args.format)?;
    match (&mut kind, args.spz_version) {
        (Target::Scene(SceneFile::Spz { version }), Some(wanted)) => *version = wanted,
        (_, Some(_)) => return Err(Usage("--spz-version needs an .spz file to write".to_owned()).into()),
        (_, None) => {}
    }
    for (option, is_given) in [("--storage", args.storage.is_some()), ("--memory", args.memory.is_some())] {
        if is_given && kind != Target::Pages {
            return Err(Usage(format!("{option} needs a .smalto file to write")).into());
        }
    }
    if let Some(opacity) = args.min_opacity.filter(|opacity| !(0.0..=1.0).contains(opacity)) {
        return Err(Usage(format!("--min-opacity {opacity}: expected a number from 0 to 1")).into());
    }
    if let Some(input) = inputs.iter().find(|input| is_same(input, output)) {
        return Err(Usage(format!("{} is both an input and the output", input.display())).into());
    }
    if is_stdout(output) {
        let takes_stdout = args.json.as_ref().is_some_and(|sink| sink.file().is_none_or(is_stdout));
        if takes_stdout {
            return Err(Usage("the scene and --json cannot both go to standard output".to_owned()).into());
        }
        REPORTS_TO_STDOUT.store(true, Ordering::Relaxed);
    }
    args.json.as_ref().map_or(Ok(()), Sink::check)?;
    if args.no_clobber {
        check_absent(output)?;
    }
    if kind != Target::Scene(SceneFile::SogFolder) {
        check_binary_writable(output)?;
    }
    let Target::Scene(kind) = kind else {
        let report = pages::convert(args, inputs, output, false)?;
        print(&report)?;
        return args.json.as_ref().map_or(Ok(()), |sink| sink.write_json(&report));
    };
    let (gaussians, is_antialiased) = read(args, inputs)?;
    let before = gaussians.len();
    let gaussians = changed(args, gaussians)?;
    ensure!(!gaussians.is_empty(), "none of {before} Gaussians is left");
    if is_antialiased && !kind.says_antialiased() {
        remark(&format!(
            "warning: {}: the format cannot record that the scene was trained with antialiasing",
            output.display()
        ));
    }
    let arranged = kind.arranged(&gaussians)?;
    let (removed, transparent) = (before - gaussians.len(), gaussians.len() - arranged.len());
    let lost_degrees = arranged.sh_degree() < gaussians.sh_degree();
    ensure!(!arranged.is_empty(), "the format rounds the opacity of all {} Gaussians to 0", gaussians.len());
    drop(gaussians);
    if lost_degrees {
        remark(&format!(
            "warning: {}: the format holds spherical harmonics up to degree {} only",
            output.display(),
            arranged.sh_degree()
        ));
    }
    let (format, bytes, loss) = write(output, kind, &arranged, is_antialiased)?;
    let report = Report {
        file: output.display().to_string(),
        format,
        bytes,
        gaussians: arranged.len(),
        sh_degree: arranged.sh_degree(),
        removed,
        transparent,
        loss,
    };
    print(&report)?;
    args.json.as_ref().map_or(Ok(()), |sink| sink.write_json(&report))
}

/// Reads the inputs as one scene. The second value is true if it was trained with antialiasing.
fn read(args: &Args, inputs: &[PathBuf]) -> Result<(Gaussians, bool)> {
    let (mut parts, mut is_antialiased) = (Vec::new(), None);
    for input in inputs {
        let scene = SceneArg { scene: input.clone(), reading: args.reading }.read()?;
        if is_antialiased.is_some_and(|others| others != scene.is_antialiased) {
            return Err(Usage(format!(
                "{} was trained {} antialiasing, unlike the files before it: one file cannot record both",
                input.display(),
                if scene.is_antialiased { "with" } else { "without" }
            ))
            .into());
        }
        is_antialiased = Some(scene.is_antialiased);
        parts.push(scene.gaussians);
    }
    let joined = if parts.len() == 1 { parts.remove(0) } else { Gaussians::joined(parts.iter())? };
    Ok((joined, is_antialiased.unwrap_or(false)))
}

fn changed(args: &Args, mut gaussians: Gaussians) -> Result<Gaussians> {
    let mut transform = Transform::IDENTITY;
    for step in &args.transform {
        transform = transform.then(step)?;
    }
    if transform != Transform::IDENTITY {
        gaussians = gaussians.transformed(&transform)?;
    }
    if args.crop.is_some() || args.min_opacity.is_some() {
        let least = args.min_opacity.unwrap_or(0.0);
        let is_kept = |i: &u32| {
            let mean = gaussians.means()[*i as usize].map(f64::from);
            gaussians.opacities()[*i as usize] >= least && args.crop.is_none_or(|shape| shape.contains(mean))
        };
        let kept: Vec<u32> = (0..gaussians.len() as u32).filter(is_kept).collect();
        gaussians = gaussians.selected(&kept)?;
    }
    Ok(match args.sh_degree {
        Some(degree) => gaussians.of_degree(degree),
        None => gaussians,
    })
}

impl Shape {
    fn contains(self, mean: [f64; 3]) -> bool {
        match self {
            Self::Box(low, high) => (0..3).all(|axis| (low[axis]..=high[axis]).contains(&mean[axis])),
            Self::Sphere(centre, radius) => DVec3::from(mean).distance(centre) <= radius,
        }
    }
}

/// The format of the output: by `--format` or its name. Fails if the two disagree.
fn kind(output: &Path, format: Option<Target>) -> Result<Target, Usage> {
    let is_pages = output.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("smalto"));
    let named = if is_pages { Ok(Target::Pages) } else { SceneFile::of(output).map(Target::Scene) };
    match (named, format) {
        (Ok(named), None) => Ok(named),
        (Ok(named), Some(format)) if named != format => {
            Err(Usage(format!("--format: {} has the name of another format", output.display())))
        }
        (_, Some(format)) => Ok(format),
        (Err(_), None) if output.extension().is_none() => {
            Err(Usage(format!("{}: its name does not say which format it has: add --format", output.display())))
        }
        (Err(problem), None) => Err(Usage(format!("{problem:#}"))),
    }
}

/// True if the scene `input`, a file or a folder, is in the file `output`.
fn is_same(input: &Path, output: &Path) -> bool {
    let Ok(output) = output.canonicalize() else { return false };
    let in_folder = scene::in_folder(input);
    [in_folder.clone(), in_folder.join("meta.json")].iter().any(|file| file.canonicalize().is_ok_and(|f| f == output))
}

/// Writes the file and reads it back. Returns the name of its format, its size in bytes, for a folder that of all its
/// files, and the losses.
fn write(
    output: &Path,
    kind: SceneFile,
    gaussians: &Gaussians,
    is_antialiased: bool,
) -> Result<(String, u64, Vec<Loss>)> {
    let bar = progress::Bar::new("reading back");
    let read_again = |written: &Path| {
        let Scene { gaussians: read, format, .. } = scene::read(written, &|fraction| bar.set(fraction))?;
        let (count, expected) = (read.len(), gaussians.len());
        ensure!(count == expected, "{count} of {expected} Gaussians could be read back");
        let bytes = if kind == SceneFile::SogFolder { all_bytes(written.parent())? } else { written.metadata()?.len() };
        Ok((format, bytes, Loss::between(gaussians, &read)))
    };
    if kind == SceneFile::SogFolder {
        let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        return write_sog_folder(gaussians, is_antialiased, folder, read_again);
    }
    // Only a .splat is recognized by its name.
    let ending = if kind == SceneFile::Splat { ".splat" } else { "" };
    write_checked(output, ending, |file| kind.write(gaussians, is_antialiased, file), read_again)
}

/// The size of all files in a folder.
fn all_bytes(folder: Option<&Path>) -> Result<u64> {
    let files = std::fs::read_dir(folder.unwrap_or(Path::new(".")))?;
    files.map(|file| Ok(file?.metadata()?.len())).sum()
}

fn print(report: &Report) -> Result<()> {
    let Report { file, format, bytes, gaussians, sh_degree, removed, transparent, loss } = report;
    let (megabytes, each) = (*bytes as f64 / 1e6, *bytes as f64 / *gaussians as f64);
    say!("{file}  {format}, {gaussians} Gaussians, SH degree {sh_degree}, {megabytes:.1} MB, {each:.1} bytes each")?;
    if *removed > 0 {
        say!("  {removed} left out by --crop or --min-opacity")?;
    }
    if *transparent > 0 {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_schema_of_the_report_is_documented() {
        crate::cli::sink::assert_documented::<Report>("convert");
    }
}
