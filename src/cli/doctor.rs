//! `smalto doctor`: what Vulkan offers here, and whether it draws what it should.

use anyhow::{Result, bail, ensure};
use glam::DVec3;

use super::table::{say_table, table};
use super::{DeviceArgs, say};
use crate::camera::Camera;
use crate::gpu::{Device, DeviceFacts, Executable, Unavailable, survey};
use crate::measure::metrics::{max_error, psnr};
use crate::options::Options;
use crate::rules::Background;
use crate::reference;
use crate::render::{GpuScene, Renderer};
use crate::scene::synthetic;

/// List the Vulkan devices and what they lack, and test one of them against the reference
#[derive(clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    device: DeviceArgs,
    /// Print the devices as JSON, without the self-test
    #[arg(long)]
    json: bool,
    /// Also list what the driver says of the compiled shaders that draw a frame, such as their registers
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
    say!("self-test on {}{}", device.facts().name, if device.is_validated() { ", validated" } else { "" })?;
    self_test(&device)?;
    if args.pipelines { pipelines(&device) } else { Ok(()) }
}

/// For a scene of the highest degree, with the presets that store most and least.
fn pipelines(device: &Device) -> Result<()> {
    if !device.record_executables() {
        return Err(Unavailable(format!("{} says nothing of its pipelines", device.facts().name)).into());
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

fn print(index: usize, device: &DeviceFacts) -> Result<()> {
    let DeviceFacts { name, kind, driver, vulkan, subgroup_size: [smallest, largest], limits, .. } = device;
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
        device.optional.iter().map(|(what, has)| format!("{what} {}", if *has { "yes" } else { "no" })).collect();
    say!("   optional       {}", optional.join(", "))?;
    if let Some(limit) = device.loop_limit {
        say!("   loops          end after {limit} iterations; long tile lists are blended in passes")?;
    }
    match &device.missing[..] {
        [] => say!("   usable         yes"),
        missing => say!("   usable         no, it lacks {}", missing.join(", ")),
    }
}

/// Least agreement with the reference: what f32 arithmetic reaches with all decisions right but a few at thresholds.
const PSNR_MIN: f64 = 80.0;

/// Renders a small scene on the chosen path and on the portable one, and compares both with the reference.
fn self_test(device: &Device) -> Result<()> {
    let gaussians = synthetic::cactus(5000)?.gaussians;
    let camera = Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), [160, 120], 0.9);
    let scene = GpuScene::new(device, &gaussians, &Options::EXACT)?;
    let exact = reference::render(&gaussians, &camera, &Options::EXACT.rules, Background::BLACK).to_pixels();
    for portable in [false, true] {
        let options = Options { portable, ..Options::EXACT };
        let mut still = Renderer::new(device, &options, &scene)?;
        ensure!(still.notice().is_none(), "{}", still.notice().unwrap_or_default());
        still.render(&camera, Background::BLACK)?;
        let pixels = still.pixels()?;
        let (psnr, error) = (psnr(&pixels, &exact), max_error(&pixels, &exact));
        let path = if portable { "portable path" } else { "default path" };
        say!("   {path:<14} {psnr:.1} dB to the float64 reference, largest difference {error:.5}")?;
        if psnr.is_nan() || psnr < PSNR_MIN {
            bail!(
                "{} draws a wrong picture on the {path}: {psnr:.1} dB to the reference, {PSNR_MIN} expected",
                device.facts().name
            );
        }
    }
    let complaints = device.complaints();
    ensure!(complaints.is_empty(), "the device complained: {}", complaints.join("\n"));
    say!("   passed")
}
