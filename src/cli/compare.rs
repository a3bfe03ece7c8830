//! `smalto compare`: the differences of pictures, and whether they are over a threshold.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};

use super::table::{say_table, table};
use super::{OverThreshold, Usage, progress, say, size_text};
use crate::files::{check_writable, write_whole};
use crate::measure::metrics::{Difference, Flip, PIXELS_PER_DEGREE, Pair, Report, flip};
use crate::pixels::{FileKind, Pixels};
use crate::scene::Unreadable;

/// Compare pictures: largest error, PSNR, SSIM, FLIP and changes in 8 bits
#[derive(clap::Args)]
pub(super) struct Args {
    /// PNG, JPEG, EXR or .npy file, recognized by its content; or a folder, whose files are compared with those of the
    /// same names. Alpha is ignored. A single channel is read as grey, and NaN in it (no depth) as 0
    a: PathBuf,
    /// The other file or folder. The order of the two does not matter
    b: PathBuf,
    /// Write the FLIP map as PNG, from black (equal) to bright (different); for folders, into a folder
    #[arg(long, value_name = "FILE|DIR")]
    heatmap: Option<PathBuf>,
    /// Write the report as JSON (docs/compare.schema.json); - prints it instead of the table
    #[arg(long, value_name = "FILE|-")]
    json: Option<PathBuf>,
    /// Pixels per degree of the viewer's field of view, for FLIP
    #[arg(long, value_name = "PIXELS", default_value_t = PIXELS_PER_DEGREE, value_parser = within(1.0, 1000.0))]
    ppd: f64,
    /// Exit code 6 if a colour value differs by more; white is 1. No threshold is met by a picture with infinities or
    /// NaN
    #[arg(long, value_name = "ERROR", value_parser = within(0.0, 1e6))]
    max_error: Option<f64>,
    /// Exit code 6 if the PSNR of a pair is lower, in dB
    #[arg(long, value_name = "DB", value_parser = within(-1000.0, 1000.0))]
    min_psnr: Option<f64>,
    /// Exit code 6 if the SSIM of a pair is lower, from -1 to 1
    #[arg(long, value_name = "SSIM", value_parser = within(-1.0, 1.0))]
    min_ssim: Option<f64>,
    /// Exit code 6 if the mean FLIP of a pair is higher, from 0 to 1
    #[arg(long, value_name = "FLIP", value_parser = within(0.0, 1.0))]
    max_flip: Option<f64>,
}

/// Parses a number from `low` to `high`.
fn within(low: f64, high: f64) -> impl Fn(&str) -> Result<f64> + Clone {
    move |text| match text.parse() {
        Ok(number) if (low..=high).contains(&number) => Ok(number),
        _ => bail!("expected a number from {low} to {high}"),
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    let pairs = pairs(&args.a, &args.b)?;
    let is_folder = args.a.is_dir();
    check_outputs(args, &pairs, is_folder)?;
    let bar = progress::Bar::new("comparing");
    let mut compared = Vec::new();
    for (done, pair) in pairs.iter().enumerate() {
        bar.set(done as f64 / pairs.len() as f64);
        let (pair, flip) = compare(pair, args.ppd)?;
        if let Some(heatmap) = &args.heatmap {
            let file = if is_folder { heatmap.join(picture_name(&pair)) } else { heatmap.clone() };
            draw(&flip, pair.size).write_png(&file, false)?;
        }
        compared.push(pair);
    }
    drop(bar);
    let worst =
        Difference::worst(compared.iter().map(|pair| &pair.difference)).context("there are no pictures to compare")?;
    let report = Report { format: Report::FORMAT.to_owned(), pixels_per_degree: args.ppd, pairs: compared, worst };
    match &args.json {
        Some(file) if file.as_os_str() == "-" => say!("{}", serde_json::to_string_pretty(&report)?)?,
        Some(file) => {
            print(&report, is_folder)?;
            write_whole(file, |file| Ok(serde_json::to_writer_pretty(file, &report)?))?;
        }
        None => print(&report, is_folder)?,
    }
    judge(args, &report.pairs)
}

/// The files to compare: `a` and `b`, or the files with the same name in both folders.
fn pairs(a: &Path, b: &Path) -> Result<Vec<[PathBuf; 2]>> {
    match [a, b].map(Path::is_dir) {
        [false, false] => Ok(vec![[a.to_owned(), b.to_owned()]]),
        [true, true] => {
            let names = [file_names(a)?, file_names(b)?];
            partners(a, &names[0], b, &names[1])?;
            partners(b, &names[1], a, &names[0])?;
            ensure!(!names[0].is_empty(), "{} and {} hold no files", a.display(), b.display());
            Ok(names[0].iter().map(|name| [a.join(name), b.join(name)]).collect())
        }
        [is_folder, _] => {
            let (folder, file) = if is_folder { (a, b) } else { (b, a) };
            let (folder, file) = (folder.display(), file.display());
            Err(Usage(format!("{folder} is a folder and {file} is not: expected two files or two folders")).into())
        }
    }
}

/// The names of the files in a folder, without hidden ones.
fn file_names(folder: &Path) -> Result<BTreeSet<OsString>> {
    let unreadable = || format!("cannot read the folder {}", folder.display());
    let mut names = BTreeSet::new();
    for entry in fs::read_dir(folder).with_context(unreadable)? {
        let entry = entry.with_context(unreadable)?;
        if entry.path().is_file() && !entry.file_name().as_encoded_bytes().starts_with(b".") {
            names.insert(entry.file_name());
        }
    }
    Ok(names)
}

/// Fails if a file of `folder` is missing in `other`.
fn partners(folder: &Path, names: &BTreeSet<OsString>, other: &Path, others: &BTreeSet<OsString>) -> Result<()> {
    let mut alone = names.difference(others);
    if let Some(name) = alone.next() {
        let more = match alone.count() {
            0 => String::new(),
            more => format!(", and {more} more have none"),
        };
        bail!("{} has no partner in {}{more}", folder.join(name).display(), other.display());
    }
    Ok(())
}

/// Fails before anything is compared if an output cannot be written or would overwrite an input.
fn check_outputs(args: &Args, pairs: &[[PathBuf; 2]], is_folder: bool) -> Result<()> {
    let json = args.json.as_deref().filter(|file| file.as_os_str() != "-");
    let inputs: BTreeSet<_> =
        pairs.iter().flatten().chain([&args.a, &args.b]).filter_map(|file| file.canonicalize().ok()).collect();
    for output in args.heatmap.as_deref().into_iter().chain(json) {
        if output.canonicalize().is_ok_and(|output| inputs.contains(&output)) {
            return Err(Usage(format!("{} is an input and would be overwritten", output.display())).into());
        }
    }
    match args.heatmap.as_deref() {
        Some(folder) if is_folder => {
            fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?
        }
        Some(file) if FileKind::of(file).ok() != Some(FileKind::Png) => {
            return Err(Usage(format!("--heatmap {}: expected a name that ends in .png", file.display())).into());
        }
        Some(file) => check_writable(file)?,
        None => {}
    }
    json.map_or(Ok(()), check_writable)
}

fn compare([a, b]: &[PathBuf; 2], ppd: f64) -> Result<(Pair, Flip)> {
    let pixels = [read(a)?, read(b)?];
    let [size, other] = pixels.each_ref().map(|p| p.size);
    ensure!(
        size == other,
        "{} has {} pixels and {} has {}: pictures must have the same size",
        a.display(),
        size_text(size),
        b.display(),
        size_text(other)
    );
    let flip = flip(&pixels[0], &pixels[1], ppd);
    let difference = Difference::with_flip(&pixels[0], &pixels[1], &flip);
    Ok((Pair { a: a.display().to_string(), b: b.display().to_string(), size, difference }, flip))
}

fn read(file: &Path) -> Result<Pixels> {
    Pixels::read(file).map_err(|problem| Unreadable::new(file, &problem).into())
}

/// The FLIP map in the magma colour map: black, purple, orange, pale yellow.
fn draw(flip: &Flip, size: [u32; 2]) -> Pixels {
    let colour = |value: &f32| {
        let (r, g, b) = colorous::MAGMA.eval_rational((value * 255.0).round() as usize, 256).as_tuple();
        [r, g, b, 255].map(|channel| f32::from(channel) / 255.0)
    };
    Pixels { size, rgba: flip.map.iter().map(colour).collect() }
}

fn name(path: &str) -> String {
    Path::new(path).file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The file name of a heatmap in its folder.
fn picture_name(pair: &Pair) -> String {
    let name = name(&pair.a);
    if name.ends_with(".png") { name } else { format!("{name}.png") }
}

fn title(pair: &Pair) -> String {
    let (a, b) = (name(&pair.a), name(&pair.b));
    if a == b { a } else { format!("{a}, {b}") }
}

/// Prints one row per pair and, for folders, the worst value of each column.
fn print(report: &Report, is_folder: bool) -> Result<()> {
    let header = [
        "",
        "max error",
        "PSNR dB",
        "SSIM",
        "FLIP",
        "> 1/255",
        "> 4/255",
        "> 16/255",
        "8-bit changed",
        "step",
        "not finite",
    ];
    let mut rows = table(&header);
    for pair in &report.pairs {
        rows.add_row(row(title(pair), &pair.difference));
    }
    if is_folder {
        rows.add_row(row("worst".to_owned(), &report.worst));
    }
    say_table(&rows)
}

fn row(title: String, difference: &Difference) -> [String; 11] {
    let Difference { max_error, psnr_db, ssim, flip, over, changed8, largest_step, non_finite, .. } = difference;
    let percent = |fraction: f64| format!("{:.3} %", fraction * 100.0);
    [
        title,
        if *max_error < 1e4 { format!("{max_error:.6}") } else { format!("{max_error:.1e}") },
        psnr_db.map_or_else(|| "equal".to_owned(), |db| format!("{db:.2}")),
        ssim.map_or_else(|| "-".to_owned(), |ssim| format!("{ssim:.6}")),
        format!("{flip:.6}"),
        percent(over.steps_1),
        percent(over.steps_4),
        percent(over.steps_16),
        percent(*changed8),
        largest_step.to_string(),
        non_finite.to_string(),
    ]
}

/// A threshold on a measure.
struct Limit {
    option: &'static str,
    measure: &'static str,
    bound: f64,
    /// Larger values are better, so the bound is the least allowed.
    is_least: bool,
    /// `None` if the pair has no such measure.
    value: fn(&Difference) -> Option<f64>,
}

impl Limit {
    /// The thresholds on the command line.
    fn all(args: &Args) -> Vec<Self> {
        let limit = |option, measure, bound: Option<f64>, is_least, value| {
            bound.map(|bound| Self { option, measure, bound, is_least, value })
        };
        // The largest difference is an f32, so the bound is rounded in the same way.
        let max_error = args.max_error.map(|bound| f64::from(bound as f32));
        let all = [
            limit("--max-error", "largest error", max_error, false, |d| Some(f64::from(d.max_error))),
            limit("--min-psnr", "PSNR", args.min_psnr, true, |d| Some(d.psnr_db.unwrap_or(f64::INFINITY))),
            limit("--min-ssim", "SSIM", args.min_ssim, true, |d| d.ssim),
            limit("--max-flip", "FLIP", args.max_flip, false, |d| Some(d.flip)),
        ];
        all.into_iter().flatten().collect()
    }

    /// The amount by which a difference is over the threshold; infinite if the measure is missing or not finite.
    fn excess(&self, difference: &Difference) -> f64 {
        match (self.value)(difference) {
            Some(value) if difference.non_finite == 0 && !value.is_nan() => {
                if self.is_least {
                    self.bound - value
                } else {
                    value - self.bound
                }
            }
            _ => f64::INFINITY,
        }
    }

    /// Describes the pair that is farthest over the threshold, if any is over it.
    fn complaint(&self, pairs: &[Pair]) -> Option<String> {
        let excess = |pair: &&Pair| self.excess(&pair.difference);
        let worst = pairs.iter().filter(|pair| excess(pair) > 0.0).max_by(|x, y| excess(x).total_cmp(&excess(y)))?;
        let (title, Self { option, measure, bound, .. }) = (title(worst), self);
        let bound = *bound as f32;
        Some(match (worst.difference.non_finite, (self.value)(&worst.difference)) {
            (0, Some(value)) => {
                let than = if self.is_least { "under" } else { "over" };
                format!("{title}: {measure} {} is {than} {option} {bound}", value as f32)
            }
            (0, None) => format!("{title}: too small for {option} {bound}: {measure} needs at least 11x11 pixels"),
            (pixels, _) => format!("{title}: pixels with infinities or NaN: {pixels}; {option} allows none"),
        })
    }
}

/// Fails if a pair is over a threshold.
fn judge(args: &Args, pairs: &[Pair]) -> Result<()> {
    let mut complaints: Vec<_> = Limit::all(args).iter().filter_map(|limit| limit.complaint(pairs)).collect();
    complaints.dedup();
    if complaints.is_empty() { Ok(()) } else { Err(OverThreshold(complaints.join("; ")).into()) }
}
