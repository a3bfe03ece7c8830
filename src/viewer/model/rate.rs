//! What pictures leave out, so that frames keep a rate.

use std::time::Instant;

/// What pictures leave out, so that frames keep a rate.
pub struct Rate {
    pub fps: f64,
    /// Most nodes of the next picture of levels of detail.
    pub splats: f64,
    /// The fraction of the width and height in which other scenes are drawn, as long as the view moves.
    pub scale: f32,
    /// When the view moved last.
    pub moved: Option<Instant>,
}

/// Nodes of the first picture, and the fewest of any.
const SPLATS: [f64; 2] = [1e6, 5e3];
/// The part of the time that a frame may take: the rest is for others and for what changes from frame to frame.
const TAKEN: f64 = 0.8;
/// The smallest and the largest factor by which the number of nodes changes from one picture to the next.
const CHANGES: [f64; 2] = [0.7, 1.05];
/// The scales of pictures in motion: each has about half the pixels of the one before.
const SCALES: [f32; 4] = [0.7, 0.5, 0.35, 0.25];

impl Rate {
    /// `fps`: frames a second.
    pub fn of(fps: f64) -> Self {
        Self { fps, splats: SPLATS[0], scale: 1.0, moved: None }
    }

    /// GPU time of a frame at this rate, milliseconds.
    fn target_ms(&self) -> f64 {
        TAKEN * 1e3 / self.fps
    }

    /// Takes in the time of a picture that had at most about this number of nodes, milliseconds.
    pub fn answer(&mut self, ms: f64) {
        let [smallest, largest] = CHANGES;
        self.splats =
            (self.splats * (self.target_ms() / ms).clamp(smallest, largest)).clamp(SPLATS[1], f64::from(u32::MAX));
    }

    /// Takes in the time of a picture in motion that had this scale, milliseconds. Returns true if the next ones have a
    /// lower one. A motion that goes on gets no higher one, so that pictures do not jump between two.
    pub fn follow(&mut self, ms: f64, scale: f32) -> bool {
        if scale != self.scale || ms <= self.target_ms() {
            return false;
        }
        let wanted = f64::from(scale) * (self.target_ms() / ms).sqrt();
        let fits = SCALES.into_iter().find(|scale| f64::from(*scale) <= wanted);
        let lower = fits.unwrap_or(SCALES[SCALES.len() - 1]).min(self.scale);
        std::mem::replace(&mut self.scale, lower) != lower
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_is_drawn_at_the_scale_that_keeps_the_rate() {
        let mut rate = Rate::of(80.0);
        assert!(!rate.follow(9.9, 1.0) && rate.scale == 1.0, "ten milliseconds are there");
        assert!(rate.follow(25.0, 1.0) && rate.scale == 0.5, "0.63 of the sides would do");
        assert!(!rate.follow(25.0, 1.0), "a picture of the scale before");
        assert!(!rate.follow(2.0, 0.5) && rate.scale == 0.5, "no higher one while it goes on");
        assert!(rate.follow(1000.0, 0.5) && rate.scale == 0.25);
        assert!(!rate.follow(1000.0, 0.25), "there is no lower one");
    }
}
