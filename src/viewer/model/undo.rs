//! Undo and redo: the settings and placements before and after each change.

use std::sync::Arc;

use super::edit::Edit;
use super::layers::Placement;
use crate::camera::{Camera, Timeline};
use crate::options::Options;
use crate::rules::Background;

/// Most bytes of edits in the undo states.
const MAX_BYTES: usize = 256 << 20;

impl Undo {
    /// Forgets the edits of a layer: it was read again and has other Gaussians now.
    pub fn forget_edits(&mut self, number: u64) {
        for state in self.done.iter_mut().chain(&mut self.undone).chain(&mut self.current) {
            state.edits.iter_mut().filter(|(of, _)| *of == number).for_each(|(_, edit)| *edit = None);
        }
    }

    /// Drops the oldest states until at most `steps` are left and their edits fit into [`MAX_BYTES`]. States share the
    /// sets that did not change between them.
    pub fn limit(&mut self, steps: usize) {
        let mut left = MAX_BYTES;
        let mut later: &[(u64, Option<Arc<Edit>>)] = &[];
        let mut kept = 0;
        for state in self.done.iter().rev().take(steps) {
            let needed: usize = state
                .edits
                .iter()
                .filter_map(|(number, edit)| {
                    let beside = later.iter().find(|(of, _)| of == number).and_then(|(_, edit)| edit.as_deref());
                    Some(edit.as_ref()?.bytes_beside(beside))
                })
                .sum();
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
    pub current: Option<UndoState>,
    pub undone: Vec<UndoState>,
    pub done: Vec<UndoState>,
}

/// The part of the viewer's state that can be undone.
#[derive(Clone)]
pub struct UndoState {
    /// The camera of the navigator, which does not depend on the size of the window.
    pub view: Camera,
    pub options: Options,
    pub background: Background,
    pub timeline: Timeline,
    /// Layer number, placement, and the pictures that include the layer.
    pub placements: Vec<(u64, Placement, [bool; 2])>,
    /// Layer number and edit.
    pub edits: Vec<(u64, Option<Arc<Edit>>)>,
}

impl UndoState {
    /// Names the first difference; `None` if the states are equal.
    pub fn difference(&self, other: &Self) -> Option<&'static str> {
        let Self { view, options, background, timeline, placements, edits } = self;
        let are_edited = edits.iter().zip(&other.edits).any(|(one, other)| match (&one.1, &other.1) {
            (Some(one), Some(other)) => !Arc::ptr_eq(one, other),
            (one, other) => one.is_some() != other.is_some(),
        });
        let are_open =
            placements.iter().map(|(number, ..)| number).eq(other.placements.iter().map(|(number, ..)| number));
        match () {
            () if are_open && *placements != other.placements => Some("the placement of scenes"),
            () if are_open && are_edited => Some("the selection, or what is hidden or deleted"),
            () if *timeline != other.timeline => Some("the path"),
            () if *options != other.options => Some("the options"),
            () if background.colour() != other.background.colour() => Some("the background"),
            () if *view != other.view => Some("the view"),
            () => None,
        }
    }
}
