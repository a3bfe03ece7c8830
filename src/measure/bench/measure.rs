//! The measurement of a run: whole frames, stages, throughput and counts, each in frames of its own.

use std::cell::Cell;
use std::collections::VecDeque;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};

use super::bandwidth::copy_gb_s;
use super::clocks::ClockProbe;
use super::machine::Clocks;
use super::report::{Allocation, Counts, DetailReport, FrameTimes, Run, StageReport, Subject, image_hash};
use super::statistics::Statistics;
use super::warm_up::{Protocol, WarmUp, WarmUpLimits};
use crate::camera::Camera;
use crate::gpu::{Device, Timestamps};
use crate::options::Options;
use crate::render;
use crate::render::{Frame, GpuScene, Renderer, Totals, tiles};
use crate::rules::Background;

/// Frames in flight when throughput is measured: one runs while the next is recorded.
const IN_FLIGHT: usize = 2;

/// The device to measure on, and the protocol.
pub struct Bench {
    pub device: Device,
    pub protocol: Protocol,
    /// Time for the frames of each kind; fewer are measured if they take longer. `None`: no limit.
    pub patience: Option<Duration>,
    /// Bandwidth of a plain copy, bytes read plus bytes written, in 1e9 bytes per second.
    pub copy_gb_s: f64,
}

/// A measured frame.
struct Measured {
    frame: Frame,
    /// Wall time from the begin to the end of the wait.
    wall_ms: f64,
    path: render::Path,
    /// Least bytes of each stage, by the stage's name.
    least_bytes: Vec<(&'static str, u64)>,
}

impl Bench {
    /// Measures the bandwidth of the device.
    ///
    /// # Errors
    /// If the device has no timestamps.
    pub fn new(device: &Device, protocol: Protocol) -> Result<Self> {
        Ok(Self { device: device.clone(), protocol, patience: None, copy_gb_s: copy_gb_s(device)? })
    }

    /// Measures fewer frames of each kind, if they would take longer than `patience`.
    #[must_use]
    pub fn patient(self, patience: Duration) -> Self {
        Self { patience: Some(patience), ..self }
    }

    /// The bench with the protocol that its patience allows for these frames.
    fn within_patience(&self, renderer: &mut Renderer, view: &Camera) -> Result<Self> {
        let mut protocol = self.protocol;
        if let Some(patience) = self.patience {
            // The first frame may grow buffers.
            renderer.render(view, Background::BLACK)?;
            let second = Instant::now();
            renderer.render(view, Background::BLACK)?;
            protocol = protocol.within(patience, second.elapsed());
        }
        Ok(Self { device: self.device.clone(), protocol, patience: None, copy_gb_s: self.copy_gb_s })
    }

    /// Measures a scene over `views`, which are of one size: frame `i` shows view `i`, from the first again after the
    /// last. `progress` receives the completed fraction.
    ///
    /// # Errors
    /// If rendering fails, or if a timed stage does not state its bytes.
    pub fn measure(
        &self,
        subject: Subject,
        scene: &GpuScene,
        options: &Options,
        views: &[Camera],
        progress: &dyn Fn(f64),
    ) -> Result<Run> {
        let mut renderer = Renderer::new(&self.device, options, scene)?;
        let bench = self.within_patience(&mut renderer, &views[0])?;
        let count = bench.protocol.frames;
        let spread = |i: usize| views[i * views.len() / count].clone();
        let spread: Vec<_> = (0..count.min(views.len())).map(spread).collect();
        let shown = if count < views.len() { &spread } else { views };
        bench.run(renderer, subject, scene, options, shown, progress)
    }

    /// Measures with a new renderer.
    fn run(
        &self,
        mut renderer: Renderer,
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
        let mut warm_up = None;
        let whole = self.frames(&mut renderer, views, Timestamps::Outermost, &mut warm_up, &tick)?;
        let staged = self.frames(&mut renderer, views, Timestamps::All, &mut warm_up, &tick)?;
        let pipelined_ms = self.pipelined(&mut renderer, views, &mut warm_up, &tick)?;
        let clocks = self.clocks(&mut renderer, views)?;
        let gpu_ms = Statistics::of(whole.iter().map(|measured| measured.frame.gpu_ms()));
        let staged_gpu_ms = Statistics::of(staged.iter().map(|measured| measured.frame.gpu_ms()));
        let frame = FrameTimes {
            gpu_ms,
            wall_ms: Statistics::of(whole.iter().map(|measured| measured.wall_ms)),
            pipelined_ms,
            staged_gpu_ms,
            timestamps_cost_ms: staged_gpu_ms.median - gpu_ms.median,
        };
        let memory = scene.buffers().into_iter().chain(renderer.buffers());
        let memory = memory.map(|(name, bytes)| Allocation { buffer: name.to_owned(), bytes }).collect();
        let allocated_bytes = self.device.allocated_bytes();

        // The hash is that of a frame without counters: those with counters are drawn by the portable path.
        renderer.render(&views[(self.protocol.frames - 1) % views.len()], Background::BLACK)?;
        let image_hash = image_hash(&renderer.pixels()?);
        let paths: Vec<_> = staged.iter().map(|measured| measured.path).collect();
        let notice = notice(&renderer, &paths);
        let counted = if scene.is_placed() {
            // Only the portable path counts instances and work, and it does not draw scenes at places.
            let known = |measured: &Measured| Totals { listed_kept: 0, longest_list: 0, ..measured.frame.totals };
            staged.iter().map(known).collect()
        } else {
            renderer.count_work(true)?;
            self.totals(&mut renderer, views, &tick)?
        };
        Ok(Run {
            counts: counts(&counted, &staged, subject.size, options.drawn_size(subject.size)),
            subject,
            drawn_by: paths[0],
            notice,
            frames: self.protocol.frames,
            warm_up,
            clocks,
            frame,
            stages: self.stages(&staged)?,
            detail: detail(&whole),
            memory,
            allocated_bytes,
            image_hash,
            certified_error: None,
            psnr_db: None,
            together: None,
            split: None,
        })
    }

    /// Warms up, and adds this to the warm-ups that are `done`.
    fn warm_up(&self, renderer: &mut Renderer, views: &[Camera], done: &mut Option<WarmUp>) -> Result<()> {
        let frame = |view: usize| Ok(renderer.render(&views[view], Background::BLACK)?.gpu_ms());
        let limits = match done {
            // The pipelines are warm: only the clocks may have dropped since.
            Some(WarmUp { is_steady: true, .. }) => {
                WarmUpLimits { window: WarmUpLimits::BRIEF.window, ..WarmUpLimits::THOROUGH }
            }
            _ => WarmUpLimits::THOROUGH.after(*done),
        };
        let next = self.protocol.warm_up(views.len(), limits, frame)?;
        *done = done.map_or(next, |done| next.map(|next| done.and(next)));
        Ok(())
    }

    fn frames(
        &self,
        renderer: &mut Renderer,
        views: &[Camera],
        timestamps: Timestamps,
        warm_up: &mut Option<WarmUp>,
        tick: &dyn Fn(),
    ) -> Result<Vec<Measured>> {
        renderer.set_timestamps(timestamps);
        self.warm_up(renderer, views, warm_up)?;
        let frame = |i: usize| {
            let view = &views[i % views.len()];
            let timed = |renderer: &mut Renderer| -> Result<(Frame, f64)> {
                let started = Instant::now();
                let frame = renderer.render(view, Background::BLACK)?;
                Ok((frame, started.elapsed().as_secs_f64() * 1e3))
            };
            let mut measured = timed(renderer)?;
            // A frame that had to grow its buffers is drawn again: it differs from those after it. If it needs a second
            // attempt even then, because its lists are too long for the fast path, that is its cost.
            if measured.0.attempts > 1 {
                measured = timed(renderer)?;
            }
            let (frame, wall_ms) = measured;
            tick();
            let least_bytes = renderer.least_bytes(&frame.totals, view);
            Ok(Measured { frame, wall_ms, path: renderer.path(), least_bytes })
        };
        (0..self.protocol.frames).map(frame).collect()
    }

    fn totals(&self, renderer: &mut Renderer, views: &[Camera], tick: &dyn Fn()) -> Result<Vec<Totals>> {
        let frame = |i: usize| {
            let frame = renderer.render(&views[i % views.len()], Background::BLACK)?;
            tick();
            Ok(frame.totals)
        };
        (0..self.protocol.frames).map(frame).collect()
    }

    /// Milliseconds per frame if the host does not wait for each.
    fn pipelined(
        &self,
        renderer: &mut Renderer,
        views: &[Camera],
        warm_up: &mut Option<WarmUp>,
        tick: &dyn Fn(),
    ) -> Result<f64> {
        renderer.set_timestamps(Timestamps::Outermost);
        self.warm_up(renderer, views, warm_up)?;
        let (count, started) = (self.protocol.frames, Instant::now());
        draw_in_flight(renderer, views.iter().cycle().take(count), &mut || tick())?;
        Ok(started.elapsed().as_secs_f64() * 1e3 / count as f64)
    }

    /// The clocks while a frame is on the device.
    fn clocks(&self, renderer: &mut Renderer, views: &[Camera]) -> Result<Option<Clocks>> {
        let probe = ClockProbe::new(&self.device);
        // The device may have lowered its clocks while the probe was created.
        let frame = |view: usize| Ok(renderer.render(&views[view], Background::BLACK)?.gpu_ms());
        self.protocol.warm_up(1, WarmUpLimits::BRIEF, frame)?;
        let started = renderer.start(&views[0], Background::BLACK)?;
        let clocks = probe.now();
        renderer.finish(started)?;
        Ok(clocks)
    }

    fn stages(&self, frames: &[Measured]) -> Result<Vec<StageReport>> {
        let stage = |(name, ms): (&str, Statistics)| {
            let bytes = frames.iter().map(|measured| stage_bytes(name, &measured.frame, &measured.least_bytes));
            let bytes = Statistics::of(bytes.collect::<Result<Vec<_>>>()?).median;
            let bandwidth_fraction = bytes / (self.copy_gb_s * 1e6) / ms.median.max(1e-6);
            Ok(StageReport { name: name.to_owned(), ms, least_bytes: bytes as u64, bandwidth_fraction })
        };
        let times = stage_times(frames.iter().map(|measured| &measured.frame));
        let mut stages = times.into_iter().map(stage).collect::<Result<Vec<_>>>()?;
        let gaps = frames.iter().map(|Measured { frame, .. }| {
            let inside: f64 = frame.timings.iter().filter(|t| t.depth == 1).map(|t| t.duration_ms).sum();
            frame.gpu_ms() - inside
        });
        let gaps = Statistics::of(gaps);
        stages.push(StageReport { name: "gaps".to_owned(), ms: gaps, least_bytes: 0, bandwidth_fraction: 0.0 });
        Ok(stages)
    }
}

/// The cuts of frames that were drawn by levels of detail.
fn detail(frames: &[Measured]) -> Option<DetailReport> {
    let cuts: Option<Vec<_>> = frames.iter().map(|measured| measured.frame.detail).collect();
    cuts.filter(|cuts| !cuts.is_empty()).map(|cuts| {
        let predicted: Vec<f64> = cuts.iter().filter_map(|cut| cut.predicted_psnr).collect();
        let mut report = DetailReport {
            nodes: Statistics::of(cuts.iter().map(|cut| cut.nodes)),
            pages: Statistics::of(cuts.iter().map(|cut| cut.pages as f64)),
            predicted_psnr: (!predicted.is_empty()).then(|| Statistics::of(predicted)),
            measured_psnr: None,
            standard_error: None,
            measurement_ms: None,
        };
        report.set_measured(&cuts);
        report
    })
}

/// Draws the views without waiting for each. `done` is called after every one.
pub(super) fn draw_in_flight<'v>(
    renderer: &mut Renderer,
    mut views: impl Iterator<Item = &'v Camera>,
    done: &mut dyn FnMut(),
) -> Result<()> {
    let mut in_flight = VecDeque::new();
    loop {
        if in_flight.len() < IN_FLIGHT
            && let Some(view) = views.next()
        {
            in_flight.push_back((view, renderer.start(view, Background::BLACK)?));
            continue;
        }
        let Some((view, oldest)) = in_flight.pop_front() else { return Ok(()) };
        // Lists that are too long for the fast path take a second attempt.
        if !renderer.finish(oldest)? {
            renderer.render(view, Background::BLACK)?;
        }
        done();
    }
}

/// Least bytes of a stage of a frame, 0 if the frame has no such stage.
fn stage_bytes(stage: &str, frame: &Frame, least_bytes: &[(&str, u64)]) -> Result<f64> {
    if !frame.timings.iter().any(|timing| timing.depth == 1 && timing.name == stage) {
        return Ok(0.0);
    }
    let mut entries = least_bytes.iter().filter(|(name, _)| *name == stage).map(|(_, bytes)| *bytes).peekable();
    entries.peek().with_context(|| format!("stage {stage} does not state its least bytes"))?;
    Ok(entries.sum::<u64>() as f64)
}

/// The renderer's notice, or the number of frames that another path drew than the first.
pub(crate) fn notice(renderer: &Renderer, paths: &[render::Path]) -> Option<String> {
    let others: Vec<_> = paths.iter().filter(|path| **path != paths[0]).collect();
    let mixed = || {
        let (other, count, all) = (others.first()?, others.len(), paths.len());
        Some(format!("{count} of {all} frames were drawn by the {other} path, the others by the {} path", paths[0]))
    };
    renderer.notice().map(str::to_owned).or_else(mixed)
}

/// The stages of timed frames in the order of their first appearance, each with its time per frame: 0 for frames
/// without it.
pub fn stage_times<'f>(frames: impl Iterator<Item = &'f Frame> + Clone) -> Vec<(&'static str, Statistics)> {
    let mut names: Vec<&'static str> = Vec::new();
    for frame in frames.clone() {
        let mut stages: Vec<_> = frame.timings.iter().filter(|t| t.depth == 1).collect();
        stages.sort_by(|a, b| a.start_ms.total_cmp(&b.start_ms));
        for stage in stages {
            if !names.contains(&stage.name) {
                names.push(stage.name);
            }
        }
    }
    let ms_of = |frame: &Frame, name: &str| -> f64 {
        frame.timings.iter().filter(|t| t.depth == 1 && t.name == name).map(|t| t.duration_ms).sum()
    };
    let of = |name| (name, Statistics::of(frames.clone().map(|frame| ms_of(frame, name))));
    names.into_iter().map(of).collect()
}

/// Counts of frames with counters (`frames`, whose splats are listed in tiles) and of the measured ones (`staged`).
fn counts(frames: &[Totals], staged: &[Measured], size_px: [u32; 2], drawn_px: [u32; 2]) -> Counts {
    let pixels = f64::from(size_px[0]) * f64::from(size_px[1]);
    let of = |value: &dyn Fn(&Totals) -> f64| Statistics::of(frames.iter().map(value));
    let tiles: u32 = tiles(drawn_px).iter().product();
    let fast = staged.iter().filter(|measured| matches!(measured.path, render::Path::Fast | render::Path::FastRays));
    let entries: Vec<f64> = fast.map(|measured| measured.frame.totals.listed_kept.into()).collect();
    Counts {
        visible: of(&|t| t.visible.into()),
        instances: of(&|t| t.listed_kept.into()),
        entries: (!entries.is_empty()).then(|| Statistics::of(entries)),
        tiles,
        listed_tiles: of(&|t| t.listed_tiles.into()),
        longest_list: of(&|t| t.longest_list.into()),
        listed_per_pixel: of(&|t| f64::from(t.listed_kept) / f64::from(tiles)),
        evaluations_per_pixel: of(&|t| t.evaluations() as f64 / pixels),
        lanes_per_pixel: of(&|t| t.walked() as f64 / pixels),
        early_exit_rate: of(&|t| f64::from(t.stopped_pixels) / pixels),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::Timing;

    fn frame(stages: &[&'static str]) -> Frame {
        let timing =
            |(i, name): (usize, &&'static str)| Timing { name, depth: 1, start_ms: i as f64, duration_ms: 1.0 };
        let timings = stages.iter().enumerate().map(timing).collect();
        Frame {
            totals: bytemuck::Zeroable::zeroed(),
            timings,
            attempts: 1,
            path: render::Path::Fast,
            parts: None,
            detail: None,
        }
    }

    #[test]
    fn a_timed_stage_without_bytes_is_an_error() {
        let frame = frame(&["clear", "sort"]);
        let stated = [("clear", 8), ("sort", 20), ("sort", 2)];
        assert_eq!(stage_bytes("sort", &frame, &stated).unwrap(), 22.0);
        assert_eq!(stage_bytes("blend", &frame, &stated).unwrap(), 0.0, "the frame has no such stage");
        let error = stage_bytes("sort", &frame, &stated[..1]).unwrap_err();
        assert_eq!(error.to_string(), "stage sort does not state its least bytes");
    }

    #[test]
    fn stages_of_frames_of_both_paths_are_listed() {
        let frames = [frame(&["clear", "sort", "blend"]), frame(&["clear", "scan", "blend"])];
        let times: Vec<_> = stage_times(frames.iter()).into_iter().map(|(name, ms)| (name, ms.mean)).collect();
        assert_eq!(times, [("clear", 1.0), ("sort", 0.5), ("blend", 1.0), ("scan", 0.5)]);
    }
}
