//! The viewer without a window: draws the same frames with the same panels into an image, as fast as possible.

use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use egui::{RawInput, ViewportId, ViewportInfo};

use crate::camera::NamedCamera;
use crate::gpu::Device;
use crate::measure::bench::Statistics;
use crate::render::{Path, Residency};
use crate::viewer::frame::{FrameOutput, Screen, Session};
use crate::viewer::model::{CompareTarget, Digest, Drawn, Jobs, Setup, Viewer};

/// A viewer that a program drives, without a window.
pub struct Offscreen {
    pub session: Session,
    size: [u32; 2],
    started: Instant,
    /// The events that no layout has handled yet.
    events: Vec<egui::Event>,
}

/// The timings of frames without a window, and the last frame.
pub struct Summary {
    /// Milliseconds from one frame to the next.
    pub interval_ms: Statistics,
    /// Along a path: frames that were not ready in time.
    pub late: Option<u32>,
    /// The path that drew the last frame; `None` if nothing was drawn.
    pub path: Option<Path>,
    /// GPU time of the last frames and of their stages; `None` if nothing was drawn.
    pub gpu: Option<Digest>,
    /// Set if the scene is read page by page.
    pub pages: Option<PageCounts>,
    pub first_frame_ms: f64,
    /// Processor time of the layouts of the panels in milliseconds, if there were any.
    pub layout_ms: Option<Statistics>,
    /// Mean milliseconds from an input to the submission of the picture that answers it.
    pub latency_ms: f64,
    /// The pixels of the last frame, row by row: red, green, blue and alpha.
    pub screen: Vec<[u8; 4]>,
}

/// Missing pages of frames that did not wait for pages.
pub struct PageCounts {
    /// Pages drawn coarser than requested: mean and maximum over the frames.
    pub missing: [f64; 2],
    /// Fraction of the frames without missing pages.
    pub whole: f64,
    /// Residency after the last frame.
    pub residency: Residency,
}

impl Offscreen {
    pub fn new(setup: Setup, device: &Device, size: [u32; 2]) -> Result<Self> {
        Self::with_wake(setup, device, size, Arc::new(|| {}))
    }

    /// A viewer whose frames are pictures without anything over them. `wake` is called, from any thread, when a job has
    /// sent an event.
    pub fn bare(setup: Setup, device: &Device, size: [u32; 2], wake: Arc<dyn Fn() + Send + Sync>) -> Result<Self> {
        let mut bare = Self::with_wake(Setup { hides_panels: true, ..setup }, device, size, wake)?;
        bare.viewer().panels.are_elsewhere = true;
        Ok(bare)
    }

    fn with_wake(setup: Setup, device: &Device, size: [u32; 2], wake: Arc<dyn Fn() + Send + Sync>) -> Result<Self> {
        let screen = Screen::offscreen(device, size)?;
        let viewer = Viewer::new(setup, Jobs::new(wake), size);
        let session = Session::new(viewer, screen, egui::Context::default());
        Ok(Self { session, size, started: Instant::now(), events: Vec::new() })
    }

    /// Shows what another viewer has read: its scenes, also those on the device, its cameras and its view.
    pub fn join(&mut self, other: &Self) {
        self.session.viewer.join(&other.session.viewer);
        self.borrow_scene(other);
    }

    /// Shows what another viewer has read again, and what it has said since a time.
    pub fn follow(&mut self, other: &Self, since: Instant) {
        let has_changed = self.session.viewer.follow(&other.session.viewer, since);
        if has_changed || self.session.pair.first.is_none() {
            self.borrow_scene(other);
        }
    }

    /// Draws on another device. [`Session::close`] was called before, as that before is lost.
    pub fn reopen(&mut self, device: &Device) -> Result<()> {
        self.session.replace_screen(Screen::offscreen(device, self.size)?);
        Ok(())
    }

    fn borrow_scene(&mut self, other: &Self) {
        self.session.pair.lent = other.session.pair.first.as_ref().map(Drawn::reusable);
    }

    /// Gives the next frames another size, in pixels.
    pub fn resize(&mut self, size: [u32; 2]) -> Result<()> {
        self.size = size;
        self.session.screen.fit(size).map(|_| ())
    }

    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    pub fn viewer(&mut self) -> &mut Viewer {
        &mut self.session.viewer
    }

    /// Draws one frame. The events are handled by it or, if the panels were laid out just before, by a later frame.
    pub fn frame(&mut self, events: Vec<egui::Event>) -> Result<FrameOutput> {
        self.session.wait_for_slot()?;
        self.events.extend(events);
        let (size, started, pending) = (self.size, self.started, &mut self.events);
        let input = || {
            let events = std::mem::take(pending);
            let mut input = RawInput { events, time: Some(started.elapsed().as_secs_f64()), ..RawInput::default() };
            let viewport = ViewportInfo { native_pixels_per_point: Some(1.0), ..ViewportInfo::default() };
            input.viewports.insert(ViewportId::ROOT, viewport);
            let [width, height] = size.map(|side| side as f32);
            input.screen_rect = Some(egui::Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(width, height)));
            input
        };
        self.session.frame(input, size)
    }

    /// Draws frames until everything that was requested is read, built, drawn and shown.
    ///
    /// # Errors
    /// A failure, or an error message that the window would show.
    pub fn settle(&mut self) -> Result<()> {
        loop {
            let has_layout = self.frame(Vec::new())?.platform.is_some();
            self.session.retire_frames(true)?;
            if let Some(failure) = self.viewer().messages.failure.take() {
                return Err(failure);
            }
            if let Some(problem) = self.viewer().messages.shown().iter().find(|message| message.is_error) {
                bail!("{}", problem.text);
            }
            if has_layout && self.session.is_settled() {
                return Ok(());
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// The pixels of the frame shown last, row by row: red, green, blue and alpha.
    pub fn screen(&mut self) -> Result<Vec<[u8; 4]>> {
        self.session.screen.read(&mut self.session.pair)?.context("the screen of this session is a window")
    }
}

/// Opens scenes and draws `frames` frames, each from the next camera of the file or, without a file, from the first
/// view. With a path, each from its next camera, at [`PATH_FPS`] frames a second at most.
pub fn run(setup: Setup, device: &Device, size: [u32; 2], frames: u32, path: Vec<NamedCamera>) -> Result<Summary> {
    let mut offscreen = Offscreen::new(setup, device, size)?;
    let summary = draw(&mut offscreen, frames, path);
    offscreen.viewer().jobs.wait();
    summary
}

/// Most frames a second along a path: the refresh rate of a usual screen.
pub const PATH_FPS: f64 = 60.0;

fn draw(offscreen: &mut Offscreen, frames: u32, path: Vec<NamedCamera>) -> Result<Summary> {
    offscreen.settle()?;
    let first_frame_ms = offscreen.started.elapsed().as_secs_f64() * 1e3;
    let is_paced = !path.is_empty();
    if is_paced {
        offscreen.viewer().cameras.list = path;
        offscreen.viewer().go_to_camera(0, true);
        offscreen.settle()?;
    }
    let (mut intervals, mut layouts, mut missing, mut late) = (Vec::new(), Vec::new(), Vec::new(), 0);
    let mut due = Instant::now();
    for frame in 0..frames {
        let begun = Instant::now();
        let viewer = offscreen.viewer();
        // The reference is drawn for one view only.
        let stays = viewer.setup.start.is_some() || viewer.comparison.target == CompareTarget::Reference;
        if !viewer.cameras.list.is_empty() && !stays {
            viewer.go_to_camera(frame as usize % viewer.cameras.list.len(), true);
        }
        viewer.pictures.are_stale = true;
        let moved = egui::Event::PointerMoved(egui::pos2(frame as f32 % 100.0, 50.0));
        if offscreen.frame(vec![moved])?.platform.is_some() {
            layouts.push(offscreen.viewer().timing.layout_ms);
        }
        if is_paced {
            due += Duration::from_secs_f64(1.0 / PATH_FPS);
            late += u32::from(due < Instant::now());
            due = due.max(Instant::now());
            std::thread::sleep(due - Instant::now());
        }
        intervals.push(begun.elapsed().as_secs_f64() * 1e3);
        missing.extend(offscreen.session.residency().map(|residency| f64::from(residency.missing)));
    }
    offscreen.session.retire_frames(true)?;
    let screen = offscreen.screen()?;
    let path = offscreen.session.pair.first.as_ref().map(|drawn| drawn.path);
    let pages = offscreen.session.residency().map(|residency| PageCounts {
        missing: [missing.iter().sum::<f64>() / f64::from(frames), missing.iter().copied().fold(0.0, f64::max)],
        whole: missing.iter().filter(|missing| **missing == 0.0).count() as f64 / f64::from(frames),
        residency,
    });
    let viewer = offscreen.viewer();
    // The first frames fill the pipeline and warm the device up; they do not count.
    let measured = intervals.split_off(intervals.len() / 4);
    Ok(Summary {
        interval_ms: Statistics::of(measured),
        late: is_paced.then_some(late),
        path,
        gpu: viewer.timing.frame_times.digest_now(),
        pages,
        first_frame_ms,
        layout_ms: (!layouts.is_empty()).then(|| Statistics::of(layouts)),
        latency_ms: viewer.timing.pace.mean_latency_ms,
        screen,
    })
}
