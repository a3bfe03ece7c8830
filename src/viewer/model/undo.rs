//! Undo and redo: what users set or move, as it was before each change.

use std::sync::Arc;

use super::edit::Edit;
use super::layers::Place;
use crate::camera::{Camera, Timeline};
use crate::options::Options;
use crate::rules::Background;

/// Most bytes of edits that are kept to be undone.
const MOST_BYTES: usize = 256 << 20;

impl Undo {
    /// Forgets what was done to the Gaussians of a scene, which are others now.
    pub fn forget_edits(&mut self, number: u64) {
        for state in self.done.iter_mut().chain(&mut self.undone).chain(&mut self.current) {
            state.edits.iter_mut().filter(|(of, _)| *of == number).for_each(|(_, edit)| *edit = None);
        }
    }

    /// Drops the oldest states until at most `steps` are left, whose edits do not need too much memory. States share
    /// an edit that did not change between them.
    pub fn limit(&mut self, steps: usize) {
        let mut left = MOST_BYTES;
        let mut later: &[(u64, Option<Arc<Edit>>)] = &[];
        let mut kept = 0;
        for state in self.done.iter().rev().take(steps) {
            let is_later =
                |edit: &Arc<Edit>| later.iter().any(|(_, of)| of.as_ref().is_some_and(|of| Arc::ptr_eq(of, edit)));
            let own = state.edits.iter().filter_map(|(_, edit)| edit.as_ref()).filter(|edit| !is_later(edit));
            let needed: usize = own.map(|edit| edit.gaussians()).sum();
            if needed > left && kept > 0 {
                break;
            }
            left = left.saturating_sub(needed);
            later = &state.edits;
            kept += 1;
        }
        self.done.drain(..self.done.len() - kept);
    }
}

/// The states before and after the current one.
#[derive(Default)]
pub struct Undo {
    pub current: Option<State>,
    pub undone: Vec<State>,
    pub done: Vec<State>,
}

/// What can be undone.
#[derive(Clone)]
pub struct State {
    /// The camera of the navigator: the size of the window does not change it.
    pub view: Camera,
    pub options: Options,
    pub background: Background,
    pub timeline: Timeline,
    /// By number of the scene: where it lies, and in which pictures it is shown.
    pub places: Vec<(u64, Place, [bool; 2])>,
    /// By number of the scene: what is done to its Gaussians.
    pub edits: Vec<(u64, Option<Arc<Edit>>)>,
}

impl State {
    /// What differs, as a noun; `None` if nothing does.
    pub fn difference(&self, other: &Self) -> Option<&'static str> {
        let Self { view, options, background, timeline, places, edits } = self;
        let are_edited = edits.iter().zip(&other.edits).any(|(one, other)| match (&one.1, &other.1) {
            (Some(one), Some(other)) => !Arc::ptr_eq(one, other),
            (one, other) => one.is_some() != other.is_some(),
        });
        let are_open = places.iter().map(|(number, ..)| number).eq(other.places.iter().map(|(number, ..)| number));
        match () {
            () if are_open && *places != other.places => Some("the placement of scenes"),
            () if are_open && are_edited => Some("the selection, or what is hidden or deleted"),
            () if *timeline != other.timeline => Some("the path"),
            () if *options != other.options => Some("the options"),
            () if background.colour() != other.background.colour() => Some("the background"),
            () if *view != other.view => Some("the view"),
            () => None,
        }
    }
}
