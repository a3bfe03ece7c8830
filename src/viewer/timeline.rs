//! The path of a film: keyframes, and the time that is shown of it.

use super::state::Viewer;
use crate::camera::Timeline;

/// A path that is recorded, edited and played.
pub struct Film {
    pub timeline: Timeline,
    /// The time that is shown, in seconds.
    pub now: f64,
    pub is_playing: bool,
    /// Seconds between a view that is added and the one before.
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
    /// The time of the last key.
    pub fn end(&self) -> f64 {
        self.timeline.keys().last().map_or(0.0, |key| key.seconds)
    }

    /// Plays, from the start if it is at its end, or stops. One key is no path.
    pub fn toggle(&mut self) {
        self.is_playing = !self.is_playing && self.timeline.keys().len() > 1;
        if self.is_playing && self.now >= self.end() {
            self.now = 0.0;
        }
    }
}

impl Viewer {
    /// Adds the view behind the last key.
    pub fn add_key(&mut self) {
        let film = &self.film;
        let seconds = if film.timeline.keys().is_empty() { 0.0 } else { film.end() + film.step };
        let camera = self.view();
        match self.film.timeline.insert(seconds, camera) {
            Ok(_) => self.messages.note(format!("key at {seconds:.1} s")),
            Err(problem) => self.messages.error(format!("{problem:#}")),
        }
    }

    /// Shows the path at a time.
    pub fn show_time(&mut self, seconds: f64) {
        self.film.now = seconds;
        if let Some(camera) = self.film.timeline.at(seconds) {
            self.navigator.snap(&camera);
            self.camera = None;
            self.is_stale = true;
        }
    }

    /// Lets time pass while the path is played.
    pub fn play(&mut self, seconds: f64) {
        if self.film.is_playing {
            let end = self.film.end();
            self.film.is_playing = self.film.now + seconds < end;
            self.show_time((self.film.now + seconds).min(end));
        }
    }
}
