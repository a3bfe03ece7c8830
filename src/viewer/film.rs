//! The path of a film: keyframes, and the time that is shown.

use crate::camera::Timeline;

/// A path that is recorded, edited and played.
pub struct Film {
    pub timeline: Timeline,
    /// The time that is shown, in seconds.
    pub now: f64,
    pub is_playing: bool,
    /// Seconds between the last key and a key that is added.
    pub step: f64,
    pub fps: f64,
    pub file: String,
}

impl Default for Film {
    fn default() -> Self {
        Self {
            timeline: Timeline::default(),
            now: 0.0,
            is_playing: false,
            step: 2.0,
            fps: 30.0,
            file: "path.json".to_owned(),
        }
    }
}

impl Film {
    /// The time of the last key, in seconds.
    pub fn end(&self) -> f64 {
        self.timeline.keys().last().map_or(0.0, |key| key.seconds)
    }

    /// Starts playing, from the beginning if the path is at its end, or stops. A single key cannot be played.
    pub fn toggle(&mut self) {
        self.is_playing = !self.is_playing && self.timeline.keys().len() > 1;
        if self.is_playing && self.now >= self.end() {
            self.now = 0.0;
        }
    }
}
