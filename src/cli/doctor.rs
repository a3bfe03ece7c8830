//! `smalto doctor`: lists the Vulkan devices and tests one of them.

use anyhow::{Result, bail, ensure};
use glam::DVec3;
use schemars::JsonSchema;
use serde::Serialize;

use super::devices::{DeviceArgs, say_memory};
use super::headings::REPORTS;
use super::sink::Sink;
use super::table::{say_table, table};
use super::{complain, remark, say};
use crate::camera::Camera;
use crate::gpu::{Capabilities, Device, DeviceKind, Executable, survey};
use crate::measure::bench::VersionReport;
use crate::measure::metrics::{max_error, psnr};
use crate::options::Options;
use crate::procedural::cactus;
use crate::render::{GpuScene, Renderer};
use crate::rules::Background;
use crate::{reference, render};

/// List the Vulkan devices and the features they lack, and test one of them against the reference
#[derive(clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    device: DeviceArgs,
    /// Write devices and test as JSON; - prints it instead of the text
    ///
    /// Schema: docs/schemas/doctor.schema.json.
    #[arg(long, help_heading = REPORTS, value_name = "FILE|-")]
    json: Option<Sink>,
    /// Also list the driver's statistics of the compiled shaders
    ///
    /// Such as registers, if the driver has any.
    #[arg(long, help_heading = REPORTS)]
    pipelines: bool,
}

/// The report of `smalto doctor`.
#[derive(Serialize, JsonSchema)]
pub(super) struct Report {
    /// "smalto doctor 1".
    format: String,
    smalto: VersionReport,
    devices: Vec<Capabilities>,
    /// The test of one device; null if none could be opened.
    self_test: Option<SelfTest>,
    /// With `--pipelines`: the driver's statistics of every compiled stage; empty if it has none.
    pipelines: Vec<Pipeline>,
}

/// The pictures of a small scene, compared with the float64 reference.
#[derive(Serialize, JsonSchema)]
struct SelfTest {
    device: String,
    is_validated: bool,
    /// `exp2` in shaders returns 0 instead of a denormal number, so that the fast path needs no comparison for the
    /// threshold of alphas.
    flushes_denormals: bool,
    paths: Vec<PathTest>,
    passed: bool,
}

#[derive(Serialize, JsonSchema)]
struct PathTest {
    path: render::Path,
    /// PSNR to the reference; null if the picture is equal or not finite.
    psnr_db: Option<f64>,
    /// Largest difference of a colour value from the reference; null if it is not finite.
    max_error: Option<f32>,
}

/// The statistics of a compiled stage: names and values.
#[derive(Serialize, JsonSchema)]
struct Pipeline {
    preset: String,
    stage: String,
    statistics: Vec<(String, String)>,
}

pub(super) fn run(args: &Args) -> Result<()> {
    args.json.as_ref().map_or(Ok(()), Sink::check)?;
    let mut report = Report {
        format: "smalto doctor 1".to_owned(),
        smalto: VersionReport::current(),
        devices: survey()?,
        self_test: None,
        pipelines: Vec::new(),
    };
    for (index, device) in report.devices.iter().enumerate() {
        print(index, device)?;
    }
    // A test that fails is in the report, too.
    let outcome = test(args, &mut report);
    args.json.as_ref().map_or(Ok(()), |sink| sink.write_json(&report))?;
    outcome
}

fn test(args: &Args, report: &mut Report) -> Result<()> {
    let device = args.device.open_anew()?;
    let Capabilities { name, kind, .. } = device.capabilities();
    say!("self-test on {name}{}", if device.is_validated() { ", validated" } else { "" })?;
    let (device_name, is_validated) = (name.clone(), device.is_validated());
    let flushes_denormals = render::flushes_denormals(&device)?;
    let test = report.self_test.insert(SelfTest {
        device: device_name,
        is_validated,
        flushes_denormals,
        paths: Vec::new(),
        passed: false,
    });
    say!("   exp2           {} denormal numbers", if flushes_denormals { "flushes" } else { "keeps" })?;
    self_test(&device, &mut test.paths)?;
    test.passed = true;
    say_memory(&device)?;
    if *kind == DeviceKind::Cpu {
        say!("   passed; this device is the processor, which is slow")?;
    } else {
        say!("   passed")?;
    }
    if args.pipelines { pipelines(&device, &mut report.pipelines) } else { Ok(()) }
}

/// Prints statistics of the pipelines for a scene with spherical harmonics of degree 3, with the presets that store
/// most and least.
fn pipelines(device: &Device, report: &mut Vec<Pipeline>) -> Result<()> {
    if !device.record_executables() {
        let name = &device.capabilities().name;
        remark(&format!("note: --pipelines: the driver of {name} has no statistics of pipelines"));
        return Ok(());
    }
    let gaussians = cactus(5000)?.gaussians;
    for (preset, options) in [("exact", Options::EXACT), ("balanced", Options::BALANCED)] {
        device.record_executables();
        Renderer::new(device, &options, &GpuScene::new(device, &gaussians, &options)?)?;
        let executables = device.take_executables();
        let names = executables.first().map_or(&[][..], |first| &first.statistics);
        let header: Vec<_> = [preset].into_iter().chain(names.iter().map(|(name, _)| name.as_str())).collect();
        let mut lines = table(&header);
        for Executable { stage, statistics } in &executables {
            lines.add_row([*stage].into_iter().chain(statistics.iter().map(|(_, value)| value.as_str())));
        }
        say_table(&lines)?;
        report.extend(executables.into_iter().map(|Executable { stage, statistics }| Pipeline {
            preset: preset.to_owned(),
            stage: stage.to_owned(),
            statistics,
        }));
    }
    Ok(())
}

fn print(index: usize, device: &Capabilities) -> Result<()> {
    let Capabilities { name, kind, driver, vulkan, subgroup_size: [smallest, largest], limits, .. } = device;
    say!("{index}  {name} ({kind}), {driver}, Vulkan {vulkan}")?;
    let free = device.memory_free_bytes.map_or_else(String::new, |free| format!(", {:.1} GB free", free as f64 / 1e9));
    say!("   memory         {:.1} GB{free}", device.memory_bytes as f64 / 1e9)?;
    say!("   subgroup       {smallest} to {largest} invocations")?;
    say!(
        "   largest        storage buffer {} bytes, allocation {} bytes, image {} px",
        limits.storage_range,
        limits.allocation,
        limits.image
    )?;
    say!("   workgroup      {} invocations, {} bytes", limits.workgroup_invocations, limits.workgroup_memory)?;
    say!(
        "   timestamps     {}",
        if limits.timestamp_bits == 0 {
            "none".to_owned()
        } else {
            format!("{} bits of {} ns", limits.timestamp_bits, limits.timestamp_ns)
        }
    )?;
    let optional: Vec<_> =
        device.features.iter().map(|(what, has)| format!("{what} {}", if *has { "yes" } else { "no" })).collect();
    say!("   optional       {}", optional.join(", "))?;
    if let Some(limit) = device.loop_limit {
        say!("   loops          at most {limit} iterations; long tile lists are blended in several passes")?;
    }
    match device.fast_subgroup() {
        Some(size) => say!("   fast path      yes, with subgroups of {size} invocations")?,
        None => say!(
            "   fast path      no; it needs subgroup shuffles, workgroups of 1024 and one subgroup size from 8 to 64"
        )?,
    }
    match &device.missing[..] {
        [] => say!("   usable         yes"),
        missing => say!("   usable         no; missing: {}", missing.join(", ")),
    }
}

/// Least PSNR to the reference in dB. f32 arithmetic reaches it if only a few decisions at thresholds differ.
const PSNR_MIN: f64 = 80.0;

/// Renders a small scene on the default path and on the portable path, and compares both with the reference.
fn self_test(device: &Device, report: &mut Vec<PathTest>) -> Result<()> {
    let gaussians = cactus(5000)?.gaussians;
    let camera = Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), [160, 120], 0.9);
    let scene = GpuScene::new(device, &gaussians, &Options::EXACT)?;
    let exact = reference::render(&gaussians, &camera, &Options::EXACT.rules, Background::BLACK).to_pixels();
    for portable in [false, true] {
        let options = Options { portable, ..Options::EXACT };
        let mut renderer = Renderer::new(device, &options, &scene)?;
        ensure!(renderer.notice().is_none(), "{}", renderer.notice().unwrap_or_default());
        let drawn_by = renderer.render(&camera, Background::BLACK)?.path;
        let path = format!("{drawn_by} path");
        let pixels = renderer.pixels()?;
        let (psnr, error) = (psnr(&pixels, &exact), max_error(&pixels, &exact));
        report.push(PathTest {
            path: drawn_by,
            psnr_db: Some(psnr).filter(|db| db.is_finite()),
            max_error: Some(error).filter(|error| error.is_finite()),
        });
        say!("   {path:<14} {psnr:.1} dB to the float64 reference, largest difference {error:.5}")?;
        if psnr.is_nan() || psnr < PSNR_MIN {
            bail!(
                "{} draws a wrong picture on the {path}: {psnr:.1} dB to the reference instead of at least {PSNR_MIN}",
                device.capabilities().name
            );
        }
    }
    complain(device)
}
