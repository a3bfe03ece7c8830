//! `smalto info`: what a scene holds.

use anyhow::Result;
use serde::Serialize;

use super::{SceneArg, say};
use crate::render::GpuScene;
use crate::scene::{Bounds, Focus, Gaussians, Scene, Tally, percentiles};

/// Describe a scene: counts, bounds, distributions, memory
#[derive(clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    scene: SceneArg,
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
    /// Device memory of the scene.
    gpu_bytes: u64,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let report = report(&args.scene.scene.display().to_string(), &args.scene.read()?);
    if args.json { say!("{}", serde_json::to_string_pretty(&report)?) } else { print(&report) }
}

fn report(name: &str, scene: &Scene) -> Report {
    let gaussians = &scene.gaussians;
    let (bounds, focus) = (Bounds::of(gaussians), Focus::of(gaussians));
    Report {
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
        gpu_bytes: GpuScene::bytes_for(gaussians.len(), gaussians.sh_degree()),
    }
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
    say!("on the GPU  {:.1} MB", report.gpu_bytes as f64 / 1e6)?;
    say!("percentile  {}", FRACTIONS.map(|f| format!("{:>9}", format!("{:.0} %", f * 100.0))).concat())?;
    for (name, values) in [("opacity", report.opacity), ("scale", report.scale), ("anisotropy", report.anisotropy)] {
        say!("{name:<11} {}", values.map(|v| format!("{:>9}", number(v))).concat())?;
    }
    Ok(())
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
