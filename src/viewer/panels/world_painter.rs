//! Lines and points in world space, drawn over the picture.

use egui::{Color32, FontId, Painter, Pos2, Stroke, Ui, vec2};
use glam::{DVec2, DVec3};

use super::overlay::painter;
use crate::camera::Camera;
use crate::viewer::model::Viewer;

/// Parts of a segment that is drawn as a curve.
const PARTS: u32 = 12;

/// Draws lines and points in world space over the picture.
pub(super) struct WorldPainter {
    view: Camera,
    painter: Painter,
    /// Pixels per point of the window.
    points: f64,
}

impl WorldPainter {
    pub fn new(viewer: &Viewer, ui: &Ui) -> Self {
        Self { view: viewer.view.camera(), painter: painter(ui), points: f64::from(ui.ctx().pixels_per_point()) }
    }

    /// A segment, clipped to the half-space in front of a pinhole; through a lens, a curve.
    pub fn line(&self, [a, b]: [DVec3; 2], stroke: Stroke) {
        if self.view.lens.is_some() {
            return self.curve((0..=PARTS).map(|i| a.lerp(b, f64::from(i) / f64::from(PARTS))), stroke);
        }
        let near = 1e-3 * (a - b).length();
        let [a_z, b_z] = [a, b].map(|place| self.view.view(place).z);
        if a_z <= near && b_z <= near {
            return;
        }
        let cut = |p: DVec3, z: f64, q: DVec3, other_z: f64| {
            if z >= near { p } else { p + (q - p) * ((near - z) / (other_z - z)) }
        };
        if let (Some(a), Some(b)) = (self.position(cut(a, a_z, b, b_z)), self.position(cut(b, b_z, a, a_z))) {
            self.painter.line_segment([a, b], stroke);
        }
    }

    /// The curve through points of the world, without the parts that leave the picture on one side and come back on
    /// the other.
    fn curve(&self, places: impl Iterator<Item = DVec3>, stroke: Stroke) {
        let seen: Vec<Option<Pos2>> = places.map(|place| self.position(place)).collect();
        let farthest = (f64::from(self.view.size_px[0]) / self.points / 2.0) as f32;
        for pair in seen.windows(2) {
            if let [Some(a), Some(b)] = *pair
                && a.distance(b) < farthest
            {
                self.painter.line_segment([a, b], stroke);
            }
        }
    }

    /// A point with a name beside it, if it is in front of the camera.
    pub fn dot(&self, place: DVec3, radius: f32, colour: Color32, name: &str) {
        let Some(at) = self.position(place) else { return };
        self.painter.circle(at, radius, colour, Stroke::new(1.0, Color32::BLACK));
        if !name.is_empty() {
            let beside = at + vec2(radius + 3.0, 0.0);
            self.painter.text(beside, egui::Align2::LEFT_CENTER, name, FontId::proportional(11.0), colour);
        }
    }

    /// The frustum of a camera, up to this depth: of a lens with bent borders, where it sees something.
    pub fn frustum(&self, camera: &Camera, deep: f64, stroke: Stroke) {
        if camera.lens.is_some() {
            return self.bent_frustum(camera, deep, stroke);
        }
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

    fn bent_frustum(&self, camera: &Camera, deep: f64, stroke: Stroke) {
        let size = DVec2::from(camera.size_px.map(f64::from));
        let corners = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y].map(|corner| corner * size);
        for i in 0..4 {
            let (from, to) = (corners[i], corners[(i + 1) % 4]);
            let border = (0..=PARTS).map(|k| from.lerp(to, f64::from(k) / f64::from(PARTS)));
            self.curve(border.map(|place| camera.unprojected(place, deep)), stroke);
            // NaN where the lens sees nothing.
            let edge = [0.0, deep].map(|depth| camera.unprojected(from, depth));
            if edge[1].is_finite() {
                self.line(edge, stroke);
            }
        }
    }

    /// The position of a point in the window; `None` behind the camera.
    pub fn position(&self, place: DVec3) -> Option<Pos2> {
        let (pixel, _) = self.view.projected(place)?;
        let at = pixel / self.points;
        Some(Pos2::new(at.x as f32, at.y as f32))
    }
}
