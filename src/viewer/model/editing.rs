//! The state of editing: the tool and its settings, and undo.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::contributions::Contributions;
use super::drag::Tool;
use super::edit::{Edits, Property};
use super::property_values::PropertyValues;
use super::undo::Undo;

/// The state of editing.
pub struct Editing {
    /// The tool of the left button over the picture while the page of edits is open.
    pub tool: Tool,
    /// Number of the layer that the handles place, if one was chosen.
    pub placed_layer: Option<u64>,
    /// Radius of the brush in pixels.
    pub brush_px: f64,
    /// The corners of a polygon that is being drawn, in pixels.
    pub polygon: Vec<DVec2>,
    /// The least and the greatest corner of the box that selects; `None` before it is first shown.
    pub bounds: Option<[DVec3; 2]>,
    /// The property by which the page selects.
    pub property: Property,
    /// The range of the property.
    pub range: [f32; 2],
    /// The last property of which values were computed.
    pub values: Option<PropertyValues>,
    /// True if the page shows values of the property.
    pub are_values_due: bool,
    /// The property whose values could not be computed, with the reason, so that the page does not try again.
    pub refused: Option<(Property, String)>,
    /// Selections leave out Gaussians that contribute to no pixel.
    pub only_visible: bool,
    /// The last contributions that a job has found.
    pub contributions: Option<Arc<Contributions>>,
    /// True while a job finds contributions, or computes values.
    pub is_finding: bool,
    /// The GPU time of the last selection in milliseconds.
    pub selection_ms: Option<f64>,
    /// The edits of layers at the beginning of the stroke.
    pub before: Edits,
    pub undo: Undo,
}

impl Default for Editing {
    fn default() -> Self {
        Self {
            tool: Tool::Look,
            placed_layer: None,
            brush_px: 20.0,
            polygon: Vec::new(),
            bounds: None,
            property: Property::Opacity,
            range: [0.0, 0.05],
            values: None,
            are_values_due: false,
            refused: None,
            only_visible: false,
            contributions: None,
            is_finding: false,
            selection_ms: None,
            before: Vec::new(),
            undo: Undo::default(),
        }
    }
}
