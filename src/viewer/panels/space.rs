//! Lines and points of the world, drawn over the picture.

use egui::{Color32, FontId, Painter, Pos2, Stroke, Ui, vec2};
use glam::{DVec2, DVec3};

use super::super::state::Viewer;
use super::over::painter;
use crate::camera::Camera;

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
        let [a, b] = [a, b].map(|place| self.view.view(place));
        let near = 1e-3 * (a - b).length();
        if a.z <= near && b.z <= near {
            return;
        }
        let cut = |p: DVec3, q: DVec3| if p.z >= near { p } else { p + (q - p) * ((near - p.z) / (q.z - p.z)) };
        self.painter.line_segment([cut(a, b), cut(b, a)].map(|place| self.at(place)), stroke);
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
        let seen = self.view.view(place);
        (seen.z > 0.0).then(|| self.at(seen))
    }

    /// Where a place before the camera, in view space, is seen in the window.
    fn at(&self, seen: DVec3) -> Pos2 {
        let pixel = (seen.truncate() / seen.z * self.view.focal_px + self.view.centre_px) / self.points;
        Pos2::new(pixel.x as f32, pixel.y as f32)
    }
}
