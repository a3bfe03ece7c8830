//! Frames a second of several devices that draw at the same time.

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

/// Time in which devices draw before they are measured, and time in which they are.
const WARM_UP: Duration = Duration::from_secs(1);
const MEASURED: Duration = Duration::from_secs(2);

/// Measures devices that draw the views of a scene at the same time, each in its own order of time. `bring` brings the
/// scene to a device.
///
/// # Errors
/// If a device fails.
pub fn together(
    devices: &[Device],
    bring: &(dyn Fn(&Device) -> Result<GpuScene> + Sync),
    options: &Options,
    views: &[Camera],
) -> Result<Vec<DeviceSpeed>> {
    let ready = Barrier::new(devices.len());
    let measure = &|device: &Device| -> Result<DeviceSpeed> {
        let prepared = catch_unwind(AssertUnwindSafe(|| prepare(device, bring, options, views)));
        // All devices come here, those that failed, too: nobody waits for ever.
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
    bring: &(dyn Fn(&Device) -> Result<GpuScene> + Sync),
    options: &Options,
    views: &[Camera],
) -> Result<Renderer> {
    let scene = bring(device)?;
    let mut renderer = Renderer::new(device, options, &scene)?;
    renderer.set_timestamps(Timestamps::Outermost);
    frames_per_second(&mut renderer, views, WARM_UP)?;
    Ok(renderer)
}

/// Draws for this time, at least one frame.
fn frames_per_second(renderer: &mut Renderer, views: &[Camera], time: Duration) -> Result<f64> {
    let (started, mut done) = (Instant::now(), 0);
    let views = views.iter().cycle().take_while(|_| started.elapsed() < time);
    draw_in_flight(renderer, views, &mut || done += 1)?;
    Ok(f64::from(done) / started.elapsed().as_secs_f64())
}
