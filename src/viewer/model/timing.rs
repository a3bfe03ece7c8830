//! Frame times, the pace of the window, and vertical synchronization.

use std::time::Instant;

use super::frame_times::{FrameTimes, Pace};
use super::rate::RateControl;
use crate::gpu::Vsync;
use crate::measure::bench::Clocks;

/// Times of frames, and the settings that affect them.
pub struct Timing {
    pub started: Instant,
    pub frame_times: FrameTimes,
    /// The clocks of the device after one of the last frames, where they are known. A device that has little to do
    /// lowers them, and frames then take longer.
    pub clocks: Option<Clocks>,
    pub pace: Pace,
    /// Set if frames keep a rate.
    pub rate: Option<RateControl>,
    /// The time of the first input that no frame has answered yet.
    pub input_at: Option<Instant>,
    /// The refresh interval of the screen in milliseconds.
    pub refresh_ms: f64,
    pub vsync: Vsync,
    /// Processor time of the last layout of the panels, in milliseconds.
    pub layout_ms: f64,
}

impl Timing {
    /// `fps`: frames a second to keep.
    pub fn new(fps: Option<f64>, vsync: Vsync) -> Self {
        Self {
            started: Instant::now(),
            frame_times: FrameTimes::default(),
            clocks: None,
            pace: Pace::default(),
            rate: fps.map(RateControl::new),
            input_at: None,
            refresh_ms: 1000.0 / 60.0,
            vsync,
            layout_ms: 0.0,
        }
    }

    /// Seconds since the start.
    pub fn seconds(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// The factor for the scale of pictures while the view moves.
    pub fn motion_scale(&self) -> f32 {
        self.rate.as_ref().map_or(1.0, |rate| rate.scale)
    }
}
