//! The latency of frames that several devices draw in bands.

use std::time::{Duration, Instant};

use anyhow::Result;

use super::measure::stage_times;
use super::report::{SplitDevice, SplitReport, StageTime};
use super::statistics::Statistics;
use crate::camera::Camera;
use crate::gpu::Device;
use crate::options::Options;
use crate::pixels::Integers;
use crate::render::{DrawnBand, Form, Frame, FrameOutputs, GpuScene, Renderer, SplitFrame, SplitRenderer};
use crate::rules::Background;
use crate::threads::{self, joined};

/// Least duration of the warm-up, which draws all views at least twice, and most of the measurement.
const WARM_UP: Duration = Duration::from_secs(1);
const MEASURED: Duration = Duration::from_secs(10);

/// Measures at most `frames` frames in bands. `load` loads the scene onto a device.
///
/// # Errors
/// If a device fails.
pub fn split(
    devices: &[Device],
    load: &(dyn Fn(&Device) -> Result<GpuScene> + Sync),
    options: &Options,
    views: &[Camera],
    frames: usize,
) -> Result<SplitReport> {
    let alone = measure(&devices[..1], load, options, views, frames)?;
    let frames = measure(devices, load, options, views, frames)?;
    let latency = |frames: &[Measured]| Statistics::of(frames.iter().map(|frame| frame.latency_ms));
    let slowest = |frame: &Measured| frame.bands.iter().map(|band| band.frame.gpu_ms()).fold(0.0, f64::max);
    let over_mean = |frame: &Measured| {
        let sum: f64 = frame.bands.iter().map(|band| band.frame.gpu_ms()).sum();
        slowest(frame) * frame.bands.len() as f64 / sum
    };
    let of_device = |number: usize| {
        let bands = || frames.iter().filter_map(move |frame| Some((frame, frame.bands.get(number)?)));
        let first = bands().next()?.1;
        let stages = stage_times(Vec::from_iter(bands().map(|(_, band)| &band.frame)).into_iter());
        let stage = |(name, ms): (&str, Statistics)| StageTime { name: name.to_owned(), ms: ms.median };
        Some(SplitDevice {
            device: first.device.clone(),
            rows: Statistics::of(bands().map(|(_, band)| f64::from(band.rows))),
            gpu_ms: Statistics::of(bands().map(|(_, band)| band.frame.gpu_ms())),
            wait_ms: Statistics::of(bands().map(|(frame, band)| frame.latency_ms - band.latency_ms)),
            transfer_ms: Statistics::of(bands().map(|(_, band)| band.latency_ms - band.frame.gpu_ms())),
            stages: stages.into_iter().map(stage).collect(),
        })
    };
    Ok(SplitReport {
        latency_ms: latency(&frames),
        latency_alone_ms: latency(&alone),
        slowest_gpu_ms: Statistics::of(frames.iter().map(slowest)),
        gpu_alone_ms: Statistics::of(alone.iter().map(slowest)),
        slowest_over_mean: Statistics::of(frames.iter().map(over_mean)),
        devices: (0..devices.len()).filter_map(of_device).collect(),
    })
}

/// A measured frame.
struct Measured {
    latency_ms: f64,
    bands: Vec<MeasuredBand>,
}

struct MeasuredBand {
    device: String,
    rows: u32,
    latency_ms: f64,
    frame: Frame,
}

impl Measured {
    fn of(frame: &SplitFrame) -> Self {
        let ms = |duration: Duration| 1e3 * duration.as_secs_f64();
        let band = |band: &DrawnBand| MeasuredBand {
            device: band.device.clone(),
            rows: band.band.rows,
            latency_ms: ms(band.latency),
            frame: band.frame.clone(),
        };
        Self { latency_ms: ms(frame.latency), bands: frame.bands.iter().map(band).collect() }
    }
}

fn measure(
    devices: &[Device],
    load: &(dyn Fn(&Device) -> Result<GpuScene> + Sync),
    options: &Options,
    views: &[Camera],
    frames: usize,
) -> Result<Vec<Measured>> {
    let make = |device| Renderer::new(device, options, &load(device)?);
    let renderers = threads::scope(|threads| -> Result<Vec<_>> {
        let making = devices.iter().map(|device| threads.spawn(move || make(device)));
        let making = making.collect::<Result<Vec<_>, _>>()?;
        devices.iter().zip(making).map(|(device, making)| Ok((device, joined(making)?))).collect()
    })?;
    let mut split = SplitRenderer::new(options, renderers)?;
    let outputs = FrameOutputs { picture: vec![Form::Integers(Integers::Rgb8)], ..FrameOutputs::default() };
    let mut draw = |view: &Camera| -> Result<Measured> {
        let frame = split.render(view, Background::BLACK, &outputs)?;
        let measured = Measured::of(&frame);
        split.recycle(frame);
        // A measurement of fewer devices would be one of something else.
        split.take_lost().pop().map_or(Ok(measured), |lost| Err(lost.error.context(lost.name)))
    };
    let started = Instant::now();
    for (number, view) in views.iter().cycle().enumerate() {
        let is_slow = number > 0 && started.elapsed() > MEASURED;
        if is_slow || number >= 2 * views.len() && started.elapsed() > WARM_UP {
            break;
        }
        draw(view)?;
    }
    let started = Instant::now();
    let mut measured = Vec::new();
    for view in views.iter().cycle().take(frames.max(1)) {
        measured.push(draw(view)?);
        if started.elapsed() > MEASURED {
            break;
        }
    }
    Ok(measured)
}
