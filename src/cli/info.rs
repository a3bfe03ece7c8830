//! `smalto info`: describes a scene.

use anyhow::{Context, Result};
use schemars::JsonSchema;
use serde::Serialize;

use super::headings::REPORTS;
use super::scenes::SceneArg;
use super::sink::Sink;
use super::{knobs, say};
use crate::options::{Options, Storage};
use crate::packing::{Layout, Packing, Statistics};
use crate::pagefile::{PAGE, PageFile};
use crate::render::depth_bits;
use crate::scene::{Bounds, Focus, Gaussians, LoadReport, MAX_SH_DEGREE, Requirements, Scene, SceneLevel, percentiles};

/// Describe a scene: counts, bounds, distributions and the GPU storage that it needs
#[derive(clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    scene: SceneArg,
    /// Preset whose GPU storage is reported, like exact or fast
    #[arg(long, help_heading = REPORTS, value_name = "NAME", default_value = "balanced", hide_possible_values = true)]
    #[arg(value_parser = knobs::preset_names())]
    preset: String,
    /// Write the report as JSON; - prints it instead of the text
    #[arg(long, help_heading = REPORTS, value_name = "FILE|-")]
    json: Option<Sink>,
}

/// The percentiles in a report, as fractions.
const FRACTIONS: [f64; 7] = [0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99];

/// The report of `smalto info --json`.
#[derive(Serialize, JsonSchema)]
#[schemars(title = "Report of `smalto info`")]
pub(super) struct Report {
    scene: String,
    /// The format of the file.
    format: String,
    /// Gaussians that can be drawn.
    gaussians: usize,
    sh_degree: u32,
    /// It was trained with the antialiasing of Mip-Splatting, and is drawn with it.
    is_antialiased: bool,
    /// The levels of detail of the file, the finest first; empty if its format has none.
    levels: Vec<SceneLevel>,
    /// Differences between what the file asks for and what is drawn.
    notices: Vec<String>,
    tally: LoadReport,
    /// The corners of the bounding box of the means, and the sphere around 90 % of the opacity, in world units.
    low: [f32; 3],
    high: [f32; 3],
    centre: [f64; 3],
    radius: f64,
    /// `null` for a page file, which is not read as a whole.
    opacity: Option<Percentiles>,
    /// Geometric mean of the three standard deviations, in world units. `null` for a page file.
    scale: Option<Percentiles>,
    /// The largest standard deviation divided by the smallest; a percentile that is `null` is infinity. `null` for a
    /// page file.
    anisotropy: Option<Percentiles>,
    required: Required,
    /// The pages of a page file.
    pages: Option<PagesReport>,
}

/// The pages of a page file.
#[derive(Serialize, JsonSchema)]
struct PagesReport {
    /// Number of pages of the scene, and Gaussians in all but the last.
    pages: usize,
    /// Pages of levels of detail: of nodes that stand for several Gaussians.
    level_pages: usize,
    /// True if the levels are those of the source. Any page may then hold fewer Gaussians.
    has_source_levels: bool,
    gaussians_each: usize,
    /// Bytes of the file.
    bytes: u64,
    /// Bytes of the geometry and of the colours of a page.
    geometry_bytes: usize,
    colour_bytes: usize,
    sh_storage: String,
    shape_storage: String,
    /// The alpha threshold that the file was made for.
    alpha_min: f32,
}

/// Percentiles of a value over all Gaussians, by their percentage.
#[derive(Clone, Copy, Serialize, JsonSchema)]
struct Percentiles {
    p1: f32,
    p5: f32,
    p25: f32,
    p50: f32,
    p75: f32,
    p95: f32,
    p99: f32,
}

impl Percentiles {
    fn of(values: Vec<f32>) -> Self {
        let [p1, p5, p25, p50, p75, p95, p99] = percentiles(values, FRACTIONS);
        Self { p1, p5, p25, p50, p75, p95, p99 }
    }

    fn values(self) -> [f32; 7] {
        let Self { p1, p5, p25, p50, p75, p95, p99 } = self;
        [p1, p5, p25, p50, p75, p95, p99]
    }
}

/// The needs of the scene, and its storage on the GPU with a preset.
#[derive(Serialize, JsonSchema)]
struct Required {
    preset: String,
    /// The highest degree of spherical harmonics with a nonzero coefficient, and the highest that the preset keeps.
    sh_degree: u32,
    sh_degree_kept: u32,
    /// An upper bound on the contribution of each degree to a colour channel, and its root mean square.
    sh_bounds: [f64; MAX_SH_DEGREE as usize + 1],
    sh_rms: [f64; MAX_SH_DEGREE as usize + 1],
    sh_storage: String,
    shape_storage: String,
    /// An upper bound on the change of any colour channel of any picture by the storage and the degree of the spherical
    /// harmonics. The storage of shapes has no bound. `null` for a page file whose colours change.
    colour_error: Option<f64>,
    /// An upper bound on the colour channels of all Gaussians.
    brightest: f64,
    /// Bits of a depth key that distinguish all depths from the near plane to the far end of the scene, and the bits
    /// that the preset sorts by.
    depth_bits: u32,
    depth_bits_kept: u32,
    /// The distance between adjacent 32-bit floats at the largest coordinate, in world units.
    coordinate_step: f32,
    /// Bytes of device memory per Gaussian, for the scene, and for the scene in 32-bit floats.
    bytes_each: u64,
    gpu_bytes: u64,
    f32_bytes: u64,
}

pub(super) fn run(args: &Args) -> Result<()> {
    args.json.as_ref().map_or(Ok(()), Sink::check)?;
    let name = args.scene.scene.display().to_string();
    let report = match args.scene.page_file()? {
        Some(file) => report_of_pages(&name, &file, &args.preset)?,
        None => report(&name, &args.scene.read()?, &args.preset)?,
    };
    print(&report)?;
    args.json.as_ref().map_or(Ok(()), |sink| sink.write_json(&report))
}

fn report(name: &str, scene: &Scene, preset: &str) -> Result<Report> {
    let gaussians = &scene.gaussians;
    let (bounds, focus) = (Bounds::of(gaussians), Focus::of(gaussians));
    Ok(Report {
        scene: name.to_owned(),
        format: scene.format.clone(),
        gaussians: gaussians.len(),
        sh_degree: gaussians.sh_degree(),
        is_antialiased: scene.is_antialiased,
        levels: scene.levels.clone(),
        notices: scene.notices.clone(),
        tally: scene.report,
        low: bounds.low,
        high: bounds.high,
        centre: focus.centre,
        radius: focus.radius,
        opacity: Some(Percentiles::of(gaussians.opacities().to_vec())),
        scale: Some(of_scales(gaussians, |[x, y, z]| (x * y * z).cbrt())),
        anisotropy: Some(of_scales(gaussians, |[x, y, z]| x.max(y).max(z) / x.min(y).min(z))),
        required: required(&Statistics::of(gaussians), preset, |layout| Some(layout.colour_error(gaussians)))?,
        pages: None,
    })
}

/// The report on a page file, from its header alone.
fn report_of_pages(name: &str, file: &PageFile, preset: &str) -> Result<Report> {
    let header = file.header();
    let (statistics, stored) = (&header.statistics, &header.layout);
    let degree = statistics.requirements.sh_degree;
    let keeps = |layout: &Layout| (layout.sh.is_lossless && layout.sh_degree >= degree).then_some(0.0);
    Ok(Report {
        scene: name.to_owned(),
        format: header.format_of_pages(),
        gaussians: statistics.count,
        sh_degree: statistics.sh_degree,
        is_antialiased: header.is_antialiased,
        levels: Vec::new(),
        notices: Vec::new(),
        tally: header.report,
        low: statistics.extent.low,
        high: statistics.extent.high,
        centre: statistics.focus.centre,
        radius: statistics.focus.radius,
        opacity: None,
        scale: None,
        anisotropy: None,
        required: required(statistics, preset, keeps)?,
        pages: Some(PagesReport {
            pages: header.scene_pages(),
            level_pages: header.pages() - header.scene_pages(),
            has_source_levels: header.has_source_levels(),
            gaussians_each: PAGE,
            bytes: header.file_bytes(),
            geometry_bytes: 4 * file.geometry_words(),
            colour_bytes: 4 * file.colour_words(),
            sh_storage: bits(stored.sh).to_owned(),
            shape_storage: bits(stored.shape).to_owned(),
            alpha_min: header.alpha_min,
        }),
    })
}

fn required(statistics: &Statistics, preset: &str, colour_error: impl Fn(&Layout) -> Option<f64>) -> Result<Required> {
    let options = Options::preset(preset).with_context(|| format!("there is no preset {preset}"))?;
    let (bounds, needs) = (statistics.extent, &statistics.requirements);
    let layout = Layout::of(statistics, &options);
    let plain = Options { sh_storage: Storage::F32, shape_storage: Storage::F32, ..Options::EXACT };
    let requirements = Requirements { sh_degree: statistics.sh_degree, ..needs.clone() };
    let f32_bytes =
        Layout::of(&Statistics { requirements, ..statistics.clone() }, &plain).bytes_each() * statistics.count as u64;
    let outermost = bounds.low.iter().chain(&bounds.high).fold(0.0_f32, |m, v| m.max(v.abs()));
    let diagonal = (0..3).map(|i| f64::from(bounds.high[i] - bounds.low[i]).powi(2)).sum::<f64>().sqrt();
    let depth_bits = depth_bits(options.rules.near, diagonal);
    Ok(Required {
        preset: preset.to_owned(),
        sh_degree: needs.sh_degree,
        sh_degree_kept: layout.sh_degree,
        sh_bounds: needs.bands.map(|band| band.bound),
        sh_rms: needs.bands.map(|band| band.rms),
        sh_storage: packing(layout.sh),
        shape_storage: packing(layout.shape),
        colour_error: colour_error(&layout),
        brightest: needs.brightest,
        depth_bits,
        depth_bits_kept: depth_bits.min(options.key_bits),
        coordinate_step: outermost.next_up() - outermost,
        bytes_each: layout.bytes_each(),
        gpu_bytes: layout.bytes_each() * statistics.count as u64,
        f32_bytes,
    })
}

fn bits(packing: Packing) -> &'static str {
    match packing.storage {
        Storage::Lossless | Storage::F32 => "32-bit floats",
        Storage::F16 => "16-bit floats",
        Storage::U8 => "8 bits",
    }
}

fn packing(packing: Packing) -> String {
    let bits = bits(packing);
    let why = match (packing.storage, packing.is_lossless) {
        (Storage::U8, true) => "lossless: the file holds 8 bits",
        (_, true) => "lossless: the file holds more than 8 bits",
        (_, false) => "lossy, by the preset",
    };
    format!("{bits} ({why})")
}

/// Percentiles of a value of the three standard deviations.
fn of_scales(gaussians: &Gaussians, value: fn([f64; 3]) -> f64) -> Percentiles {
    Percentiles::of(gaussians.scales().iter().map(|s| value(s.map(f64::from)) as f32).collect())
}

fn print(report: &Report) -> Result<()> {
    let Report { scene, format, gaussians, sh_degree, tally, low, high, centre, radius, .. } = report;
    say!("{scene}: {format}, {gaussians} Gaussians, SH degree {sh_degree}")?;
    say!("read        {} ({tally})", tally.read)?;
    if report.is_antialiased {
        say!("trained     with the antialiasing of Mip-Splatting, and drawn with it")?;
    }
    for SceneLevel { level, gaussians } in &report.levels {
        say!("level {level:<5} {gaussians} Gaussians in the file")?;
    }
    say!("box         {} to {}", point(low), point(high))?;
    say!("opacity     90 % lies within {} of {}", number(*radius as f32), point(&centre.map(|v| v as f32)))?;
    if let Some(of_pages) = &report.pages {
        let PagesReport { pages, level_pages, gaussians_each, bytes, sh_storage, shape_storage, .. } = of_pages;
        let (megabytes, stored) = (*bytes as f64 / 1e6, format!("SH in {sh_storage}, shapes in {shape_storage}"));
        let [most, levels] = match of_pages.has_source_levels {
            true => ["up to ", "the levels of the source"],
            false => ["", "nodes that stand for several Gaussians"],
        };
        say!("pages       {pages} of {most}{gaussians_each} Gaussians, {megabytes:.1} MB: {stored}")?;
        if *level_pages > 0 {
            say!("levels      {level_pages} pages of {levels}")?;
        }
    }
    let rows = [("opacity", report.opacity), ("scale", report.scale), ("anisotropy", report.anisotropy)];
    if report.opacity.is_some() {
        say!("percentile  {}", FRACTIONS.map(|f| format!("{:>9}", format!("{:.0} %", f * 100.0))).concat())?;
    }
    for (name, values) in rows.into_iter().filter_map(|(name, values)| Some((name, values?))) {
        say!("{name:<11} {}", values.values().map(|v| format!("{:>9}", number(v))).concat())?;
    }
    print_required(&report.required, *sh_degree)
}

fn print_required(required: &Required, sh_degree: u32) -> Result<()> {
    let Required { preset, sh_storage, shape_storage, brightest, colour_error, bytes_each, .. } = required;
    say!("colour      no channel of a Gaussian is above {brightest:.2}")?;
    for (degree, (bound, rms)) in required.sh_bounds.iter().zip(required.sh_rms).enumerate() {
        if degree <= sh_degree as usize {
            let kept = if degree as u32 <= required.sh_degree_kept { "kept" } else { "left out" };
            say!("SH degree {degree} adds at most {bound:.3} to a channel, {rms:.4} root mean square: {kept}")?;
        }
    }
    say!("means       32-bit floats, {} apart at the largest coordinate", number(required.coordinate_step))?;
    let kept = required.depth_bits_kept;
    say!("depth keys  {} bits distinguish all depths, {kept} are sorted", required.depth_bits)?;
    say!("{preset} stores SH in {sh_storage}, shapes in {shape_storage}")?;
    if let Some(error) = colour_error {
        say!("            the storage of SH changes no colour channel of a picture by more than {error:.2e}")?;
    }
    say!(
        "on the GPU  {:.1} MB, {bytes_each} bytes per Gaussian; {:.1} MB if all were 32-bit floats",
        required.gpu_bytes as f64 / 1e6,
        required.f32_bytes as f64 / 1e6
    )
}

fn point(p: &[f32; 3]) -> String {
    format!("({}, {}, {})", number(p[0]), number(p[1]), number(p[2]))
}

/// `value` with about four digits.
fn number(value: f32) -> String {
    match value.abs() {
        v if v == 0.0 || (1e-3..1e5).contains(&v) => format!("{value:.4}")[..].chars().take(7).collect(),
        _ => format!("{value:.2e}"),
    }
}
