//! Actions that place scenes by handles, level them, and look at them along the axes.

use glam::{DQuat, DVec2, DVec3};

use crate::camera::Camera;
use crate::viewer::model::{Gizmo, Handle, Motion, Tab, Tool, Viewer, turned};

/// Horizontal field of view of a flat view, in degrees. What lies one picture's width behind another looks smaller by
/// 0.35 %: across a picture of 500 pixels, less than a pixel to each side.
const FLAT_DEGREES: f64 = 0.2;

impl Viewer {
    /// True while the page of edits is open.
    pub fn edits(&self) -> bool {
        self.kept.tab == Tab::Edit && !self.panels.are_hidden
    }

    /// True if the left button uses a tool instead of turning the view.
    pub fn uses_tool(&self) -> bool {
        self.edits() && self.tool != Tool::Look
    }

    /// The number of the scene that handles place: the one that was chosen, or the first that is shown.
    pub fn placed(&self) -> Option<u64> {
        let is_open = |number: &u64| self.layers.iter().any(|layer| layer.number == *number);
        let first = || self.layers.iter().find(|layer| layer.is_shown[0]).map(|layer| layer.number);
        self.placed.filter(is_open).or_else(first)
    }

    /// The handles of the scene that is placed.
    pub fn gizmo(&self) -> Option<Gizmo> {
        let number = self.placed()?;
        let layer = self.layers.iter().find(|layer| layer.number == number)?;
        Gizmo::new(&self.view(), DVec3::from(layer.placed_focus()?.centre))
    }

    /// The drag of the handle at a place of the picture, in pixels; `points` are the pixels of a point.
    pub fn handle_at(&self, place: DVec2, points: f64) -> Option<Motion> {
        Some(Motion::Handle(self.placed()?, self.gizmo()?.at(place, points)?))
    }

    /// Drags a handle of a scene from one place of the picture to another, in pixels.
    pub fn drag_handle(&mut self, number: u64, handle: Handle, from: DVec2, to: DVec2) {
        let Some(gizmo) = self.gizmo() else { return };
        let Some(layer) = self.layers.iter_mut().find(|layer| layer.number == number) else { return };
        // A placement that is no transform is not taken.
        if let Some(place) = gizmo.dragged(layer.place, handle, from, to).filter(|place| place.transform().is_ok()) {
            layer.place = place;
            self.is_stale = true;
        }
    }

    /// Turns the scene that is placed until three marks lie level.
    pub fn level_by_marks(&mut self) {
        let [a, b, c] = self.marks[..] else { return self.messages.note("mark three points of the ground first") };
        let Some(normal) = (b - a).cross(c - a).try_normalize() else {
            return self.messages.note("the three marks lie on a line: they say nothing of the ground");
        };
        let up = self.navigator.up().vector();
        // The ground is seen from above.
        let normal = if normal.dot(self.view().position - a) < 0.0 { -normal } else { normal };
        let turn = DQuat::from_rotation_arc(normal, up);
        let Some(number) = self.placed() else { return };
        let Some(layer) = self.layers.iter_mut().find(|layer| layer.number == number) else { return };
        layer.place = turned(layer.place, a, turn);
        self.marks = vec![a, a + turn * (b - a), a + turn * (c - a)];
        self.is_stale = true;
        let degrees = normal.angle_between(up).to_degrees();
        self.messages.note(format!("{} is turned by {degrees:.2} degrees", layer.name));
    }

    /// Glides to a view of the pivot from this direction, at the same distance.
    pub fn look_from(&mut self, from: DVec3) {
        let (view, pivot) = (self.view(), self.navigator.pivot());
        let distance = view.position.distance(pivot);
        let up = self.navigator.up().vector();
        // Straight from above or below, what was up in the picture stays up as far as it can.
        let upright = match from.cross(up).length() > 1e-6 {
            true => up,
            false => {
                let axes = DVec3::AXES.into_iter().filter(|axis| axis.dot(up) == 0.0);
                let signed = axes.flat_map(|axis| [axis, -axis]);
                let seen_up = -view.rotation.row(1);
                signed.max_by(|a, b| a.dot(seen_up).total_cmp(&b.dot(seen_up))).unwrap_or(DVec3::X)
            }
        };
        let position = pivot + from * distance;
        let turned = Camera::looking_upright([position, pivot], upright, view.size_px, 1.0);
        let camera = Camera { position, rotation: turned.rotation, ..view };
        self.navigator.glide_to(&camera, crate::camera::GLIDE_SECONDS);
        self.camera = None;
    }

    /// Makes the view flat, or usual again. The pivot keeps its size in the picture.
    pub fn toggle_flat(&mut self) {
        let degrees = if self.is_flat() { self.unflat_degrees } else { FLAT_DEGREES };
        if !self.is_flat() {
            self.unflat_degrees = self.navigator.field_of_view();
        }
        let (view, pivot) = (self.view(), self.navigator.pivot());
        let half = |degrees: f64| (degrees.to_radians() / 2.0).tan();
        let factor = half(self.navigator.field_of_view()) / half(degrees);
        let position = pivot + (view.position - pivot) * factor;
        self.navigator.snap(&Camera { position, focal_px: view.focal_px * factor, ..view });
        self.navigator.set_pivot(pivot);
        self.camera = None;
        self.is_stale = true;
    }

    /// True if the rays of the view are nearly parallel.
    pub fn is_flat(&self) -> bool {
        self.navigator.field_of_view() <= FLAT_DEGREES * 1.01
    }
}
