//! Guides over the picture: the axes of the world, a grid on the ground, and the directions to look along.

use egui::{Color32, Rect, Sense, Stroke, Ui, pos2, vec2};
use glam::DVec3;

use super::edit::AXES;
use super::overlay::painter;
use super::world_painter::WorldPainter;
use crate::viewer::model::Viewer;

/// Lines of the grid to each side.
const LINES: i32 = 10;

/// Length of the drawn axes, and radius of their ends, in points.
const SIZE: f32 = 30.0;
const END: f32 = 8.0;

/// Draws the guides, if they are on. `free` is the rectangle of the picture.
pub(super) fn show(viewer: &mut Viewer, world: &WorldPainter, free: Rect, ui: &mut Ui) {
    if !viewer.panels.recent.shows_guides || viewer.panels.are_hidden {
        return;
    }
    // A power of ten that makes the grid about as large as the scene.
    let step = 10f64.powf((viewer.view.navigator.radius() / 3.0).log10().round());
    let up = viewer.view.navigator.up().vector();
    let sides = DVec3::AXES.map(|axis| axis * f64::from(u8::from(axis.dot(up) == 0.0)));
    let mut sides = sides.into_iter().filter(|side| *side != DVec3::ZERO);
    if let (Some(a), Some(b)) = (sides.next(), sides.next()) {
        let reach = f64::from(LINES) * step;
        for i in -LINES..=LINES {
            let colour = Color32::from_white_alpha(if i == 0 { 110 } else { 45 });
            let at = f64::from(i) * step;
            for (along, aside) in [(a, b), (b, a)] {
                let ends = [aside * at - along * reach, aside * at + along * reach];
                world.line(ends, Stroke::new(1.0, colour));
            }
        }
    }
    for (axis, colour) in AXES.into_iter().enumerate() {
        world.line([DVec3::ZERO, DVec3::AXES[axis] * step], Stroke::new(2.0, colour));
    }
    super::overlay::label(
        &painter(ui),
        (free.right_top() + vec2(-12.0, 2.0 * (SIZE + END) + 14.0), egui::Align2::RIGHT_TOP),
        format!("grid {step}"),
    );
    directions(viewer, free, ui);
}

/// The axes of the world in the upper right corner, rotated as in the view; a click on an end looks from there.
fn directions(viewer: &mut Viewer, free: Rect, ui: &mut Ui) {
    let middle = free.right_top() + vec2(-SIZE - END - 10.0, SIZE + END + 6.0);
    let view = viewer.view.camera();
    let mut ends: Vec<(f64, DVec3, usize, bool)> = Vec::new();
    for axis in 0..3 {
        for is_positive in [true, false] {
            let from = DVec3::AXES[axis] * if is_positive { 1.0 } else { -1.0 };
            ends.push(((view.rotation * from).z, from, axis, is_positive));
        }
    }
    // The nearest is drawn last.
    ends.sort_by(|a, b| b.0.total_cmp(&a.0));
    let painter = painter(ui);
    for (_, from, axis, is_positive) in ends {
        let seen = view.rotation * from;
        let at = middle + vec2(seen.x as f32, seen.y as f32) * SIZE;
        let colour = AXES[axis];
        if is_positive {
            painter.line_segment([middle, at], Stroke::new(2.0, colour));
            painter.circle_filled(at, END, colour);
            let name = ["x", "y", "z"][axis];
            painter.text(at, egui::Align2::CENTER_CENTER, name, egui::FontId::proportional(11.0), Color32::BLACK);
        } else {
            painter.circle(at, END - 2.0, colour.gamma_multiply(0.35), Stroke::new(1.0, colour));
        }
        let area = Rect::from_center_size(pos2(at.x, at.y), vec2(2.0 * END, 2.0 * END));
        let response = ui.interact(area, ui.id().with(("direction", axis, is_positive)), Sense::click());
        let sign = if is_positive { "+" } else { "-" };
        let hint = format!("Look at the pivot from {sign}{}", ["x", "y", "z"][axis]);
        if response.on_hover_text(hint).clicked() {
            viewer.view.look_from(from);
        }
    }
}
