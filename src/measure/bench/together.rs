//! Frames per second of several devices that draw at the same time.

use std::time::{Duration, Instant};

use anyhow::Result;
use crossbeam_channel::bounded;

use super::measure::draw_in_flight;
use super::report::DeviceSpeed;
use crate::camera::Camera;
use crate::gpu::{Device, Timestamps};
use crate::options::Options;
use crate::render::{GpuScene, Renderer};
use crate::threads::{self, joined};

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
    // No message is ever sent: a device is prepared, or has failed, when its end of the one channel is dropped, and all
    // may begin when the end of the other is.
    let (preparing, all_prepared) = bounded::<()>(0);
    let (hold, begin) = bounded::<()>(0);
    threads::scope(|threads| {
        let mut started = Vec::new();
        for device in devices {
            let (preparing, begin) = (preparing.clone(), begin.clone());
            let measure = move || -> Result<DeviceSpeed> {
                let mut renderer = prepare(device, load, options, views)?;
                drop(preparing);
                _ = begin.recv();
                let frames_per_second = frames_per_second(&mut renderer, views, MEASURED)?;
                Ok(DeviceSpeed { device: device.capabilities().name.clone(), frames_per_second })
            };
            started.push(threads.spawn(measure)?);
        }
        drop(preparing);
        _ = all_prepared.recv();
        drop(hold);
        started.into_iter().map(joined).collect()
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
