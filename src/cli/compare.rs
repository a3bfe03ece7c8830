//! `smalto compare`: how far pictures are apart, and whether that is too far.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};

use super::table::{say_table, table};
use super::{OverThreshold, Usage, progress, say, size_text};
use crate::files::{check_writable, write_whole};
use crate::measure::metrics::{Difference, Flip, Pair, Report, flip};
use crate::pixels::{FileKind, Pixels};
use crate::scene::Unreadable;

/// Compare pictures: error, PSNR, SSIM, FLIP, and what changes in 8 bits
#[derive(clap::Args)]
pub(super) struct Args {
    /// PNG, JPEG, EXR or .npy file, recognized by content; or a folder of them, compared with those of the same names.
    /// Alpha is not compared. One channel is grey, and NaN in it, where no depth is, 0
    a: PathBuf,
    /// The other file or folder; the order makes no difference
    b: PathBuf,
    /// Draw where FLIP sees a difference, black to bright, as PNG; for folders, to a folder
    #[arg(long, value_name = "FILE|DIR")]
    heatmap: Option<PathBuf>,
    /// Write the report as JSON (docs/compare.schema.json); - prints it instead of the table
    #[arg(long, value_name = "FILE|-")]
    json: Option<PathBuf>,
    /// Pixels in a degree of the field of view, at which FLIP takes the pictures to be seen
    #[arg(long, value_name = "PIXELS", default_value_t = crate::measure::metrics::PIXELS_PER_DEGREE, value_parser = within(1.0, 1000.0))]
    ppd: f64,
    /// Exit code 6 if a colour value differs by more, where white is 1. Like the others below it is never met by a
    /// picture with infinities or NaN
    #[arg(long, value_name = "ERROR", value_parser = within(0.0, 1e6))]
    max_error: Option<f64>,
    /// Exit code 6 if a PSNR is lower, in dB
    #[arg(long, value_name = "DB", value_parser = within(-1000.0, 1000.0))]
    min_psnr: Option<f64>,
    /// Exit code 6 if an SSIM is lower, from -1 to 1
    #[arg(long, value_name = "SSIM", value_parser = within(-1.0, 1.0))]
    min_ssim: Option<f64>,
    /// Exit code 6 if a mean FLIP is higher, from 0 to 1
    #[arg(long, value_name = "FLIP", value_parser = within(0.0, 1.0))]
    max_flip: Option<f64>,
}

/// A number from `low` to `high`.
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
    let worst = Difference::worst(compared.iter().map(|pair| &pair.difference)).context("there is a pair")?;
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

/// The files to compare: these two, or those of one name in two folders.
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

/// The files in a folder but for hidden ones.
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

/// Fails if a file is in one folder alone.
fn partners(folder: &Path, names: &BTreeSet<OsString>, other: &Path, others: &BTreeSet<OsString>) -> Result<()> {
    let mut alone = names.difference(others);
    if let Some(name) = alone.next() {
        let more = match alone.count() {
            0 => String::new(),
            more => format!(", nor have {more} more"),
        };
        bail!("{} has no partner in {}{more}", folder.join(name).display(), other.display());
    }
    Ok(())
}

/// What cannot be written is known before anything is compared, and nothing is written over a picture.
fn check_outputs(args: &Args, pairs: &[[PathBuf; 2]], is_folder: bool) -> Result<()> {
    let json = args.json.as_deref().filter(|file| file.as_os_str() != "-");
    let inputs: BTreeSet<_> =
        pairs.iter().flatten().chain([&args.a, &args.b]).filter_map(|file| file.canonicalize().ok()).collect();
    for output in args.heatmap.as_deref().into_iter().chain(json) {
        if output.canonicalize().is_ok_and(|output| inputs.contains(&output)) {
            return Err(Usage(format!("{} would be written over, and is to be compared", output.display())).into());
        }
    }
    match args.heatmap.as_deref() {
        Some(folder) if is_folder => {
            fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?
        }
        Some(file) if FileKind::of(file).ok() != Some(FileKind::Png) => {
            return Err(Usage(format!("--heatmap {}: it is written as .png", file.display())).into());
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
        "{} is of {} pixels and {} of {}: pictures to compare have one size",
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

/// The map as colours from black over purple and orange to pale yellow.
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

/// A heatmap's name in its folder.
fn picture_name(pair: &Pair) -> String {
    let name = name(&pair.a);
    if name.ends_with(".png") { name } else { format!("{name}.png") }
}

fn title(pair: &Pair) -> String {
    let (a, b) = (name(&pair.a), name(&pair.b));
    if a == b { a } else { format!("{a}, {b}") }
}

/// A row a pair; for folders, the worst of each column below.
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

/// A measure and how bad it may be.
struct Limit {
    option: &'static str,
    measure: &'static str,
    bound: f64,
    /// Whether larger is better.
    is_least: bool,
    /// `None` where there is no such measure.
    value: fn(&Difference) -> Option<f64>,
}

impl Limit {
    /// Those that were asked for.
    fn all(args: &Args) -> Vec<Self> {
        let limit = |option, measure, bound: Option<f64>, is_least, value| {
            bound.map(|bound| Self { option, measure, bound, is_least, value })
        };
        // The difference of two values is an f32, and so is what it is held against.
        let max_error = args.max_error.map(|bound| f64::from(bound as f32));
        let all = [
            limit("--max-error", "largest error", max_error, false, |d| Some(f64::from(d.max_error))),
            limit("--min-psnr", "PSNR", args.min_psnr, true, |d| Some(d.psnr_db.unwrap_or(f64::INFINITY))),
            limit("--min-ssim", "SSIM", args.min_ssim, true, |d| d.ssim),
            limit("--max-flip", "FLIP", args.max_flip, false, |d| Some(d.flip)),
        ];
        all.into_iter().flatten().collect()
    }

    /// By how much a difference is over it; infinitely if it holds no such measure or no finite one.
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

    /// What is wrong with the pair that is farthest over, if one is.
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
            (0, None) => format!("{title}: it is too small for {option} {bound}, {measure} takes 11 pixels a side"),
            (pixels, _) => format!("{title}: {pixels} of its pixels are not finite, which no {option} allows"),
        })
    }
}

/// Fails if a pair is over a threshold.
fn judge(args: &Args, pairs: &[Pair]) -> Result<()> {
    let mut complaints: Vec<_> = Limit::all(args).iter().filter_map(|limit| limit.complaint(pairs)).collect();
    complaints.dedup();
    if complaints.is_empty() { Ok(()) } else { Err(OverThreshold(complaints.join("; ")).into()) }
}
