//! Undo and redo: what users set or move, as it was before each change.

use super::layers::Place;
use crate::camera::{Camera, Timeline};
use crate::options::Options;
use crate::rules::Background;

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
    pub view: Camera,
    pub options: Options,
    pub background: Background,
    pub timeline: Timeline,
    /// By number of the scene: where it lies, and in which pictures it is shown.
    pub places: Vec<(u64, Place, [bool; 2])>,
}

impl State {
    /// What differs, as a noun; `None` if nothing does. Views of windows of other sizes are not compared: a window that
    /// is resized changes them.
    pub fn difference(&self, other: &Self) -> Option<&'static str> {
        let Self { view, options, background, timeline, places } = self;
        let are_open = places.iter().map(|(number, ..)| number).eq(other.places.iter().map(|(number, ..)| number));
        match () {
            () if are_open && *places != other.places => Some("the placement of scenes"),
            () if *timeline != other.timeline => Some("the path"),
            () if *options != other.options => Some("the options"),
            () if background.colour() != other.background.colour() => Some("the background"),
            () if view.size_px == other.view.size_px && *view != other.view => Some("the view"),
            () => None,
        }
    }
}
