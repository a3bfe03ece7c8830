//! Frames per second of several devices that draw at the same time.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Barrier;
use std::time::{Duration, Instant};

use anyhow::Result;

use super::measure::draw_in_flight;
use super::report::DeviceSpeed;
use crate::camera::Camera;
use crate::gpu::{Device, Timestamps};
use crate::options::Options;
use crate::render::{GpuScene, Renderer};

/// Durations of the warm-up and of the measurement.
const WARM_UP: Duration = Duration::from_secs(1);
const MEASURED: Duration = Duration::from_secs(2);

/// Measures devices that draw the views of a scene at the same time, each on a thread of its own. `load` loads the
/// scene onto a device.
///
/// # Errors
/// If a device fails.
pub fn together(
    devices: &[Device],
    load: &(dyn Fn(&Device) -> Result<GpuScene> + Sync),
    options: &Options,
    views: &[Camera],
) -> Result<Vec<DeviceSpeed>> {
    let ready = Barrier::new(devices.len());
    let measure = &|device: &Device| -> Result<DeviceSpeed> {
        let prepared = catch_unwind(AssertUnwindSafe(|| prepare(device, load, options, views)));
        // Threads of failed devices wait here, too, so that no thread waits forever.
        ready.wait();
        let mut renderer = prepared.unwrap_or_else(|panic| resume_unwind(panic))?;
        let frames_per_second = frames_per_second(&mut renderer, views, MEASURED)?;
        Ok(DeviceSpeed { device: device.capabilities().name.clone(), frames_per_second })
    };
    std::thread::scope(|threads| {
        let started: Vec<_> = devices.iter().map(|device| threads.spawn(move || measure(device))).collect();
        started.into_iter().map(|thread| thread.join().unwrap_or_else(|panic| resume_unwind(panic))).collect()
    })
}

fn prepare(
    device: &Device,
    load: &(dyn Fn(&Device) -> Result<GpuScene> + Sync),
    options: &Options,
    views: &[Camera],
) -> Result<Renderer> {
    let scene = load(device)?;
    let mut renderer = Renderer::new(device, options, &scene)?;
    renderer.set_timestamps(Timestamps::Outermost);
    frames_per_second(&mut renderer, views, WARM_UP)?;
    Ok(renderer)
}

/// Frames per second while drawing for this time, at least one frame.
fn frames_per_second(renderer: &mut Renderer, views: &[Camera], time: Duration) -> Result<f64> {
    let (started, mut done) = (Instant::now(), 0);
    let views = views.iter().cycle().take_while(|_| started.elapsed() < time);
    draw_in_flight(renderer, views, &mut || done += 1)?;
    Ok(f64::from(done) / started.elapsed().as_secs_f64())
}
