//! Scenes that are read page by page while the window goes on: what their pictures lack, and how many nodes they have.

use std::time::Duration;

use super::pictures::Drawn;
use super::screen::Second;
use super::session::Session;
use crate::gpu::Timing;
use crate::render::Residency;

/// The interval at which pages that are being read are looked for.
pub const POLL: Duration = Duration::from_millis(4);

/// The number of nodes of a picture, so that frames keep a rate.
pub struct Rate {
    /// GPU time of a frame at this rate, milliseconds.
    pub target_ms: f64,
    /// Most nodes of the next picture.
    pub splats: f64,
}

/// Nodes of the first picture, and the fewest of any.
const SPLATS: [f64; 2] = [1e6, 5e3];
/// The part of the time that a frame may take: the rest is for others and for what changes from frame to frame.
const TAKEN: f64 = 0.8;
/// The largest and the smallest factor by which the number of nodes changes from one picture to the next.
const CHANGES: [f64; 2] = [0.7, 1.05];

impl Rate {
    /// `fps`: frames a second.
    pub fn of(fps: f64) -> Self {
        Self { target_ms: TAKEN * 1e3 / fps, splats: SPLATS[0] }
    }

    /// Takes in the time of a picture that had this number of nodes, if it was limited by it.
    fn answer(&mut self, ms: f64) {
        let [least, most] = CHANGES;
        self.splats = (self.splats * (self.target_ms / ms).clamp(least, most)).clamp(SPLATS[1], f64::from(u32::MAX));
    }
}

impl Session {
    /// How far the pages of the pictures are there: of the one that lacks more.
    pub fn residency(&self) -> Option<Residency> {
        let second = self.pair.second.as_ref().and_then(Second::drawn);
        let both = self.pair.first.iter().chain(second).filter_map(Drawn::residency);
        both.max_by_key(|residency| (!residency.is_settled(), residency.missing))
    }

    /// The title of the window: the names of the scenes, and what their picture lacks.
    pub fn title(&self) -> String {
        let names: Vec<&str> = self.viewer.layers.iter().map(|layer| layer.name.as_str()).collect();
        let lacks = match self.residency() {
            Some(Residency { missing, coming: 0, .. }) if missing > 0 => {
                format!(" ({missing} pages of levels do not fit into memory)")
            }
            Some(Residency { missing, .. }) if missing > 0 => format!(" ({missing} pages of levels are missing yet)"),
            _ => String::new(),
        };
        if names.is_empty() { "smalto".to_owned() } else { format!("{}{lacks} - smalto", names.join(", ")) }
    }

    /// Looks for pages that were read since the last picture, or could not be read.
    pub(super) fn poll_pages(&mut self) {
        for (_, drawn) in self.pair.drawn() {
            self.viewer.is_stale |= drawn.renderer.has_news();
            if let Some(problem) = drawn.renderer.take_problem() {
                self.viewer.messages.error(format!("{problem:#}; coarser levels are shown there"));
                self.viewer.failure.get_or_insert(problem);
            }
        }
    }

    /// Sets the number of nodes of the next picture by the time that a frame took, if the frames keep a rate.
    pub(super) fn keep_rate(&mut self, timings: &[Timing]) {
        let Some(rate) = &mut self.viewer.rate else { return };
        let ms = timings.iter().filter(|timing| timing.depth == 0).map(|timing| timing.duration_ms).sum::<f64>();
        if ms > 0.0 {
            rate.answer(ms);
        }
        let splats = rate.splats as u32;
        for (_, drawn) in self.pair.drawn() {
            drawn.renderer.limit_splats(splats);
        }
    }
}
