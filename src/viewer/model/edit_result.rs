//! The Gaussians of a scene that remain after an edit.

use std::sync::Arc;

use anyhow::Result;

use super::edit::{Edit, TINT};
use super::loaded_scene::LoadedScene;
use crate::scene::Gaussians;

/// The result of an edit.
pub struct EditResult {
    pub edit: Arc<Edit>,
    /// The Gaussians that are neither hidden nor deleted.
    pub scene: LoadedScene,
    /// The same Gaussians with the selected ones tinted; `None` without a selection.
    pub tinted: Option<LoadedScene>,
}

impl EditResult {
    /// Applies an edit to a scene. `before` is the edit before, with its result.
    ///
    /// # Errors
    /// There is not enough memory.
    pub fn new(edit: Arc<Edit>, whole: &Arc<Gaussians>, before: Option<(Arc<Edit>, LoadedScene)>) -> Result<Self> {
        let drawn = edit.drawn();
        let scene = match before.filter(|(before, _)| before.draws_same(&edit)) {
            Some((_, scene)) => scene,
            None if drawn.len() == whole.len() => LoadedScene::Whole(whole.clone()),
            None => LoadedScene::Whole(Arc::new(whole.selected(&drawn)?)),
        };
        let is_selected: Vec<bool> = drawn.iter().map(|i| edit.is_selected(*i as usize)).collect();
        let tinted = match is_selected.contains(&true) {
            true => Some(LoadedScene::Whole(Arc::new(whole.selected(&drawn)?.tinted(&is_selected, TINT.0, TINT.1)))),
            false => None,
        };
        Ok(Self { edit, scene, tinted })
    }
}
