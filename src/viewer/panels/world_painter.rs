//! Lines and points in world space, drawn over the picture.

use std::sync::Arc;

use egui::{Color32, FontId, Painter, Pos2, Stroke, Ui, vec2};
use glam::{DVec2, DVec3};

use super::overlay::painter;
use crate::camera::Camera;
use crate::viewer::model::{CURVE_PARTS, Depths, Viewer, before_camera, curve_pieces, line_pieces};

/// Most parts of a segment that may be hidden by the picture, their length in pixels, and the opacity of hidden ones.
const SEEN_PARTS: u32 = 96;
const PART_PX: f64 = 8.0;
const HIDDEN: f32 = 0.25;

/// Draws lines and points in world space over the picture.
pub(super) struct WorldPainter {
    view: Camera,
    painter: Painter,
    /// Pixels per point of the window.
    points: f64,
    /// The depths of the picture, if lines behind it are drawn faintly.
    depths: Option<Arc<Depths>>,
}

impl WorldPainter {
    pub fn new(viewer: &Viewer, ui: &Ui) -> Self {
        Self {
            view: viewer.view.camera(),
            painter: painter(ui),
            points: f64::from(ui.ctx().pixels_per_point()),
            depths: None,
        }
    }

    /// The same painter, which draws faintly what lies behind the picture. Depths of another view are not used.
    pub fn behind(mut self, depths: Option<&Arc<Depths>>) -> Self {
        self.depths = depths.filter(|depths| depths.view == self.view).cloned();
        self
    }

    /// A segment, clipped to the half-space in front of a pinhole; through a lens, a curve.
    pub fn line(&self, [a, b]: [DVec3; 2], stroke: Stroke) {
        if let Some(depths) = &self.depths {
            return self.parts([a, b], stroke, depths);
        }
        self.pieces(&line_pieces(&self.view, [a, b]), stroke);
    }

    /// A segment in short parts, of which those behind the picture are drawn faintly.
    fn parts(&self, [a, b]: [DVec3; 2], stroke: Stroke, depths: &Depths) {
        let Some([a, b]) = before_camera(&self.view, [a, b]) else { return };
        let faint = Stroke::new(stroke.width, stroke.color.gamma_multiply(HIDDEN));
        let ends = [a, b].map(|end| self.view.projected(end));
        let long = match ends {
            [Some((a, _)), Some((b, _))] if self.view.lens.is_none() => a.distance(b) / PART_PX,
            _ => f64::from(SEEN_PARTS),
        };
        let parts = (long.ceil() as u32).clamp(1, SEEN_PARTS);
        let seen = (0..=parts).map(|i| self.view.projected(a.lerp(b, f64::from(i) / f64::from(parts))));
        let seen: Vec<Option<(DVec2, f64)>> = seen.collect();
        // Through a lens, a part may leave the picture on one side and come back on the other.
        let farthest = if self.view.lens.is_some() { f64::from(self.view.size_px[0]) / 2.0 } else { f64::INFINITY };
        // Neighbouring parts of one kind are one line.
        let mut way: Vec<Pos2> = Vec::new();
        let mut is_hidden = false;
        let draw = |way: &mut Vec<Pos2>, is_hidden: bool| {
            if way.len() > 1 {
                self.painter.line(std::mem::take(way), if is_hidden { faint } else { stroke });
            }
            way.clear();
        };
        for pair in seen.windows(2) {
            let (Some((a, a_depth)), Some((b, b_depth))) = (pair[0], pair[1]) else {
                draw(&mut way, is_hidden);
                continue;
            };
            if a.distance(b) > farthest {
                draw(&mut way, is_hidden);
                continue;
            }
            let hides = depths.hides((a + b) / 2.0, (a_depth + b_depth) / 2.0);
            if way.is_empty() || hides != is_hidden {
                draw(&mut way, is_hidden);
                way.push(self.in_points(a));
                is_hidden = hides;
            }
            way.push(self.in_points(b));
        }
        draw(&mut way, is_hidden);
    }

    fn pieces(&self, pieces: &[[DVec2; 2]], stroke: Stroke) {
        for piece in pieces {
            self.painter.line_segment(piece.map(|end| self.in_points(end)), stroke);
        }
    }

    /// A place of the picture in the window.
    fn in_points(&self, pixel: DVec2) -> Pos2 {
        let at = pixel / self.points;
        Pos2::new(at.x as f32, at.y as f32)
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
            let border = (0..=CURVE_PARTS).map(|k| from.lerp(to, f64::from(k) / f64::from(CURVE_PARTS)));
            let places = border.map(|place| camera.unprojected(place, deep));
            self.pieces(&curve_pieces(&self.view, places), stroke);
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
        Some(self.in_points(pixel))
    }
}
