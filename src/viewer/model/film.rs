//! The camera path of a film: keys, and the current time.

use crate::camera::Timeline;

/// A path that is recorded, edited and played.
pub struct Film {
    pub timeline: Timeline,
    /// The current time in seconds.
    pub now: f64,
    pub is_playing: bool,
    /// Playing begins again at the end.
    pub repeats: bool,
    /// Seconds between the last key and a key that is added.
    pub step: f64,
    pub fps: f64,
    pub file: String,
    /// Seconds that the timeline shows.
    pub shown_seconds: f64,
}

/// A change of a key, by its index or its time.
#[derive(Clone, Copy)]
pub enum KeyChange {
    /// Go to its view.
    Show(f64),
    /// Replace it by the view that is shown.
    Replace(f64),
    /// Move it to this time.
    Move(usize, f64),
    Rest(usize, bool),
    Remove(usize),
}

impl Default for Film {
    fn default() -> Self {
        Self {
            timeline: Timeline::default(),
            now: 0.0,
            is_playing: false,
            repeats: false,
            step: 2.0,
            fps: 30.0,
            file: "path.json".to_owned(),
            shown_seconds: 1.0,
        }
    }
}

/// Least seconds between keys that are moved.
const KEY_GAP: f64 = 0.05;

impl Film {
    /// The least and the greatest time that a key can be moved to, of which the last key has none: keys keep their
    /// order, so that a dragged key replaces no other and stays under the pointer.
    pub fn room_of(&self, index: usize) -> (f64, Option<f64>) {
        let seconds = |index: usize| self.timeline.keys().get(index).map(|key| key.seconds);
        let low = index.checked_sub(1).and_then(seconds).map_or(0.0, |before| before + KEY_GAP);
        (low, seconds(index + 1).map(|next| (next - KEY_GAP).max(low)))
    }

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

    /// The time after `seconds` of playing, and true if playing continues.
    pub fn after(&self, seconds: f64) -> (f64, bool) {
        let (now, end) = (self.now + seconds, self.end());
        match now < end {
            true => (now, true),
            false if self.repeats && end > 0.0 => (now % end, true),
            false => (end, false),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;

    #[test]
    fn a_path_ends_or_begins_again() {
        let mut film = Film::default();
        assert_eq!(film.after(1.0), (0.0, false));
        let camera = Camera::framing(glam::DVec3::ZERO, 1.0, [8, 8]);
        film.timeline.insert(4.0, camera).unwrap();
        film.now = 3.0;
        assert_eq!((film.after(0.5), film.after(1.5)), ((3.5, true), (4.0, false)));
        film.repeats = true;
        assert_eq!((film.after(0.5), film.after(9.5)), ((3.5, true), (0.5, true)));
    }
}
