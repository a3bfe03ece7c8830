//! The Gaussians that an edit leaves of a scene.

use std::sync::Arc;

use anyhow::Result;

use super::edit::{Edit, TINT};
use super::loaded_scene::Held;
use crate::scene::Gaussians;

/// The Gaussians that an edit leaves.
pub struct Edited {
    pub of: Arc<Edit>,
    pub kept: Held,
    /// The same, with what is selected in another colour.
    pub tinted: Option<Held>,
}

impl Edited {
    /// What an edit leaves of a scene. `before` is the edit before and what that left.
    ///
    /// # Errors
    /// If there is not enough memory.
    pub fn new(of: Arc<Edit>, whole: &Arc<Gaussians>, before: Option<(Arc<Edit>, Held)>) -> Result<Self> {
        let drawn = of.drawn();
        let kept = match before.filter(|(edit, _)| edit.draws_same(&of)) {
            Some((_, kept)) => kept,
            None if drawn.len() == whole.len() => Held::Whole(whole.clone()),
            None => Held::Whole(Arc::new(whole.selected(&drawn)?)),
        };
        let is_selected: Vec<bool> = drawn.iter().map(|i| of.is_selected(*i as usize)).collect();
        let tinted = match is_selected.contains(&true) {
            true => Some(Held::Whole(Arc::new(whole.selected(&drawn)?.tinted(&is_selected, TINT.0, TINT.1)))),
            false => None,
        };
        Ok(Self { of, kept, tinted })
    }
}
