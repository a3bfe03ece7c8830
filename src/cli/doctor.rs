//! `smalto doctor`: lists the Vulkan devices and tests one of them.

use anyhow::{Result, bail, ensure};
use glam::DVec3;

use super::table::{say_table, table};
use super::{DeviceArgs, complain, say};
use crate::camera::Camera;
use crate::gpu::{Capabilities, Device, Executable, Unavailable, survey};
use crate::measure::metrics::{max_error, psnr};
use crate::options::Options;
use crate::reference;
use crate::render::{GpuScene, Renderer};
use crate::rules::Background;
use crate::scene::synthetic;

/// List the Vulkan devices and the features they lack, and test one of them against the reference
#[derive(clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    device: DeviceArgs,
    /// Print the devices as JSON, without the self-test
    #[arg(long)]
    json: bool,
    /// Also list the driver's statistics of the compiled shaders, such as their registers
    #[arg(long, conflicts_with = "json")]
    pipelines: bool,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let devices = survey()?;
    if args.json {
        return say!("{}", serde_json::to_string_pretty(&devices)?);
    }
    for (index, device) in devices.iter().enumerate() {
        print(index, device)?;
    }
    let device = args.device.open()?;
    say!("self-test on {}{}", device.capabilities().name, if device.is_validated() { ", validated" } else { "" })?;
    self_test(&device)?;
    if args.pipelines { pipelines(&device) } else { Ok(()) }
}

/// Prints statistics of the pipelines for a scene with spherical harmonics of degree 3, with the presets that store
/// most and least.
fn pipelines(device: &Device) -> Result<()> {
    if !device.record_executables() {
        return Err(Unavailable(format!(
            "the driver of {} has no statistics of pipelines",
            device.capabilities().name
        ))
        .into());
    }
    let gaussians = synthetic::cactus(5000)?.gaussians;
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
fn self_test(device: &Device) -> Result<()> {
    let gaussians = synthetic::cactus(5000)?.gaussians;
    let camera = Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), [160, 120], 0.9);
    let scene = GpuScene::new(device, &gaussians, &Options::EXACT)?;
    let exact = reference::render(&gaussians, &camera, &Options::EXACT.rules, Background::BLACK).to_pixels();
    for portable in [false, true] {
        let options = Options { portable, ..Options::EXACT };
        let mut renderer = Renderer::new(device, &options, &scene)?;
        ensure!(renderer.notice().is_none(), "{}", renderer.notice().unwrap_or_default());
        let path = format!("{} path", renderer.render(&camera, Background::BLACK)?.path);
        let pixels = renderer.pixels()?;
        let (psnr, error) = (psnr(&pixels, &exact), max_error(&pixels, &exact));
        say!("   {path:<14} {psnr:.1} dB to the float64 reference, largest difference {error:.5}")?;
        if psnr.is_nan() || psnr < PSNR_MIN {
            bail!(
                "{} draws a wrong picture on the {path}: {psnr:.1} dB to the reference instead of at least {PSNR_MIN}",
                device.capabilities().name
            );
        }
    }
    complain(device)?;
    say!("   passed")
}
