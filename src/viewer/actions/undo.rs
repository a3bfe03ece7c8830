//! Undo and redo.

use crate::viewer::model::{Layer, LayerState, Measures, Undo, UndoState, Viewer};

/// Most steps that can be undone.
const STEPS: usize = 1000;

impl Viewer {
    fn state(&self) -> UndoState {
        let layer = |layer: &Layer| {
            let Layer { number, placement, appearance, is_shown, .. } = *layer;
            LayerState { number, placement, places: layer.places.clone(), appearance, is_shown }
        };
        UndoState {
            view: self.view.navigator.own_camera().clone(),
            options: self.options,
            background: self.view.background,
            timeline: self.film.timeline.clone(),
            layers: self.scenes.layers.iter().map(layer).collect(),
            parts: self.scenes.layers.iter().filter(|layer| layer.part.is_some()).map(|layer| layer.number).collect(),
            edits: self.scenes.edits(),
            measures: self.measures.clone(),
        }
    }

    /// Makes the current state the beginning: changes by a scene or a camera file are no undo step.
    pub fn reset_undo(&mut self) {
        self.editing.undo.current = None;
    }

    /// Records an undo step if the state has changed. Call it when no drag or glide is under way, so that each is one
    /// step.
    pub fn record_undo_step(&mut self) {
        let now = self.state();
        if let Some(before) =
            self.editing.undo.current.take().filter(|before| before.difference(&now, |_| String::new()).is_some())
        {
            self.editing.undo.done.push(before);
            self.editing.undo.undone.clear();
            self.editing.undo.limit(STEPS);
        }
        self.editing.undo.current = Some(now);
    }

    /// Ends the undo step before another change, unless the view moves: a motion is one step.
    pub fn end_undo_step(&mut self) {
        if !self.is_moving() {
            self.record_undo_step();
        }
    }

    /// Undoes the last step or, with `forward`, redoes it.
    pub fn undo(&mut self, forward: bool) {
        self.record_undo_step();
        let now = self.state();
        let Undo { undone, done, .. } = &mut self.editing.undo;
        let (from, to) = if forward { (undone, done) } else { (done, undone) };
        let Some(wanted) = from.pop() else {
            let what = if forward { "there is nothing to redo" } else { "there is nothing to undo" };
            return self.messages.note(what);
        };
        let name = |number| self.scenes.layer(number).map_or_else(String::new, |layer| layer.name.clone());
        let is_separated = now.parts.iter().any(|part| !wanted.parts.contains(part));
        let what = match is_separated {
            true => "the separated scene".to_owned(),
            false => now.difference(&wanted, name).unwrap_or_else(|| "the view".to_owned()),
        };
        to.push(now);
        self.restore(&wanted);
        self.editing.undo.current = Some(self.state());
        self.messages.note(format!("{}: {what}", if forward { "redone" } else { "undone" }));
    }

    fn restore(&mut self, wanted: &UndoState) {
        let UndoState { view, options, background, timeline, layers, parts: _, edits, measures } = wanted;
        if self.view.navigator.own_camera() != view {
            self.view.snap(view);
        }
        (self.options, self.view.background, self.film.timeline) = (*options, *background, timeline.clone());
        self.film.is_playing = false;
        let open = |measures: &Measures, index: Option<usize>| {
            let measure = measures.all.get(index?)?;
            Some((measure.kind, measure.points.first().copied()))
        };
        // The open measure may be another one now.
        let index = self.ruler.open;
        self.ruler.open.take_if(|_| open(&self.measures, index) != open(measures, index));
        self.measures.clone_from(measures);
        for layer in &mut self.scenes.layers {
            match layers.iter().find(|state| state.number == layer.number) {
                Some(state) => {
                    (layer.placement, layer.appearance, layer.is_shown) =
                        (state.placement, state.appearance, state.is_shown);
                    layer.places.clone_from(&state.places);
                }
                // It was separated later; redo shows it again.
                None if layer.part.is_some() => layer.is_shown = [false; 2],
                None => {}
            }
        }
        for index in 0..self.scenes.layers.len() {
            let number = self.scenes.layers[index].number;
            if let Some((_, edit)) = edits.iter().find(|(of, _)| *of == number) {
                self.set_edit(index, edit.clone());
            }
        }
        self.pictures.are_stale = true;
        self.comparison.is_stale = true;
    }
}
