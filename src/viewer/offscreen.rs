//! The viewer without a window: the same frames with the same panels into an image, as fast as they come.

use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use egui::{RawInput, ViewportId, ViewportInfo};

use super::comparison::With;
use super::history::Digest;
use super::jobs::Jobs;
use super::screen::Screen;
use super::session::{Session, Turn};
use super::state::{Setup, Viewer};
use crate::measure::bench::Statistics;
use crate::gpu::Device;

/// A viewer whose hands and eyes are a program's.
pub struct Offscreen {
    pub session: Session,
    size: [u32; 2],
    started: Instant,
    /// That no layout has answered yet.
    events: Vec<egui::Event>,
}

/// How frames without a window went.
pub struct Summary {
    /// Milliseconds from one frame to the next.
    pub interval_ms: Statistics,
    /// GPU time of the last frames and of their stages, if anything was drawn.
    pub gpu: Option<Digest>,
    pub first_frame_ms: f64,
    /// Milliseconds from an input to the submission of the picture that answers it, on average.
    pub latency_ms: f64,
    /// The last frame: rows of red, green, blue and alpha.
    pub screen: Vec<[u8; 4]>,
}

impl Offscreen {
    pub fn new(setup: Setup, device: &Device, size: [u32; 2]) -> Result<Self> {
        let screen = Screen::offscreen(device, size)?;
        let viewer = Viewer::new(setup, Jobs::new(Arc::new(|| {})), size);
        let session = Session::new(viewer, screen, egui::Context::default());
        Ok(Self { session, size, started: Instant::now(), events: Vec::new() })
    }

    pub fn viewer(&mut self) -> &mut Viewer {
        &mut self.session.viewer
    }

    /// One frame; these events are answered by it or, if panels were laid out just before, by one of the next.
    pub fn frame(&mut self, events: Vec<egui::Event>) -> Result<Turn> {
        self.session.make_room()?;
        self.events.extend(events);
        let (size, started, waiting) = (self.size, self.started, &mut self.events);
        let input = || {
            let events = std::mem::take(waiting);
            let mut input = RawInput { events, time: Some(started.elapsed().as_secs_f64()), ..RawInput::default() };
            let viewport = ViewportInfo { native_pixels_per_point: Some(1.0), ..ViewportInfo::default() };
            input.viewports.insert(ViewportId::ROOT, viewport);
            let [width, height] = size.map(|side| side as f32);
            input.screen_rect = Some(egui::Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(width, height)));
            input
        };
        self.session.turn(input, size)
    }

    /// Frames until all that was asked for is read, built, drawn and shown. An error that it would show is one.
    pub fn settle(&mut self) -> Result<()> {
        loop {
            let has_asked = self.frame(Vec::new())?.platform.is_some();
            self.session.land(true)?;
            if let Some(failure) = self.viewer().failure.take() {
                return Err(failure);
            }
            if let Some(problem) = self.viewer().messages.shown().iter().find(|message| message.is_error) {
                bail!("{}", problem.text);
            }
            if has_asked && self.session.is_settled() {
                return Ok(());
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// What it shows: rows of red, green, blue and alpha.
    pub fn screen(&mut self) -> Result<Vec<[u8; 4]>> {
        Ok(self.session.screen.read(&mut self.session.pair)?.expect("there is no window"))
    }
}

/// Opens scenes and draws `frames` frames, each from the next camera of the file or, without one, from the first view.
pub fn run(setup: Setup, device: &Device, size: [u32; 2], frames: u32) -> Result<Summary> {
    let mut offscreen = Offscreen::new(setup, device, size)?;
    offscreen.settle()?;
    let first_frame_ms = offscreen.started.elapsed().as_secs_f64() * 1e3;
    let mut intervals = Vec::new();
    for frame in 0..frames {
        let begun = Instant::now();
        let viewer = offscreen.viewer();
        // The reference is of one view.
        if !viewer.cameras.is_empty() && viewer.comparison.with != With::Reference {
            viewer.go_to_camera(frame as usize % viewer.cameras.len(), true);
        }
        viewer.is_stale = true;
        offscreen.frame(vec![egui::Event::PointerMoved(egui::pos2(frame as f32 % 100.0, 50.0))])?;
        intervals.push(begun.elapsed().as_secs_f64() * 1e3);
    }
    offscreen.session.land(true)?;
    let screen = offscreen.screen()?;
    let viewer = offscreen.viewer();
    // The first ones fill the pipeline and warm the device up.
    let measured = intervals.split_off(intervals.len() / 4);
    Ok(Summary {
        interval_ms: Statistics::of(measured),
        gpu: viewer.history.digest_now(),
        first_frame_ms,
        latency_ms: viewer.pace.mean_latency_ms,
        screen,
    })
}
