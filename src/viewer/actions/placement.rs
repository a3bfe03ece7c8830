//! Actions that place a scene: by dragging handles.

use glam::{DVec2, DVec3};

use crate::viewer::model::{DragMotion, Gizmo, Handle, Tab, Tool, Viewer};

impl Viewer {
    /// True if the left button has a tool other than turning the view.
    pub fn uses_tool(&self) -> bool {
        let is_usable = self.editing.tool == Tool::Place || !self.scenes.are_paged();
        !self.panels.are_hidden && self.editing.tool != Tool::Look && is_usable
    }

    /// True if the keys of edits count: with a tool, or in the page Edit.
    pub fn is_editing(&self) -> bool {
        self.uses_tool() || self.panels.shows(Tab::Edit)
    }

    /// Takes a tool.
    pub fn use_tool(&mut self, tool: Tool) {
        self.cancel_stroke();
        self.editing.tool = tool;
    }

    /// Number of the layer that the handles place: the chosen one, or else the first shown one.
    pub fn placed_layer(&self) -> Option<u64> {
        let is_open = |number: &u64| self.scenes.layers.iter().any(|layer| layer.number == *number);
        let first = || self.scenes.layers.iter().find(|layer| layer.is_shown[0]).map(|layer| layer.number);
        self.editing.placed_layer.filter(is_open).or_else(first)
    }

    /// The handles of the placed layer.
    pub fn gizmo(&self) -> Option<Gizmo> {
        let number = self.placed_layer()?;
        let layer = self.scenes.layer(number)?;
        Gizmo::new(&self.view.camera(), DVec3::from(layer.placed_focus()?.centre))
    }

    /// The drag of the handle at a position in the picture, in pixels; `points` is the number of pixels per point.
    pub fn handle_at(&self, place: DVec2, points: f64) -> Option<DragMotion> {
        Some(DragMotion::Handle(self.placed_layer()?, self.gizmo()?.at(place, points)?))
    }

    /// Drags a handle of a layer from one position in the picture to another, in pixels.
    pub fn drag_handle(&mut self, number: u64, handle: Handle, from: DVec2, to: DVec2) {
        let Some(gizmo) = self.gizmo() else { return };
        let Some(layer) = self.scenes.layer_mut(number) else { return };
        // A placement that is no valid transform is ignored.
        if let Some(place) = gizmo.dragged(layer.placement, handle, from, to).filter(|place| place.transform().is_ok())
        {
            layer.placement = place;
            self.pictures.are_stale = true;
        }
    }
}
