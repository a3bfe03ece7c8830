//! `smalto compare`: the differences of pictures, with thresholds.
//!
//! - `folders` - pairs of files, from two folders
//! - `limits` - thresholds
//! - `tables` - tables on the terminal

mod folders;
mod limits;
mod tables;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use rayon::prelude::*;

use crate::cli::headings::{MEASURING, REPORTS};
use crate::cli::sink::Sink;
use crate::cli::values::{MOST_ERROR, number};
use crate::cli::{Usage, progress, size_text, values};
use crate::files::{check_writable, make_folder};
use crate::host_memory::check_free;
use crate::measure::metrics::{
    AlphaDifference, BYTES_PER_PIXEL, Difference, NumberDifference, PIXELS_PER_DEGREE, Pair, Report, flip,
    relative_errors,
};
use crate::pixels::{Alpha, Channels, Compression, FileKind, Picture, Pixels};
use crate::scene::Unreadable;
use folders::{Files, pairs};

/// Compare pictures: largest error, PSNR, SSIM, FLIP and changes in 8 bits; errors of depths and of alpha
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  smalto compare plush.exr exact.exr
  smalto compare views/ reference/ --heatmap flip/
  smalto compare views/ reference/ --min-psnr 60 --max-flip 0.01
  smalto compare renders/ photographs/ --partial
  smalto compare a.depth.exr b.depth.exr --max-depth-error 0.01")]
pub(super) struct Args {
    /// Picture (PNG, JPEG, EXR, .npy), or folder of pictures
    ///
    /// A file is recognized by its content. Pictures of a folder and of the folders below it are compared with those of
    /// the same names but for the ending, such as renders with photographs. Colours with alpha are compared as seen
    /// over black, alpha by itself if both files have it. A single channel of floats, such as depths, is compared as
    /// numbers: absolute and relative errors.
    a: PathBuf,
    /// The other file or folder. The order of the two does not matter
    b: PathBuf,
    /// Compare only the pictures of two folders that have a partner
    ///
    /// The number of pictures without a partner is printed. Without this option, such a picture is an error.
    #[arg(long, help_heading = MEASURING)]
    partial: bool,
    /// Pixels per degree of the viewer's field of view, for FLIP
    #[arg(long, help_heading = MEASURING, value_name = "PIXELS", default_value_t = PIXELS_PER_DEGREE)]
    #[arg(value_parser = number(1.0..=1000.0))]
    ppd: f64,
    /// Largest difference of a colour value, like 0.02 or 4/255
    ///
    /// White is 1. No threshold is met by a picture with infinities or NaN.
    #[arg(long, help_heading = LIMITS, value_name = "ERROR", value_parser = values::error(MOST_ERROR))]
    max_error: Option<f64>,
    /// Least PSNR of a pair, in dB
    #[arg(long, help_heading = LIMITS, value_name = "DB", value_parser = number(-1000.0..=1000.0))]
    min_psnr: Option<f64>,
    /// Least SSIM of a pair, from -1 to 1
    #[arg(long, help_heading = LIMITS, value_name = "SSIM", value_parser = number(-1.0..=1.0))]
    min_ssim: Option<f64>,
    /// Largest mean FLIP of a pair, from 0 to 1
    #[arg(long, help_heading = LIMITS, value_name = "FLIP", value_parser = number(0.0..=1.0))]
    max_flip: Option<f64>,
    /// Largest difference of alpha, if both pictures have it
    ///
    /// Full coverage is 1.
    #[arg(long, help_heading = LIMITS, value_name = "ERROR", value_parser = values::error(MOST_ERROR))]
    max_alpha_error: Option<f64>,
    /// Largest difference of depths or other numbers
    ///
    /// In their own unit. For pictures of a single channel of floats, which meet no threshold of colours. A pixel with
    /// a number in only one of two pictures exceeds it.
    #[arg(long, help_heading = LIMITS, value_name = "ERROR", value_parser = number(0.0..=1e30))]
    max_depth_error: Option<f64>,
    /// Largest fraction of depths that differ by over 1 %
    ///
    /// From 0 to 1, for pictures of a single channel of floats. A pixel with a number in only one of two pictures
    /// counts.
    #[arg(long, help_heading = LIMITS, value_name = "FRACTION", value_parser = number(0.0..=1.0))]
    max_depth_outliers: Option<f64>,
    /// Write the FLIP map as PNG: black where equal; a folder for folders
    ///
    /// Of depths, the relative error, brightest from 10 % on.
    #[arg(long, help_heading = REPORTS, value_name = "FILE|DIR")]
    heatmap: Option<PathBuf>,
    /// Write the report as JSON; - prints it instead of the table
    ///
    /// Schema: docs/schemas/compare.schema.json.
    #[arg(long, help_heading = REPORTS, value_name = "FILE|-")]
    json: Option<Sink>,
}

const LIMITS: &str = "Limits (exit code 6 if a pair exceeds one)";

/// Memory that a comparison needs at any size: rows of every thread, the encoder of a heatmap.
const OTHER_BYTES: u64 = 32 << 20;

/// Memory for pairs that are compared at the same time.
const AT_ONCE_BYTES: u64 = 4 << 30;

/// A pair that was compared.
struct Compared {
    /// Name in tables and messages.
    title: String,
    pair: Pair,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let pairs = pairs(&args.a, &args.b, args.partial)?;
    let is_folder = args.a.is_dir();
    if args.partial && !is_folder {
        return Err(Usage("--partial needs two folders".to_owned()).into());
    }
    check_outputs(args, &pairs, is_folder)?;
    // Threads reserve address space with their first allocation. They do so now, before the free memory is checked.
    rayon::broadcast(|_| drop(std::hint::black_box(Vec::<u8>::with_capacity(1024))));
    let compared = compare_all(args, &pairs, is_folder)?;
    let report = report(&compared, args.ppd);
    tables::print(&compared, &report, is_folder)?;
    args.json.as_ref().map_or(Ok(()), |sink| sink.write_json(&report))?;
    limits::judge(args, &compared)
}

/// Compares all pairs: the first alone, then as many at once as there are cores and memory for pairs of the largest
/// size so far.
fn compare_all(args: &Args, pairs: &[Files], is_folder: bool) -> Result<Vec<Compared>> {
    let bar = progress::Bar::new("comparing");
    let mut compared: Vec<Compared> = Vec::new();
    let mut at_once = 1;
    while compared.len() < pairs.len() {
        let next = &pairs[compared.len()..pairs.len().min(compared.len() + at_once)];
        let outcomes: Vec<_> = next.par_iter().map(|files| compare_one(args, files, is_folder)).collect();
        for outcome in outcomes {
            compared.push(outcome?);
        }
        let bytes = compared.iter().map(|one| needed_bytes(one.pair.size)).max().unwrap_or(0);
        at_once = (AT_ONCE_BYTES / bytes.max(1)).clamp(1, rayon::current_num_threads() as u64) as usize;
        if check_free(bytes * at_once as u64, "comparisons").is_err() {
            at_once = 1;
        }
        bar.set_counted(compared.len(), pairs.len(), "pairs");
    }
    Ok(compared)
}

/// Compares a pair, and writes its heatmap if one is requested.
fn compare_one(args: &Args, files: &Files, is_folder: bool) -> Result<Compared> {
    let (pair, map) = compare(files, args.ppd)?;
    if let Some(heatmap) = &args.heatmap {
        let file = if is_folder { heatmap.join(&files.heatmap) } else { heatmap.clone() };
        if let Some(folder) = file.parent().filter(|_| is_folder) {
            make_folder(folder)?;
        }
        draw(&map, pair.size).write_as(FileKind::Png, Compression::Fast, &file, Alpha::Opaque)?;
    }
    Ok(Compared { title: files.title.clone(), pair })
}

/// Bytes of memory for a pair of this size.
fn needed_bytes(size: [u32; 2]) -> u64 {
    BYTES_PER_PIXEL * u64::from(size[0]) * u64::from(size[1]) + OTHER_BYTES
}

fn report(compared: &[Compared], ppd: f64) -> Report {
    let pairs: Vec<Pair> = compared.iter().map(|one| one.pair.clone()).collect();
    Report {
        format: Report::FORMAT.to_owned(),
        pixels_per_degree: ppd,
        worst: Difference::worst(pairs.iter().filter_map(|pair| pair.difference.as_ref())),
        worst_alpha: AlphaDifference::worst(pairs.iter().filter_map(|pair| pair.alpha)),
        worst_numbers: NumberDifference::worst(pairs.iter().filter_map(|pair| pair.numbers.as_ref())),
        pairs,
    }
}

/// Fails before anything is compared if an output cannot be written or would overwrite an input.
fn check_outputs(args: &Args, pairs: &[Files], is_folder: bool) -> Result<()> {
    let inputs: BTreeSet<_> = pairs
        .iter()
        .flat_map(|files| &files.paths)
        .chain([&args.a, &args.b])
        .filter_map(|file| file.canonicalize().ok())
        .collect();
    for output in args.heatmap.as_deref().into_iter().chain(args.json.as_ref().and_then(Sink::file)) {
        if output.canonicalize().is_ok_and(|output| inputs.contains(&output)) {
            return Err(Usage(format!("{} is an input and would be overwritten", output.display())).into());
        }
    }
    match args.heatmap.as_deref() {
        Some(folder) if is_folder => {
            let inputs = [&args.a, &args.b].map(|input| input.canonicalize());
            make_folder(folder)?;
            let folder = folder.canonicalize()?;
            if inputs.into_iter().flatten().any(|input| folder.starts_with(input)) {
                let folder = folder.display();
                return Err(Usage(format!("--heatmap {folder} is in a folder of pictures to compare")).into());
            }
        }
        Some(file) if FileKind::of(file).ok() != Some(FileKind::Png) => {
            return Err(Usage(format!("--heatmap {}: expected a name that ends in .png", file.display())).into());
        }
        Some(file) => check_writable(file)?,
        None => {}
    }
    args.json.as_ref().map_or(Ok(()), Sink::check)
}

/// The measures of a pair, and its heatmap from 0 to 1.
fn compare(files: &Files, ppd: f64) -> Result<(Pair, Vec<f32>)> {
    let [a, b] = &files.paths;
    let pictures = [read(a)?, read(b)?];
    let [size, other] = pictures.each_ref().map(|picture| picture.pixels.size);
    let [shown_a, shown_b] = [a.display(), b.display()];
    let [text, other_text] = [size, other].map(size_text);
    ensure!(
        size == other,
        "{shown_a} has {text} pixels and {shown_b} has {other_text}: pictures must have the same size (`smalto render` \
         draws at the size of a photograph with --size {other_text} or --size {text})"
    );
    check_free(needed_bytes(size), &format!("a comparison of {text} pixels"))?;
    let kinds = pictures.each_ref().map(|picture| picture.channels);
    let are_numbers = kinds.contains(&Channels::Numbers);
    ensure!(
        !are_numbers || !kinds.contains(&Channels::Colours),
        "of {shown_a} and {shown_b} one has a single channel of floats and the other has colours"
    );
    let has_alpha = !are_numbers && pictures.iter().all(|picture| picture.has_alpha);
    let [first, second] = pictures.each_ref().map(|picture| &picture.pixels);
    let alpha = has_alpha.then(|| AlphaDifference::between(first, second));
    let (difference, numbers, map) = if are_numbers {
        let map = relative_errors(first, second).into_iter().map(|error| (error * 10.0).min(1.0)).collect();
        (None, Some(NumberDifference::between(first, second)), map)
    } else {
        let flip = flip(first, second, ppd);
        (Some(Difference::with_flip(first, second, &flip)), None, flip.map)
    };
    Ok((Pair { a: shown_a.to_string(), b: shown_b.to_string(), size, difference, alpha, numbers }, map))
}

fn read(file: &Path) -> Result<Picture> {
    Picture::read(file).map_err(|problem| Unreadable::or_too_large(file, problem))
}

/// A heatmap in the magma colour map: black, purple, orange, pale yellow.
fn draw(map: &[f32], size: [u32; 2]) -> Pixels {
    let colour = |value: &f32| {
        let (r, g, b) = colorous::MAGMA.eval_rational((value * 255.0).round() as usize, 256).as_tuple();
        [r, g, b, 255].map(|channel| f32::from(channel) / 255.0)
    };
    Pixels { size, rgba: map.iter().map(colour).collect() }
}
