//! The open scenes of a viewer, and the project that is being opened.

use super::edit::{Counts, Edit, Edits};
use super::layers::Layer;
use super::loaded_scene::LoadedScene;
use super::project::Project;
use crate::scene::Focus;

/// The open scenes.
#[derive(Default)]
pub struct Scenes {
    pub layers: Vec<Layer>,
    /// The project whose scenes and cameras are still being read.
    pub project: Option<Project>,
    /// Number of the layer that was added last.
    last_number: u64,
}

impl Scenes {
    /// True while a scene is being read.
    pub fn are_loading(&self) -> bool {
        self.layers.iter().any(|layer| layer.progress.is_some())
    }

    /// True if a scene has levels of detail, which are read page by page.
    pub fn have_levels(&self) -> bool {
        self.layers.iter().any(|layer| matches!(layer.scene, Some(LoadedScene::Paged(_))))
    }

    /// True if scenes are drawn in pages: one has levels of detail, or is drawn at places of a list.
    pub fn are_paged(&self) -> bool {
        self.have_levels() || self.shown().any(|layer| layer.places.is_some())
    }

    /// A number that no layer of this viewer has had.
    pub fn next_number(&mut self) -> u64 {
        self.last_number += 1;
        self.last_number
    }

    /// Opens the scenes of another viewer in addition, without reading them again.
    pub fn share(&mut self, other: &Self) {
        for layer in &other.layers {
            let number = self.next_number();
            self.layers.push(layer.shared(number));
        }
    }

    /// Takes the scenes that another viewer has read again from the same sources. True if there are any.
    pub fn follow(&mut self, other: &Self) -> bool {
        let mut has_changed = false;
        for layer in &mut self.layers {
            let read = other.layers.iter().find(|read| read.source == layer.source && read.reading == layer.reading);
            has_changed |= read.is_some_and(|read| layer.follow(read));
        }
        has_changed
    }

    /// Index of the layer with this number; `None` after it was closed.
    pub fn index_of(&self, number: u64) -> Option<usize> {
        self.layers.iter().position(|layer| layer.number == number)
    }

    pub fn layer(&self, number: u64) -> Option<&Layer> {
        self.layers.iter().find(|layer| layer.number == number)
    }

    pub fn layer_mut(&mut self, number: u64) -> Option<&mut Layer> {
        self.layers.iter_mut().find(|layer| layer.number == number)
    }

    /// The layers that the first picture includes.
    pub fn shown(&self) -> impl Iterator<Item = &Layer> {
        self.layers.iter().filter(|layer| layer.is_shown[0])
    }

    /// Bounds of the main content of all shown scenes; `None` if no shown scene is loaded.
    pub fn focus(&self) -> Option<Focus> {
        self.shown().filter_map(Layer::placed_focus).reduce(Focus::joined)
    }

    /// The edits of all layers, by their numbers.
    pub fn edits(&self) -> Edits {
        self.layers.iter().map(|layer| (layer.number, layer.edit.clone())).collect()
    }

    /// Numbers of selected, hidden and deleted Gaussians in all scenes.
    pub fn edit_counts(&self) -> Counts {
        let all = self.layers.iter().filter_map(|layer| layer.edit.as_deref()).map(Edit::counts);
        all.fold(Counts::default(), |sum, one| Counts {
            selected: sum.selected + one.selected,
            hidden: sum.hidden + one.hidden,
            deleted: sum.deleted + one.deleted,
        })
    }
}
