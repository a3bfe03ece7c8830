//! Actions that undo changes, and make them again.

use crate::viewer::model::{State, Undo, Viewer};

/// Most steps that can be undone.
const STEPS: usize = 1000;

impl Viewer {
    fn state(&self) -> State {
        State {
            view: self.navigator.own_camera().clone(),
            options: self.options,
            background: self.background,
            timeline: self.film.timeline.clone(),
            places: self.layers.iter().map(|layer| (layer.number, layer.place, layer.is_shown)).collect(),
            edits: self.layers.iter().map(|layer| (layer.number, layer.edit.clone())).collect(),
        }
    }

    /// Takes what is set now as the beginning: what a scene or a camera file brings is no change of the user's.
    pub fn begin_undo(&mut self) {
        self.undo.current = None;
    }

    /// Notes what has changed. Call it where no change goes on: each drag and each glide is one step.
    pub fn note_changes(&mut self) {
        let now = self.state();
        if let Some(before) = self.undo.current.take().filter(|before| before.difference(&now).is_some()) {
            self.undo.done.push(before);
            self.undo.undone.clear();
            self.undo.limit(STEPS);
        }
        self.undo.current = Some(now);
    }

    /// Takes back the last change, or makes the last one that was taken back again.
    pub fn undo(&mut self, forward: bool) {
        self.note_changes();
        let now = self.state();
        let Undo { undone, done, .. } = &mut self.undo;
        let (from, to) = if forward { (undone, done) } else { (done, undone) };
        let Some(wanted) = from.pop() else {
            let what = if forward { "there is nothing to redo" } else { "there is nothing to undo" };
            return self.messages.note(what);
        };
        let what = now.difference(&wanted).unwrap_or("the view");
        to.push(now);
        self.restore(&wanted);
        self.undo.current = Some(self.state());
        self.messages.note(format!("{}: {what}", if forward { "redone" } else { "undone" }));
    }

    fn restore(&mut self, wanted: &State) {
        let State { view, options, background, timeline, places, edits } = wanted;
        if self.navigator.own_camera() != view {
            self.navigator.snap(view);
            self.camera = None;
        }
        (self.options, self.background, self.film.timeline) = (*options, *background, timeline.clone());
        self.film.is_playing = false;
        for layer in &mut self.layers {
            if let Some((_, place, is_shown)) = places.iter().find(|(number, ..)| *number == layer.number) {
                (layer.place, layer.is_shown) = (*place, *is_shown);
            }
        }
        for place in 0..self.layers.len() {
            let number = self.layers[place].number;
            if let Some((_, edit)) = edits.iter().find(|(of, _)| *of == number) {
                self.set_edit(place, edit.clone());
            }
        }
        self.is_stale = true;
        self.comparison.is_stale = true;
    }
}
