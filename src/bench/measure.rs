//! The protocol: warm up, then measure whole frames, stages, throughput and work, each in frames of its own.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use anyhow::{Result, ensure};

use super::least_bytes::Work;
use super::machine::{ClockProbe, Clocks};
use super::report::{Allocation, Counts, FrameTimes, Run, SceneReport, StageReport};
use super::statistics::Statistics;
use crate::camera::Camera;
use crate::gpu::{Device, Timestamps};
use crate::options::{Background, Options};
use crate::render::{Frame, GpuScene, Still, Totals};

/// How many frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Protocol {
    pub warmup: usize,
    /// At least one.
    pub frames: usize,
}

/// A device that rested while a scene was read takes as long to raise its clocks (over 0.1 s on an H100), however
/// many frames that is.
const WARM_UP: Duration = Duration::from_millis(500);

/// Frames in flight when throughput is measured: one runs while the next is recorded.
const IN_FLIGHT: usize = 2;

/// Measures a scene over `views`, which are of one size: measured frame `i` shows view `i`, from the first again after
/// the last. `progress` is told the fraction done.
pub fn measure(
    device: &Device,
    scene: (&SceneReport, &GpuScene),
    options: (&str, &Options),
    views: &[Camera],
    protocol: Protocol,
    copy_gb_s: f64,
    progress: &dyn Fn(f64),
) -> Result<Run> {
    let ((scene_report, scene), (preset, options)) = (scene, options);
    let mut still = Still::new(device, options, scene)?;
    let all_frames = 3 * (protocol.warmup + protocol.frames) + protocol.frames;
    let done = std::cell::Cell::new(0);
    let tick = || {
        done.set(done.get() + 1);
        progress(done.get() as f64 / all_frames as f64);
    };
    warm_up(&mut still, views, protocol)?;
    let whole = timed(&mut still, views, protocol, Timestamps::Outermost, &tick)?;
    let staged = timed(&mut still, views, protocol, Timestamps::All, &tick)?;
    let pipelined_ms = pipelined(&mut still, views, protocol, &tick)?;
    let clocks = clocks(device, &mut still, views)?;
    still.count_work(true)?;
    let counted: Vec<Totals> =
        frames(&mut still, views, 0..protocol.frames, &tick)?.into_iter().map(|(frame, _)| frame.totals).collect();
    still.count_work(false)?;
    still.render(&views[(protocol.frames - 1) % views.len()], Background::BLACK)?;
    let pixels = still.pixels()?;

    let gpu_ms = Statistics::of(whole.iter().map(|(frame, _)| frame_ms(frame)));
    let staged_gpu_ms = Statistics::of(staged.iter().map(|(frame, _)| frame_ms(frame)));
    let buffers = scene.buffers().into_iter().chain(still.buffers());
    Ok(Run {
        scene: scene_report.clone(),
        size: views[0].size_px,
        preset: preset.to_owned(),
        near: options.near,
        clocks,
        frame: FrameTimes {
            gpu_ms,
            wall_ms: Statistics::of(whole.iter().map(|(_, wall_ms)| *wall_ms)),
            pipelined_ms,
            staged_gpu_ms,
            timestamps_cost_ms: staged_gpu_ms.median - gpu_ms.median,
        },
        stages: stages(&still, scene, views, &staged, copy_gb_s),
        counts: counts(&still, &counted, views[0].size_px),
        memory: buffers.map(|(name, bytes)| Allocation { buffer: name.to_owned(), bytes }).collect(),
        allocated_bytes: device.allocated_bytes(),
        image_hash: blake3::hash(bytemuck::cast_slice(&pixels.rgba)).to_hex().to_string(),
        psnr_db: None,
    })
}

/// Brings the device to its full clocks, unless no warm-up is wanted.
fn warm_up(still: &mut Still, views: &[Camera], protocol: Protocol) -> Result<()> {
    let started = Instant::now();
    while protocol.warmup > 0 && started.elapsed() < WARM_UP {
        frames(still, views, 0..1, &|| ())?;
    }
    Ok(())
}

/// Frames, each with the wall time in milliseconds from its begin to the end of its wait.
type Timed = Vec<(Frame, f64)>;

fn timed(
    still: &mut Still,
    views: &[Camera],
    protocol: Protocol,
    timestamps: Timestamps,
    tick: &dyn Fn(),
) -> Result<Timed> {
    still.set_timestamps(timestamps);
    frames(still, views, 0..protocol.warmup, tick)?;
    frames(still, views, 0..protocol.frames, tick)
}

fn frames(still: &mut Still, views: &[Camera], which: std::ops::Range<usize>, tick: &dyn Fn()) -> Result<Timed> {
    let mut frame = |i: usize| {
        let started = Instant::now();
        let frame = still.render(&views[i % views.len()], Background::BLACK)?;
        let wall_ms = started.elapsed().as_secs_f64() * 1e3;
        tick();
        Ok((frame, wall_ms))
    };
    which.map(&mut frame).collect()
}

/// Milliseconds a frame when the host does not wait for each.
fn pipelined(still: &mut Still, views: &[Camera], protocol: Protocol, tick: &dyn Fn()) -> Result<f64> {
    still.set_timestamps(Timestamps::Outermost);
    let mut run = |count: usize| -> Result<f64> {
        let started = Instant::now();
        let mut queue = VecDeque::new();
        for i in 0..count + IN_FLIGHT {
            if i < count {
                queue.push_back(still.start(&views[i % views.len()], Background::BLACK)?);
            }
            if i >= IN_FLIGHT - 1
                && let Some(oldest) = queue.pop_front()
            {
                ensure!(still.finish(oldest)?, "a frame no longer fits where it fitted before");
                tick();
            }
        }
        Ok(started.elapsed().as_secs_f64() * 1e3 / count as f64)
    };
    if protocol.warmup > 0 {
        run(protocol.warmup)?;
    }
    run(protocol.frames)
}

/// The clocks while a frame is on the device.
fn clocks(device: &Device, still: &mut Still, views: &[Camera]) -> Result<Option<Clocks>> {
    let probe = ClockProbe::new(device);
    frames(still, views, 0..views.len().min(10), &|| ())?; // the device may have rested while the probe was made
    let started = still.start(&views[0], Background::BLACK)?;
    let clocks = probe.now();
    still.finish(started)?;
    Ok(clocks)
}

fn frame_ms(frame: &Frame) -> f64 {
    frame.timings.iter().filter(|t| t.depth == 0).map(|t| t.duration_ms).sum()
}

fn stages(still: &Still, scene: &GpuScene, views: &[Camera], frames: &Timed, copy_gb_s: f64) -> Vec<StageReport> {
    let mut first: Vec<_> = frames[0].0.timings.iter().filter(|t| t.depth == 1).collect();
    first.sort_by(|a, b| a.start_ms.total_cmp(&b.start_ms));
    let ms_of = |frame: &Frame, name: &str| -> f64 {
        frame.timings.iter().filter(|t| t.depth == 1 && t.name == name).map(|t| t.duration_ms).sum()
    };
    let bytes_of = |i: usize, frame: &Frame, name: &str| {
        let view = &views[i % views.len()];
        let work = Work {
            scene,
            totals: &frame.totals,
            tiles: still.tiles(view.size_px),
            pixels: u64::from(view.size_px[0]) * u64::from(view.size_px[1]),
            sort_passes: still.sort_passes(view),
        };
        work.least_bytes(name) as f64
    };
    let stage = |name: &str| {
        let ms = Statistics::of(frames.iter().map(|(frame, _)| ms_of(frame, name)));
        let bytes = Statistics::of(frames.iter().enumerate().map(|(i, (frame, _))| bytes_of(i, frame, name))).median;
        let bandwidth_fraction = bytes / (copy_gb_s * 1e6) / ms.median.max(1e-6);
        StageReport { name: name.to_owned(), ms, least_bytes: bytes as u64, bandwidth_fraction }
    };
    let mut stages: Vec<_> = first.iter().map(|timing| stage(timing.name)).collect();
    let gaps = frames.iter().map(|(frame, _)| {
        let inside: f64 = frame.timings.iter().filter(|t| t.depth == 1).map(|t| t.duration_ms).sum();
        frame_ms(frame) - inside
    });
    let gaps = Statistics::of(gaps);
    stages.push(StageReport { name: "gaps".to_owned(), ms: gaps, least_bytes: 0, bandwidth_fraction: 0.0 });
    stages
}

fn counts(still: &Still, frames: &[Totals], size_px: [u32; 2]) -> Counts {
    let pixels = f64::from(size_px[0]) * f64::from(size_px[1]);
    let of = |value: &dyn Fn(&Totals) -> f64| Statistics::of(frames.iter().map(value));
    let wide = |high: u32, low: u32| (u64::from(high) << 32 | u64::from(low)) as f64;
    let tiles = still.tiles(size_px);
    Counts {
        visible: of(&|t| t.visible.into()),
        instances: of(&|t| t.instances_kept.into()),
        tiles,
        listed_tiles: of(&|t| t.listed_tiles.into()),
        longest_list: of(&|t| t.longest_list.into()),
        listed_per_pixel: of(&|t| f64::from(t.instances_kept) / f64::from(tiles)),
        evaluations_per_pixel: of(&|t| wide(t.evaluations_high, t.evaluations_low) / pixels),
        lanes_per_pixel: of(&|t| wide(t.walked_high, t.walked_low) / pixels),
        early_exit_rate: of(&|t| f64::from(t.stopped_pixels) / pixels),
    }
}
