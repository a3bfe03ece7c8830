//! Predicted against measured errors of levels of detail: `cargo bench --bench predictions -- FILE VIEWS [OUT
//! [COUNT]]`, where VIEWS is a camera file, or a path of the town (street, roof, air). It writes the points to OUT.csv
//! and a plot of them to OUT.svg (`predictions` without OUT).
//!
//! Groups: a thousand times, a random part of the scene and one of its levels are drawn alone, in a random direction
//! and in pixels of a random width, and compared with the Gaussians that they stand for. Frames: COUNT views (50) with
//! a twentieth and with a fifth of the Gaussians that are drawn without levels, compared with the picture of all: the
//! error that is predicted from the nodes, the one that is estimated from patches, and the pixels whose error is larger
//! than the one that is predicted for the nodes seen in them.

use std::fmt::Write as _;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use glam::DVec3;
use rayon::prelude::*;
use smalto::camera::{self, Camera};
use smalto::cli::environment::Environment;
use smalto::gpu::{Device, Validation};
use smalto::lod::{Node, Nodes, squared_difference, value_of_code};
use smalto::measure::metrics::{mse, psnr};
use smalto::measure::plot::{self, Lines};
use smalto::options::Options;
use smalto::packing::Shape;
use smalto::pagefile::write::subtrees;
use smalto::pagefile::{PADDING, PAGE, PARTS, PageFile};
use smalto::procedural::Procedural;
use smalto::procedural::TownPath;
use smalto::render::{Attribute, Inspection, Renderer, SceneSource, Upload};
use smalto::rules::{Background, Rules};

const GROUPS: usize = 1000;
const FRAMES: usize = 50;
const PATCHES: u32 = 64;
const SIZE: [u32; 2] = [1920, 1080];

/// Random numbers, the same in every run (PCG, O'Neill 2014).
struct Random(u64);

impl Random {
    /// From 0 to 1.
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let word = (((self.0 >> 18) ^ self.0) >> 27) as u32;
        f64::from(word.rotate_right((self.0 >> 59) as u32)) / f64::from(u32::MAX)
    }

    fn below(&mut self, count: usize) -> usize {
        ((self.next() * count as f64) as usize).min(count - 1)
    }
}

/// A predicted and a measured error.
struct Point {
    of: String,
    predicted: f64,
    measured: f64,
}

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).collect();
    let [file, views, rest @ ..] = &arguments[..] else {
        println!("predictions: a page file with levels and its views are needed, as its first lines say");
        return Ok(());
    };
    let out = rest.first().map_or("predictions", String::as_str);
    let file = Arc::new(PageFile::open(Path::new(file))?);
    ensure!(file.levels().is_some(), "{} has no levels of detail", file.path().display());
    let groups = groups(&file)?;
    say("groups: log2 of measured over predicted, root mean square", &groups, f64::log2);
    let count = rest.get(1).map_or(Ok(FRAMES), |count| count.parse())?;
    let found = frames(&file, &views_of(&file, views, count)?)?;
    let decibels = |ratio: f64| -20.0 * ratio.log10();
    say("frames: dB by which measured is better than predicted", &found.predicted, decibels);
    say("frames: dB by which measured is better than estimated from patches", &found.estimated, decibels);
    for (name, within) in &found.within {
        let [one, two, three] = within.map(|part| 100.0 * part);
        println!("{name}: {one:.0}, {two:.0}, {three:.0} % within one, two, three standard errors");
    }
    for (name, over) in &found.over {
        println!("{name}: {:.2} % of the pixels have a larger error than predicted", 100.0 * over);
    }
    let estimated = |point: Point| Point { of: format!("{}, {PATCHES} patches", point.of), ..point };
    let frames: Vec<Point> = found.predicted.into_iter().chain(found.estimated.into_iter().map(estimated)).collect();
    let mut csv = "of,predicted,measured\n".to_owned();
    for Point { of, predicted, measured } in groups.iter().chain(&frames) {
        writeln!(csv, "{of},{predicted},{measured}")?;
    }
    std::fs::write(format!("{out}.csv"), csv)?;
    plot::write(Path::new(&format!("{out}.svg")), (1500, 700), |panel| {
        let (left, right) = panel.split_horizontally(750);
        panel_of("Groups: error against the scene", &groups).draw(&left)?;
        panel_of("Frames: root mean squared error, steps of 1/255", &frames).draw(&right)
    })
}

/// Prints how measured and predicted errors differ, for each kind and for all.
fn say(title: &str, points: &[Point], scale: impl Fn(f64) -> f64) {
    println!("{title}: 5 %, median, 95 %");
    let mut kinds: Vec<&str> = points.iter().map(|point| point.of.as_str()).collect();
    kinds.sort_unstable();
    kinds.dedup();
    for kind in kinds.into_iter().map(Some).chain([None]) {
        let own = points.iter().filter(|point| kind.is_none_or(|kind| point.of == kind));
        let mut ratios: Vec<f64> = own.clone().map(|point| scale(point.measured / point.predicted)).collect();
        ratios.sort_unstable_by(f64::total_cmp);
        let at = |part: f64| ratios[((ratios.len() - 1) as f64 * part).round() as usize];
        let [low, middle, high] = [0.05, 0.5, 0.95].map(at);
        let pairs: Vec<[f64; 2]> = own.map(|point| [point.predicted, point.measured]).collect();
        let (name, correlation) = (kind.unwrap_or("all"), correlation(&pairs));
        println!(
            "  {name}: {low:.2}, {middle:.2}, {high:.2}; rank correlation {correlation:.2}, {} points",
            pairs.len()
        );
    }
}

/// Spearman's rank correlation.
fn correlation(pairs: &[[f64; 2]]) -> f64 {
    let ranks = [0, 1].map(|k| {
        let mut order: Vec<usize> = (0..pairs.len()).collect();
        order.sort_by(|a, b| pairs[*a][k].total_cmp(&pairs[*b][k]));
        let mut ranks = vec![0.0; order.len()];
        order.iter().enumerate().for_each(|(rank, index)| ranks[*index] = rank as f64);
        ranks
    });
    let mean = (pairs.len() as f64 - 1.0) / 2.0;
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>();
    product(&ranks[0], &ranks[1]) / product(&ranks[0], &ranks[0])
}

/// The points of each kind, and the line on which the two are equal.
fn panel_of(title: &str, points: &[Point]) -> Lines {
    let mut lines: Vec<(String, Vec<(f64, f64)>)> = Vec::new();
    for Point { of, predicted, measured } in points {
        let point = (*predicted, *measured);
        match lines.iter_mut().find(|(name, _)| name == of) {
            Some((_, points)) => points.push(point),
            None => lines.push((of.clone(), vec![point])),
        }
    }
    lines.sort_by(|a, b| a.0.cmp(&b.0));
    let all = || points.iter().flat_map(|point| [point.predicted, point.measured]);
    let [low, high] = [all().fold(f64::INFINITY, f64::min), all().fold(0.0, f64::max)];
    lines.push(("equal".to_owned(), vec![(low, low), (high, high)]));
    let [x, y] = ["predicted", "measured"].map(str::to_owned);
    Lines { title: title.to_owned(), x, y, lines, is_logarithmic: true, is_scattered: true }
}

/// Measures levels of random parts of the scene. The errors are roots of the area, in world units.
fn groups(file: &PageFile) -> Result<Vec<Point>> {
    ensure!(!file.header().has_source_levels(), "the levels of the scene are those of its source");
    let subtrees = subtrees(file.statistics().count, 4096);
    let mut random = Random(1);
    let levels = subtrees[0].len() - 1;
    ensure!(levels > 0, "the scene has no levels but its Gaussians");
    let choices: Vec<_> = (0..GROUPS)
        .map(|_| {
            let (part, level) = (random.below(subtrees.len()), 1 + random.below(levels));
            let around = std::f64::consts::TAU * random.next();
            let height = 2.0 * random.next() - 1.0;
            let flat = (1.0 - height * height).sqrt();
            let forward = DVec3::new(flat * around.cos(), flat * around.sin(), height);
            (part, level, forward, (3.0 * random.next() - 1.0).exp2())
        })
        .collect();
    let point = |(part, level, forward, wide): &(usize, usize, DVec3, f64)| {
        let scene = nodes_of(file, &subtrees[*part][0])?;
        let pages = &subtrees[*part][*level];
        let nodes = nodes_of(file, pages)?;
        // From half of the width of the median node to four times that.
        let (low, high) = scene.bounds();
        let diagonal = DVec3::from(high.map(f64::from)).distance(DVec3::from(low.map(f64::from)));
        let px = (wide * nodes.width()).max(diagonal / 2048.0);
        let predicted: f64 = pages.iter().cloned().flatten().map(|page| predicted(file, page, px)).sum();
        let measured = squared_difference(&scene, &nodes, *forward, px);
        Ok(Point { of: format!("level {level}"), predicted: predicted.sqrt(), measured: measured.sqrt() })
    };
    let points = choices.par_iter().map(point).collect::<Result<Vec<_>>>()?;
    // A level of a part without any change has no place on logarithmic axes.
    Ok(points.into_iter().filter(|point| point.predicted > 0.0 && point.measured > 0.0).collect())
}

/// The squared error of all nodes of a page, in pixels of this width: world units squared.
fn predicted(file: &PageFile, page: usize, px: f64) -> f64 {
    let level = &file.levels().expect("the file has levels")[page];
    let count = f64::from(file.pages()[page].count);
    let whole: f64 = level.squared_errors.iter().map(|energy| value_of_code(*energy) * count / PARTS as f64).sum();
    whole * (f64::from(level.reference_width) / px).min(1.0).powi(2)
}

/// The nodes of some pages as they are drawn.
fn nodes_of(file: &PageFile, pages: &[Range<usize>]) -> Result<Nodes> {
    let (words, layout) = (file.words(), file.layout());
    let mut nodes = Nodes::new(layout.sh_degree);
    let [mut geometry, mut colours] = [words.geometry(), words.colours()].map(|words| vec![0; words]);
    let mut levels = vec![[0_u32; 2]; PAGE];
    for page in pages.iter().cloned().flatten() {
        file.read_geometry(page..page + 1, &mut geometry)?;
        file.read_colours(page..page + 1, &mut colours)?;
        file.read_levels(page..page + 1, levels.as_flattened_mut())?;
        for k in (0..PAGE).filter(|k| geometry[words.ids.start + k] != PADDING) {
            let Shape { mean, rotation, scale, opacity } = words.unpacked(layout, &geometry, k);
            let opacity = if levels[k][1] == 0 { opacity } else { value_of_code(levels[k][1] as u16) as f32 };
            let node = Node::leaf(mean, rotation, scale, opacity);
            nodes.push(node, &layout.unpacked_sh(&words.sh_of(&colours, k)));
        }
    }
    Ok(nodes)
}

/// Views of a camera file or of a path of the town.
fn views_of(file: &PageFile, views: &str, count: usize) -> Result<Vec<Camera>> {
    let Some(path) = TownPath::named(views) else {
        let cameras = camera::read_at(Path::new(views), Some(SIZE))?.cameras;
        let step = cameras.len().div_ceil(count).max(1);
        return Ok(cameras.into_iter().step_by(step).map(|named| named.camera.resized(SIZE)).collect());
    };
    let town = Procedural::parse(&format!("town:{}", file.statistics().count)).context("a town")??;
    let views = town.views(path, count).context("the town has this path")?;
    Ok(camera::path::looking(&views, SIZE))
}

/// What pictures of views have of their errors.
struct Frames {
    /// The errors that are predicted for the nodes, and the measured ones.
    predicted: Vec<Point>,
    /// The errors that are estimated from patches, and the measured ones.
    estimated: Vec<Point>,
    /// A number of nodes; the fractions of the pictures whose mean squared error is within one, two and three standard
    /// errors of its estimate.
    within: Vec<(String, [f64; 3])>,
    /// A number of nodes, and the fraction of the pixels whose error is larger than predicted.
    over: Vec<(String, f64)>,
}

/// Draws the views by levels and with all Gaussians.
fn frames(file: &Arc<PageFile>, views: &[Camera]) -> Result<Frames> {
    let environment = Environment::read()?;
    let device = Device::open(&environment.device, environment.validation.unwrap_or(Validation::Off))?;
    let source = SceneSource::of_file(file.clone());
    let rules = Rules { near: 0.1, antialiased: true, ..Options::BALANCED.rules };
    let options = Options { rules, ..Options::BALANCED };
    let renderer = |options: &Options| {
        let scene = source.upload_with(&device, options, Upload::reserving(1 << 28))?;
        Renderer::new(&device, options, &scene)
    };
    let mut whole = renderer(&options)?;
    let counts = views.iter().map(|view| Ok(f64::from(whole.render(view, Background::BLACK)?.totals.visible)));
    let visible = counts.sum::<Result<f64>>()? / views.len() as f64;
    drop(whole);
    let mut found = Frames { predicted: Vec::new(), estimated: Vec::new(), within: Vec::new(), over: Vec::new() };
    let steps = |db: f64| 255.0 * 10_f64.powf(-db / 20.0);
    for part in [20, 5] {
        let mut levels = renderer(&Options { splats: (visible / f64::from(part)) as u32, ..options })?;
        let name = format!("1/{part} of the nodes");
        let (mut over, mut all, mut within) = (0, 0, [0; 3]);
        for view in views {
            let predicted = levels.render(view, Background::BLACK)?.detail.and_then(|detail| detail.predicted_psnr);
            let picture = levels.pixels()?;
            let sampled = levels.sample_psnr(view, Background::BLACK, PATCHES)?;
            levels.set_inspection(Inspection::of_attribute(Attribute::PredictedError))?;
            levels.render(view, Background::BLACK)?;
            let errors = levels.pixels()?;
            levels.set_inspection(Inspection::default())?;
            levels.set_finest(true);
            levels.render(view, Background::BLACK)?;
            levels.set_finest(false);
            let exact = levels.pixels()?;
            let measured = psnr(&exact, &picture);
            if let Some(predicted) = predicted.filter(|_| measured.is_finite()) {
                let point = |db| Point { of: name.clone(), predicted: steps(db), measured: steps(measured) };
                found.predicted.push(point(predicted));
                found.estimated.push(point(sampled.psnr()));
            }
            let off = (mse(&exact, &picture) - sampled.mse).abs();
            (1..=3).for_each(|k| within[k - 1] += u32::from(off <= k as f64 * sampled.standard_error));
            let pairs = exact.rgba.iter().zip(&picture.rgba).zip(&errors.rgba);
            let is_over = |((exact, drawn), [log2, .., alpha]): ((&[f32; 4], &[f32; 4]), &[f32; 4])| {
                let squared: f32 = (0..3).map(|k| (exact[k] - drawn[k]).powi(2)).sum();
                *alpha > 0.0 && 255.0 * (squared / 3.0).sqrt() > (log2 / alpha).exp2()
            };
            over += pairs.filter(|pair| is_over(*pair)).count();
            all += exact.rgba.len();
        }
        found.within.push((name.clone(), within.map(|count| f64::from(count) / views.len() as f64)));
        found.over.push((name, over as f64 / all as f64));
    }
    Ok(found)
}
