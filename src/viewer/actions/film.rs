//! Actions on the path of a film: adding keys, showing a time, playing.

use crate::viewer::state::Viewer;

impl Viewer {
    /// Adds the view as a key after the last one.
    pub fn add_key(&mut self) {
        let film = &self.film;
        let seconds = if film.timeline.keys().is_empty() { 0.0 } else { film.end() + film.step };
        let camera = self.view();
        match self.film.timeline.insert(seconds, camera) {
            Ok(_) => self.messages.note(format!("key at {seconds:.1} s")),
            Err(problem) => self.messages.error(format!("{problem:#}")),
        }
    }

    /// Goes to the view of the path at this time.
    pub fn show_time(&mut self, seconds: f64) {
        self.film.now = seconds;
        if let Some(camera) = self.film.timeline.at(seconds) {
            self.navigator.snap(&camera);
            self.camera = None;
            self.is_stale = true;
        }
    }

    /// Advances the path by `seconds` if it is playing.
    pub fn play(&mut self, seconds: f64) {
        if self.film.is_playing {
            let end = self.film.end();
            self.film.is_playing = self.film.now + seconds < end;
            self.show_time((self.film.now + seconds).min(end));
        }
    }
}
