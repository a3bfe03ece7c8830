//! Actions on the camera path: its keys, going to a time, playing.

use std::f64::consts::TAU;

use anyhow::Result;
use glam::DQuat;

use crate::camera::{Camera, Timeline};
use crate::viewer::model::{KeyChange, Viewer};

/// Keys of a turn around the pivot. The path between them differs from a circle by less than 5e-4 of its radius.
const TURN_KEYS: u32 = 16;

impl Viewer {
    /// Adds the view as a key after the last one.
    pub fn add_key(&mut self) {
        let film = &self.film;
        let seconds = if film.timeline.keys().is_empty() { 0.0 } else { film.end() + film.step };
        self.insert_key(seconds);
    }

    /// Inserts the view as a key at this time, or replaces the key at this time.
    pub fn insert_key(&mut self, seconds: f64) {
        let camera = self.view.camera();
        let inserted = self.film.timeline.insert(seconds, camera);
        self.report(inserted.map(|_| format!("key at {seconds:.1} s")));
    }

    /// Adds the first view as the last key, so that the path can repeat.
    ///
    /// # Errors
    /// The path has less than two keys, or ends at its first view already.
    pub fn close_path(&mut self) -> Result<(), &'static str> {
        let first = match self.film.timeline.keys() {
            [first, _, ..] if !self.film.timeline.is_closed() => first.camera.clone(),
            _ => return Err("only a path of several views that does not end at the first one can be closed"),
        };
        let seconds = self.film.end() + self.film.step;
        let inserted = self.film.timeline.insert(seconds, first);
        self.film.repeats = true;
        self.report(inserted.map(|_| format!("the path ends at its first view, at {seconds:.1} s")));
        Ok(())
    }

    /// Replaces the path by a full turn around the pivot, starting and ending at this view.
    pub fn turn_path(&mut self) {
        let (view, pivot, up) = (self.view.camera(), self.view.navigator.pivot(), self.view.navigator.up().vector());
        let turned = |step: u32| {
            // The last key is the first one, bit for bit.
            let angle = f64::from(step % TURN_KEYS) / f64::from(TURN_KEYS) * TAU;
            if angle == 0.0 {
                return view.clone();
            }
            let turn = DQuat::from_axis_angle(up, angle);
            Camera {
                position: pivot + turn * (view.position - pivot),
                rotation: view.rotation * glam::DMat3::from_quat(turn.inverse()),
                ..view.clone()
            }
        };
        let mut timeline = Timeline::default();
        for step in 0..=TURN_KEYS {
            if let Err(problem) = timeline.insert(f64::from(step) * self.film.step, turned(step)) {
                return self.messages.error(format!("{problem:#}"));
            }
        }
        let had = !self.film.timeline.keys().is_empty();
        (self.film.timeline, self.film.repeats, self.film.now) = (timeline, true, 0.0);
        self.messages.note(match had {
            true => "a turn around the pivot in place of the path: undo brings that back",
            false => "a turn around the pivot",
        });
    }

    /// Changes a key, or goes to its view.
    pub fn change_key(&mut self, change: KeyChange) {
        match change {
            KeyChange::Show(seconds) => self.show_time(seconds),
            KeyChange::Replace(seconds) => self.insert_key(seconds),
            KeyChange::Move(index, seconds) => {
                if let Err(problem) = self.film.timeline.retime(index, seconds) {
                    self.messages.note(format!("{problem:#}"));
                }
            }
            KeyChange::Rest(index, rests) => self.film.timeline.set_rest(index, rests),
            KeyChange::Remove(index) => drop(self.film.timeline.remove(index)),
        }
    }

    fn report(&mut self, done: Result<String>) {
        match done {
            Ok(text) => self.messages.note(text),
            Err(problem) => self.messages.error(format!("{problem:#}")),
        }
    }

    /// Goes to the view of the path at a time.
    pub fn show_time(&mut self, seconds: f64) {
        self.film.now = seconds;
        if let Some(camera) = self.film.timeline.at(seconds) {
            self.view.snap(&camera);
            self.pictures.are_stale = true;
        }
    }

    /// Advances the path by `seconds` if it is playing.
    pub fn play(&mut self, seconds: f64) {
        if self.film.is_playing {
            let (now, goes_on) = self.film.after(seconds);
            self.film.is_playing = goes_on;
            self.show_time(now);
        }
    }
}
