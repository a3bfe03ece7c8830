//! Lines and points of the world, drawn over the picture.

use egui::{Color32, FontId, Painter, Pos2, Stroke, Ui, vec2};
use glam::{DVec2, DVec3};

use super::over::painter;
use crate::camera::Camera;
use crate::viewer::model::Viewer;

/// Draws what lies in the world over the picture.
pub(super) struct Space {
    view: Camera,
    painter: Painter,
    /// Pixels of a point of the window.
    points: f64,
}

impl Space {
    pub fn new(viewer: &Viewer, ui: &Ui) -> Self {
        Self { view: viewer.view(), painter: painter(ui), points: f64::from(ui.ctx().pixels_per_point()) }
    }

    /// A line between two places, as far as it lies before the camera.
    pub fn line(&self, [a, b]: [DVec3; 2], stroke: Stroke) {
        let near = 1e-3 * (a - b).length();
        let [a_z, b_z] = [a, b].map(|place| self.view.view(place).z);
        if a_z <= near && b_z <= near {
            return;
        }
        let cut = |p: DVec3, z: f64, q: DVec3, other_z: f64| {
            if z >= near { p } else { p + (q - p) * ((near - z) / (other_z - z)) }
        };
        if let (Some(a), Some(b)) = (self.place(cut(a, a_z, b, b_z)), self.place(cut(b, b_z, a, a_z))) {
            self.painter.line_segment([a, b], stroke);
        }
    }

    /// A point with a name beside it, if it lies before the camera.
    pub fn dot(&self, place: DVec3, radius: f32, colour: Color32, name: &str) {
        let Some(at) = self.place(place) else { return };
        self.painter.circle(at, radius, colour, Stroke::new(1.0, Color32::BLACK));
        if !name.is_empty() {
            let beside = at + vec2(radius + 3.0, 0.0);
            self.painter.text(beside, egui::Align2::LEFT_CENTER, name, FontId::proportional(11.0), colour);
        }
    }

    /// The pyramid that a camera sees, up to this view z.
    pub fn frustum(&self, camera: &Camera, deep: f64, stroke: Stroke) {
        let corner = |[x, y]: [f64; 2]| {
            let place = DVec2::new(x, y) * DVec2::from(camera.size_px.map(f64::from));
            camera.unprojected(place, deep)
        };
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(corner);
        for i in 0..4 {
            self.line([corners[i], corners[(i + 1) % 4]], stroke);
            self.line([camera.position, corners[i]], stroke);
        }
    }

    /// Where a place of the world is seen in the window; `None` behind the camera.
    pub fn place(&self, place: DVec3) -> Option<Pos2> {
        let (pixel, _) = self.view.projected(place)?;
        let at = pixel / self.points;
        Some(Pos2::new(at.x as f32, at.y as f32))
    }
}
