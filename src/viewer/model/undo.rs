//! Undo and redo: the settings and placements before and after each change.

use std::path::PathBuf;
use std::sync::Arc;

use super::appearance::Appearance;
use super::edit::{Edit, Edits};
use super::layers::Placement;
use super::measures::Measures;
use crate::camera::{Camera, Timeline};
use crate::options::{KNOBS, Options};
use crate::rules::Background;
use crate::scene::SceneInstances;

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

/// The part of a layer's state that can be undone, besides its edit.
#[derive(Clone, PartialEq)]
pub struct LayerState {
    pub number: u64,
    pub placement: Placement,
    pub places: Option<(PathBuf, SceneInstances)>,
    pub appearance: Appearance,
    /// The pictures that include the layer.
    pub is_shown: [bool; 2],
}

/// The part of the viewer's state that can be undone.
#[derive(Clone)]
pub struct UndoState {
    /// The camera of the navigator, which does not depend on the size of the window.
    pub view: Camera,
    pub options: Options,
    pub background: Background,
    pub timeline: Timeline,
    pub layers: Vec<LayerState>,
    /// Numbers of layers that were separated from others.
    pub parts: Vec<u64>,
    /// Layer number and edit.
    pub edits: Edits,
    pub measures: Measures,
}

impl UndoState {
    /// Names the first difference of the state that comes from this one; `None` if they are equal. `name` is the name
    /// of a layer.
    pub fn difference(&self, next: &Self, name: impl Fn(u64) -> String) -> Option<String> {
        let Self { view, options, background, timeline, layers, parts, edits, measures } = self;
        let are_open = layers.iter().map(|layer| layer.number).eq(next.layers.iter().map(|layer| layer.number));
        let changed = layers.iter().zip(&next.layers).find(|(one, other)| one != other);
        let are_edited = edits.iter().zip(&next.edits).any(|(one, other)| match (&one.1, &other.1) {
            (Some(one), Some(other)) => !Arc::ptr_eq(one, other),
            (one, other) => one.is_some() != other.is_some(),
        });
        let turned = KNOBS.iter().filter(|knob| (knob.get)(options) != (knob.get)(&next.options));
        let turned: Vec<&str> = turned.map(|knob| knob.name).collect();
        match (changed, &turned[..]) {
            _ if next.parts.iter().any(|part| !parts.contains(part)) => Some("the separated scene".to_owned()),
            (Some((before, after)), _) if are_open => {
                let what = match () {
                    () if before.placement != after.placement => "the placement",
                    () if before.places != after.places => "the list of places",
                    () if before.appearance != after.appearance => "the colours and the opacity",
                    () => "whether it is shown",
                };
                Some(format!("{what}: {}", name(before.number)))
            }
            _ if are_open && are_edited => Some(self.edited(next)),
            _ if *timeline != next.timeline => {
                Some(format!("the path: {} keys, from {}", next.timeline.keys().len(), timeline.keys().len()))
            }
            _ if *measures != next.measures => Some("the measures".to_owned()),
            (_, [knob]) => Some(format!("the option {knob}")),
            (_, [_, _, ..]) => Some(format!("the options {}", turned.join(", "))),
            _ if *options != next.options => Some("the options".to_owned()),
            _ if background.colour() != next.background.colour() => Some("the background".to_owned()),
            _ if *view != next.view => Some("the view".to_owned()),
            _ => None,
        }
    }

    /// The numbers of Gaussians that the edits of the next state change.
    fn edited(&self, next: &Self) -> String {
        let [before, after] = [self, next].map(|state| {
            let counts = state.edits.iter().filter_map(|(_, edit)| edit.as_ref()).map(|edit| edit.counts());
            counts.fold([0; 3], |sum, one| {
                let one = [one.selected, one.hidden, one.deleted];
                std::array::from_fn(|i| sum[i] + one[i])
            })
        });
        let count = |number: usize| indicatif::HumanCount(number as u64);
        let changed = ["selected", "hidden", "deleted"].into_iter().zip(before.into_iter().zip(after));
        let changed = changed.filter(|(_, (before, after))| before != after);
        let text: Vec<String> = changed
            .map(|(name, (before, after))| format!("{name} Gaussians ({} to {})", count(before), count(after)))
            .collect();
        match text.is_empty() {
            true => "other Gaussians selected, hidden or deleted".to_owned(),
            false => text.join("; "),
        }
    }
}
