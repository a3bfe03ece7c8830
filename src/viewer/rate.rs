//! The number of nodes of pictures by levels of detail, so that frames keep a rate.

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
/// The smallest and the largest factor by which the number of nodes changes from one picture to the next.
const CHANGES: [f64; 2] = [0.7, 1.05];

impl Rate {
    /// `fps`: frames a second.
    pub fn of(fps: f64) -> Self {
        Self { target_ms: TAKEN * 1e3 / fps, splats: SPLATS[0] }
    }

    /// Takes in the time of a picture that had at most about this number of nodes, milliseconds.
    pub fn answer(&mut self, ms: f64) {
        let [smallest, largest] = CHANGES;
        self.splats =
            (self.splats * (self.target_ms / ms).clamp(smallest, largest)).clamp(SPLATS[1], f64::from(u32::MAX));
    }
}
