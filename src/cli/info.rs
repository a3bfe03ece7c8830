//! `smalto info`: what a scene holds.

use anyhow::{Context, Result};
use serde::Serialize;

use super::{SceneArg, knobs, say};
use crate::options::{Options, Storage};
use crate::render::{Layout, Packing, depth_bits};
use crate::scene::{Bounds, Focus, Gaussians, Requirements, Scene, Tally, percentiles};

/// Describe a scene: counts, bounds, distributions, what it requires of the GPU
#[derive(clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    scene: SceneArg,
    /// Whose storage to tell
    #[arg(long, value_name = "NAME", default_value = "balanced", value_parser = knobs::preset_names())]
    preset: String,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Fractions of the percentiles that are shown.
const FRACTIONS: [f64; 7] = [0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99];

#[derive(Serialize)]
struct Report {
    scene: String,
    format: String,
    gaussians: usize,
    sh_degree: u32,
    tally: Tally,
    /// World units.
    low: [f32; 3],
    high: [f32; 3],
    centre: [f64; 3],
    radius: f64,
    /// At 1, 5, 25, 50, 75, 95 and 99 percent.
    opacity: [f32; 7],
    /// Geometric mean of the three standard deviations, world units.
    scale: [f32; 7],
    /// Largest over smallest standard deviation.
    anisotropy: [f32; 7],
    required: Required,
}

/// What the scene requires, and how the GPU keeps it.
#[derive(Serialize)]
struct Required {
    preset: String,
    /// The highest degree of spherical harmonics with a coefficient that is not zero; and that is kept.
    sh_degree: u32,
    sh_degree_kept: u32,
    /// Above the part of each degree in any colour channel; and its root mean square.
    sh_bounds: [f64; 4],
    sh_rms: [f64; 4],
    sh_storage: String,
    shape_storage: String,
    /// Above what the storage and the degree of SH change of any colour channel of any picture; shapes have no bound.
    colour_error: f64,
    /// Above the brightest channel of any Gaussian.
    brightest: f64,
    /// Bits of a depth key from the near plane to the other end of the scene, and those that the preset keeps.
    depth_bits: u32,
    depth_bits_kept: u32,
    /// The distance of neighbouring 32-bit floats at the outermost coordinate, world units.
    coordinate_step: f32,
    /// Device memory of a Gaussian, of the scene, and of the scene in 32-bit floats.
    bytes_each: u64,
    gpu_bytes: u64,
    f32_bytes: u64,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let name = args.scene.scene.display().to_string();
    let report = report(&name, &args.scene.read()?, &args.preset)?;
    if args.json { say!("{}", serde_json::to_string_pretty(&report)?) } else { print(&report) }
}

fn report(name: &str, scene: &Scene, preset: &str) -> Result<Report> {
    let gaussians = &scene.gaussians;
    let (bounds, focus) = (Bounds::of(gaussians), Focus::of(gaussians));
    Ok(Report {
        scene: name.to_owned(),
        format: scene.format.clone(),
        gaussians: gaussians.len(),
        sh_degree: gaussians.sh_degree(),
        tally: scene.tally,
        low: bounds.low,
        high: bounds.high,
        centre: focus.centre,
        radius: focus.radius,
        opacity: percentiles(gaussians.opacities().to_vec(), FRACTIONS),
        scale: of_scales(gaussians, |[x, y, z]| (x * y * z).cbrt()),
        anisotropy: of_scales(gaussians, |[x, y, z]| x.max(y).max(z) / x.min(y).min(z)),
        required: required(gaussians, preset)?,
    })
}

fn required(gaussians: &Gaussians, preset: &str) -> Result<Required> {
    let options = Options::preset(preset).context("clap lets known presets pass alone")?;
    let (bounds, needs) = (Bounds::of(gaussians), Requirements::of(gaussians));
    let layout = Layout::of(gaussians, &needs, &options);
    let plain = Options { sh_storage: Storage::F32, shape_storage: Storage::F32, ..Options::EXACT };
    let all = Requirements { sh_degree: gaussians.sh_degree(), ..needs };
    let f32_bytes = Layout::of(gaussians, &all, &plain).bytes_each() * gaussians.len() as u64;
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
        colour_error: layout.colour_error(gaussians),
        brightest: needs.brightest,
        depth_bits,
        depth_bits_kept: depth_bits.min(options.key_bits),
        coordinate_step: outermost.next_up() - outermost,
        bytes_each: layout.bytes_each(),
        gpu_bytes: layout.bytes_each() * gaussians.len() as u64,
        f32_bytes,
    })
}

fn packing(packing: Packing) -> String {
    let bits = match packing.storage {
        Storage::Lossless | Storage::F32 => "32-bit floats",
        Storage::F16 => "16-bit floats",
        Storage::U8 => "8 bits",
    };
    let why = match (packing.storage, packing.is_lossless) {
        (Storage::U8, true) => "lossless: so the file held them",
        (_, true) => "lossless: the file held more than 8 bits",
        (_, false) => "the preset allows the loss",
    };
    format!("{bits} ({why})")
}

fn of_scales(gaussians: &Gaussians, value: fn([f64; 3]) -> f64) -> [f32; 7] {
    let values = gaussians.scales().iter().map(|s| value(s.map(f64::from)) as f32);
    percentiles(values.collect(), FRACTIONS)
}

fn print(report: &Report) -> Result<()> {
    let Report { scene, format, gaussians, sh_degree, tally, low, high, centre, radius, .. } = report;
    say!("{scene}: {format}, {gaussians} Gaussians, SH degree {sh_degree}")?;
    say!("read        {} ({tally})", tally.read)?;
    say!("box         {} to {}", point(low), point(high))?;
    say!("matter      90 % of the opacity within {radius:.4} of {}", point(&centre.map(|v| v as f32)))?;
    say!("percentile  {}", FRACTIONS.map(|f| format!("{:>9}", format!("{:.0} %", f * 100.0))).concat())?;
    for (name, values) in [("opacity", report.opacity), ("scale", report.scale), ("anisotropy", report.anisotropy)] {
        say!("{name:<11} {}", values.map(|v| format!("{:>9}", number(v))).concat())?;
    }
    print_required(&report.required, *sh_degree)
}

fn print_required(required: &Required, sh_degree: u32) -> Result<()> {
    let Required { preset, sh_storage, shape_storage, brightest, colour_error, bytes_each, .. } = required;
    say!("colour      no channel of any Gaussian is over {brightest:.2}")?;
    for (degree, (bound, rms)) in required.sh_bounds.iter().zip(required.sh_rms).enumerate() {
        if degree <= sh_degree as usize {
            let use_of_it = if degree as u32 <= required.sh_degree_kept { "kept" } else { "left out" };
            say!(
                "SH degree {degree} adds up to {bound:.3} to a channel, {rms:.4} in the root mean square: {use_of_it}"
            )?;
        }
    }
    say!("means       32-bit floats, {} apart at the outermost", number(required.coordinate_step))?;
    let kept = required.depth_bits_kept;
    say!("depth keys  {} bits reach across the scene, {kept} are sorted by", required.depth_bits)?;
    say!("{preset} keeps SH in {sh_storage}, shapes in {shape_storage}")?;
    say!("            its SH change no colour channel of a picture by more than {colour_error:.2e}")?;
    say!(
        "on the GPU  {:.1} MB, {bytes_each} bytes a Gaussian; all in 32-bit floats would be {:.1} MB",
        required.gpu_bytes as f64 / 1e6,
        required.f32_bytes as f64 / 1e6
    )
}

fn point(p: &[f32; 3]) -> String {
    format!("({}, {}, {})", number(p[0]), number(p[1]), number(p[2]))
}

/// About four digits.
fn number(value: f32) -> String {
    match value.abs() {
        v if v == 0.0 || (1e-3..1e5).contains(&v) => format!("{value:.4}")[..].chars().take(7).collect(),
        _ => format!("{value:.2e}"),
    }
}
