//! The protocol: warm up, then measure whole frames, stages, throughput and work, each in frames of its own.

use std::cell::Cell;
use std::collections::VecDeque;
use std::time::{Duration, Instant};

use anyhow::{Result, ensure};

use super::bandwidth::copy_gb_s;
use super::least_bytes::Work;
use super::machine::{ClockProbe, Clocks};
use super::report::{Allocation, Counts, FrameTimes, Run, StageReport, Subject, image_hash};
use super::statistics::Statistics;
use crate::camera::Camera;
use crate::gpu::{Device, Timestamps};
use crate::options::Options;
use crate::rules::Background;
use crate::render::{Frame, GpuScene, Renderer, Totals, tiles};

/// How many frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Protocol {
    /// At least; unless 0, also for half a second.
    pub warmup: usize,
    /// At least one.
    pub frames: usize,
}

/// A device that rested while a scene was read takes as long to raise its clocks (over 0.1 s on an H100), however many
/// frames that is.
const WARM_UP: Duration = Duration::from_millis(500);

/// Frames in flight when throughput is measured: one runs while the next is recorded.
const IN_FLIGHT: usize = 2;

impl Protocol {
    /// Brings the device to its full clocks with frames that nobody measures. `frame` is told their number.
    pub fn warm_up(self, mut frame: impl FnMut(usize) -> Result<()>) -> Result<()> {
        let started = Instant::now();
        (0..)
            .take_while(|i| *i < self.warmup || self.warmup > 0 && started.elapsed() < WARM_UP)
            .try_for_each(&mut frame)
    }
}

/// A device to measure on, and by which rules.
pub struct Bench {
    pub device: Device,
    pub protocol: Protocol,
    /// What a plain copy moves, read and written, 1e9 bytes per second.
    pub copy_gb_s: f64,
}

impl Bench {
    /// # Errors
    /// If the device has no timestamps.
    pub fn new(device: &Device, protocol: Protocol) -> Result<Self> {
        Ok(Self { device: device.clone(), protocol, copy_gb_s: copy_gb_s(device)? })
    }

    /// Measures a scene over `views`, which are of one size: frame `i` shows view `i`, from the first again after the
    /// last. `progress` is told the fraction done.
    pub fn measure(
        &self,
        subject: Subject,
        scene: &GpuScene,
        options: &Options,
        views: &[Camera],
        progress: &dyn Fn(f64),
    ) -> Result<Run> {
        let done = Cell::new(0);
        let tick = || {
            done.set(done.get() + 1);
            progress(done.get() as f64 / (4 * self.protocol.frames) as f64);
        };
        let mut still = Renderer::new(&self.device, options, scene)?;
        let whole = self.frames(&mut still, views, Timestamps::Outermost, &tick)?;
        let staged = self.frames(&mut still, views, Timestamps::All, &tick)?;
        let pipelined_ms = self.pipelined(&mut still, views, &tick)?;
        let clocks = self.clocks(&mut still, views)?;
        let gpu_ms = Statistics::of(whole.iter().map(|(frame, _)| frame_ms(frame)));
        let staged_gpu_ms = Statistics::of(staged.iter().map(|(frame, _)| frame_ms(frame)));
        let frame = FrameTimes {
            gpu_ms,
            wall_ms: Statistics::of(whole.iter().map(|(_, wall_ms)| *wall_ms)),
            pipelined_ms,
            staged_gpu_ms,
            timestamps_cost_ms: staged_gpu_ms.median - gpu_ms.median,
        };
        let drawn: Vec<Camera> = views.iter().map(|view| view.sampled(options.drawn_size(view.size_px))).collect();
        let stages = self.stages(&still, scene, &drawn, &staged);
        let memory = scene.buffers().into_iter().chain(still.buffers());
        let memory = memory.map(|(name, bytes)| Allocation { buffer: name.to_owned(), bytes }).collect();
        let allocated_bytes = self.device.allocated_bytes();

        // Frames that count their work take the portable path, so the picture is that of one that does not.
        still.render(&views[(self.protocol.frames - 1) % views.len()], Background::BLACK)?;
        let image_hash = image_hash(&still.pixels()?);
        still.count_work(true)?;
        let counted = self.totals(&mut still, views, &tick)?;
        Ok(Run {
            counts: counts(&counted, subject.size, options.drawn_size(subject.size)),
            subject,
            clocks,
            frame,
            stages,
            memory,
            allocated_bytes,
            image_hash,
            certified_error: None,
            psnr_db: None,
        })
    }

    /// The measured frames, each with the wall time in milliseconds from its begin to the end of its wait.
    fn frames(
        &self,
        still: &mut Renderer,
        views: &[Camera],
        timestamps: Timestamps,
        tick: &dyn Fn(),
    ) -> Result<Vec<(Frame, f64)>> {
        still.set_timestamps(timestamps);
        self.protocol.warm_up(|i| still.render(&views[i % views.len()], Background::BLACK).map(drop))?;
        let frame = |i: usize| loop {
            let started = Instant::now();
            let frame = still.render(&views[i % views.len()], Background::BLACK)?;
            // The first frame that needs more room is not like those after it.
            if frame.attempts == 1 {
                let wall_ms = started.elapsed().as_secs_f64() * 1e3;
                tick();
                return Ok((frame, wall_ms));
            }
        };
        (0..self.protocol.frames).map(frame).collect()
    }

    fn totals(&self, still: &mut Renderer, views: &[Camera], tick: &dyn Fn()) -> Result<Vec<Totals>> {
        let frame = |i: usize| {
            let frame = still.render(&views[i % views.len()], Background::BLACK)?;
            tick();
            Ok(frame.totals)
        };
        (0..self.protocol.frames).map(frame).collect()
    }

    /// Milliseconds a frame when the host does not wait for each.
    fn pipelined(&self, still: &mut Renderer, views: &[Camera], tick: &dyn Fn()) -> Result<f64> {
        still.set_timestamps(Timestamps::Outermost);
        self.protocol.warm_up(|i| still.render(&views[i % views.len()], Background::BLACK).map(drop))?;
        let count = self.protocol.frames;
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
    }

    /// The clocks while a frame is on the device.
    fn clocks(&self, still: &mut Renderer, views: &[Camera]) -> Result<Option<Clocks>> {
        let probe = ClockProbe::new(&self.device);
        // The device may have rested while the probe was made.
        self.protocol.warm_up(|_| still.render(&views[0], Background::BLACK).map(drop))?;
        let started = still.start(&views[0], Background::BLACK)?;
        let clocks = probe.now();
        still.finish(started)?;
        Ok(clocks)
    }

    fn stages(&self, still: &Renderer, scene: &GpuScene, views: &[Camera], frames: &[(Frame, f64)]) -> Vec<StageReport> {
        let bytes_of = |i: usize, frame: &Frame, name: &str| {
            let view = &views[i % views.len()];
            let work = Work {
                scene,
                totals: &frame.totals,
                tiles: tiles(view.size_px).iter().product(),
                pixels: u64::from(view.size_px[0]) * u64::from(view.size_px[1]),
                sort_passes: still.sort_passes(view),
            };
            work.least_bytes(name) as f64
        };
        let stage = |(name, ms): (&str, Statistics)| {
            let bytes = frames.iter().enumerate().map(|(i, (frame, _))| bytes_of(i, frame, name));
            let bytes = Statistics::of(bytes).median;
            let bandwidth_fraction = bytes / (self.copy_gb_s * 1e6) / ms.median.max(1e-6);
            StageReport { name: name.to_owned(), ms, least_bytes: bytes as u64, bandwidth_fraction }
        };
        let times = stage_times(frames.iter().map(|(frame, _)| frame));
        let mut stages: Vec<_> = times.into_iter().map(stage).collect();
        let gaps = frames.iter().map(|(frame, _)| {
            let inside: f64 = frame.timings.iter().filter(|t| t.depth == 1).map(|t| t.duration_ms).sum();
            frame_ms(frame) - inside
        });
        let gaps = Statistics::of(gaps);
        stages.push(StageReport { name: "gaps".to_owned(), ms: gaps, least_bytes: 0, bandwidth_fraction: 0.0 });
        stages
    }
}

/// The stages of frames that were timed, in the order of the first, and what each took.
pub fn stage_times<'f>(frames: impl Iterator<Item = &'f Frame> + Clone) -> Vec<(&'static str, Statistics)> {
    let mut first: Vec<_> = frames.clone().take(1).flat_map(|f| f.timings.iter().filter(|t| t.depth == 1)).collect();
    first.sort_by(|a, b| a.start_ms.total_cmp(&b.start_ms));
    let ms_of = |frame: &Frame, name: &str| -> f64 {
        frame.timings.iter().filter(|t| t.depth == 1 && t.name == name).map(|t| t.duration_ms).sum()
    };
    let of = |name| (name, Statistics::of(frames.clone().map(|frame| ms_of(frame, name))));
    first.iter().map(|timing| of(timing.name)).collect()
}

/// GPU time of a frame in milliseconds.
pub fn frame_ms(frame: &Frame) -> f64 {
    frame.timings.iter().filter(|t| t.depth == 0).map(|t| t.duration_ms).sum()
}

fn counts(frames: &[Totals], size_px: [u32; 2], drawn_px: [u32; 2]) -> Counts {
    let pixels = f64::from(size_px[0]) * f64::from(size_px[1]);
    let of = |value: &dyn Fn(&Totals) -> f64| Statistics::of(frames.iter().map(value));
    let wide = |high: u32, low: u32| (u64::from(high) << 32 | u64::from(low)) as f64;
    let tiles: u32 = tiles(drawn_px).iter().product();
    Counts {
        visible: of(&|t| t.visible.into()),
        instances: of(&|t| t.listed_kept.into()),
        tiles,
        listed_tiles: of(&|t| t.listed_tiles.into()),
        longest_list: of(&|t| t.longest_list.into()),
        listed_per_pixel: of(&|t| f64::from(t.listed_kept) / f64::from(tiles)),
        evaluations_per_pixel: of(&|t| wide(t.evaluations_high, t.evaluations_low) / pixels),
        lanes_per_pixel: of(&|t| wide(t.walked_high, t.walked_low) / pixels),
        early_exit_rate: of(&|t| f64::from(t.stopped_pixels) / pixels),
    }
}
