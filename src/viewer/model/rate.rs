//! Control of the frame rate by the number of nodes or the scale of pictures.

use std::time::Instant;

/// Keeps a frame rate: limits the nodes of levels of detail, and the scale of other pictures during motion.
pub struct RateControl {
    /// Frames a second to keep.
    pub fps: f64,
    /// Most nodes of the next picture of levels of detail.
    pub splats: f64,
    /// Factor for the width and height of pictures of other scenes while the view moves.
    pub scale: f32,
    /// Time of the last motion of the view.
    pub last_motion: Option<Instant>,
}

/// Nodes of the first picture, and the least number of nodes.
const SPLATS: [f64; 2] = [1e6, 5e3];
/// Fraction of the frame interval that GPU work may take. The rest absorbs variation between frames, and other work.
const LOAD: f64 = 0.8;
/// The smallest and the largest factor by which the number of nodes changes from one picture to the next.
const CHANGES: [f64; 2] = [0.7, 1.05];
/// Scales of pictures in motion. Each step halves the number of pixels, about.
const SCALES: [f32; 4] = [0.7, 0.5, 0.35, 0.25];

impl RateControl {
    /// `fps`: frames a second.
    pub fn new(fps: f64) -> Self {
        Self { fps, splats: SPLATS[0], scale: 1.0, last_motion: None }
    }

    /// GPU time of a frame at this rate, milliseconds.
    fn target_ms(&self) -> f64 {
        LOAD * 1e3 / self.fps
    }

    /// Adapts the limit of nodes to the GPU time of the last picture, in milliseconds.
    pub fn adjust_splats(&mut self, ms: f64) {
        let [smallest, largest] = CHANGES;
        self.splats =
            (self.splats * (self.target_ms() / ms).clamp(smallest, largest)).clamp(SPLATS[1], f64::from(u32::MAX));
    }

    /// Adapts the scale to the GPU time of a picture in motion that had this scale, in milliseconds. Returns true if
    /// the scale has decreased. It never increases during a motion, so that pictures do not alternate between two
    /// scales.
    pub fn adjust_scale(&mut self, ms: f64, scale: f32) -> bool {
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
        let mut rate = RateControl::new(80.0);
        assert!(!rate.adjust_scale(9.9, 1.0) && rate.scale == 1.0, "10 ms are allowed");
        assert!(rate.adjust_scale(25.0, 1.0) && rate.scale == 0.5, "0.63 of the sides would do");
        assert!(!rate.adjust_scale(25.0, 1.0), "a picture of the scale before");
        assert!(!rate.adjust_scale(2.0, 0.5) && rate.scale == 0.5, "the scale does not increase during a motion");
        assert!(rate.adjust_scale(1000.0, 0.5) && rate.scale == 0.25);
        assert!(!rate.adjust_scale(1000.0, 0.25), "this is the lowest scale");
    }
}
