//! The state of editing: the tool and its settings, and undo.

use super::drag::Tool;
use super::undo::Undo;

/// The state of editing.
pub struct Editing {
    /// The tool of the left button over the picture while the page of edits is open.
    pub tool: Tool,
    /// Number of the layer that the handles place, if one was chosen.
    pub placed_layer: Option<u64>,
    /// Radius of the brush in pixels.
    pub brush_px: f64,
    /// Selections leave out Gaussians that contribute to no pixel.
    pub only_visible: bool,
    /// Number of selections that jobs are computing.
    pub running_selections: usize,
    pub undo: Undo,
}

impl Default for Editing {
    fn default() -> Self {
        Self {
            tool: Tool::Look,
            placed_layer: None,
            brush_px: 20.0,
            only_visible: false,
            running_selections: 0,
            undo: Undo::default(),
        }
    }
}
