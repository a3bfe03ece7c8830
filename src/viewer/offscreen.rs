//! The viewer without a window: the same frames with the same panels into an image, as fast as they come.

use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use egui::{RawInput, ViewportId, ViewportInfo};

use super::jobs::Jobs;
use super::screen::Screen;
use super::session::Session;
use super::state::{Setup, Viewer};
use crate::bench::Statistics;
use crate::gpu::Device;

/// How frames without a window went.
pub struct Summary {
    /// Milliseconds from one frame to the next.
    pub interval_ms: Statistics,
    /// GPU time of the pictures in milliseconds.
    pub gpu_ms: Option<Statistics>,
    pub first_frame_ms: f64,
    /// Milliseconds from an input to the submission of the picture that answers it, on average.
    pub latency_ms: f64,
    /// The last frame: size, and rows of red, green, blue and alpha.
    pub size: [u32; 2],
    pub screen: Vec<[u8; 4]>,
}

/// Opens scenes and draws `frames` frames, each from the next camera of the file or, without one, from the first view.
pub fn run(setup: Setup, device: &Device, size: [u32; 2], frames: u32, with_panels: bool) -> Result<Summary> {
    let screen = Screen::offscreen(device, size)?;
    let mut viewer = Viewer::new(setup, Jobs::new(Arc::new(|| {})), size);
    viewer.panels.are_hidden = !with_panels;
    let mut session = Session::new(viewer, screen, egui::Context::default());
    let started = Instant::now();
    let input = |started: Instant| {
        let mut input = RawInput { time: Some(started.elapsed().as_secs_f64()), ..RawInput::default() };
        let viewport = ViewportInfo { native_pixels_per_point: Some(1.0), ..ViewportInfo::default() };
        input.viewports.insert(ViewportId::ROOT, viewport);
        let [width, height] = size.map(|side| side as f32);
        input.screen_rect = Some(egui::Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(width, height)));
        input
    };
    while !session.is_settled() {
        session.turn(input(started), size)?;
        if let Some(problem) = session.viewer.messages.shown().iter().find(|message| message.is_error) {
            bail!("{}", problem.text);
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    let first_frame_ms = started.elapsed().as_secs_f64() * 1e3;
    let mut intervals = Vec::new();
    for frame in 0..frames {
        let begun = Instant::now();
        let cameras = session.viewer.cameras.len();
        if cameras > 0 {
            session.viewer.go_to_camera(frame as usize % cameras, true);
        }
        session.viewer.is_stale = true;
        session.make_room()?;
        let mut input = input(started);
        input.events.push(egui::Event::PointerMoved(egui::pos2(frame as f32 % 100.0, 50.0)));
        session.turn(input, size)?;
        intervals.push(begun.elapsed().as_secs_f64() * 1e3);
    }
    session.land(true)?;
    let screen = session.screen.read(&mut session.pair)?.unwrap_or_default();
    let gpu_ms = session.viewer.history.whole();
    // The first ones fill the pipeline and warm the device up.
    let measured = intervals.split_off(intervals.len() / 4);
    let latency_ms = session.viewer.pace.mean_latency_ms;
    Ok(Summary { interval_ms: Statistics::of(measured), gpu_ms, first_frame_ms, latency_ms, size, screen })
}
