//! Numbers over the picture: values of the pixel under the cursor, and the scale of the view mode.

use egui::{Align2, Color32, Rect, Stroke, StrokeKind, Ui, pos2, vec2};
use glam::{DVec2, DVec3};

use super::overlay::{MARGIN, label, painter};
use crate::pixels::{Pixels, to_byte};
use crate::render::{Attribute, Look, Quantity, false_colour};
use crate::viewer::model::{Area, CompareTarget, Numbers, Pair, Viewer};

/// Draws the numbers. `free` is the rectangle of the picture.
pub(super) fn show(viewer: &Viewer, pair: &Pair, free: Rect, ui: &Ui) {
    if viewer.panels.are_hidden {
        return;
    }
    area(viewer, pair, ui);
    legend(viewer, free, ui);
    if let Some(text) = under_cursor(viewer) {
        label(&painter(ui), (free.right_bottom() - vec2(MARGIN, MARGIN), Align2::RIGHT_BOTTOM), text);
    }
}

/// The values of the pixel under the cursor, once the pictures are at rest.
fn under_cursor(viewer: &Viewer) -> Option<String> {
    let (snapshot, [x, y]) = (viewer.inspector.snapshot.as_ref()?, viewer.pointer.pixel?);
    let pixel = |pixels: &Pixels| (x < pixels.size[0] && y < pixels.size[1]).then(|| pixels.at(x, y));
    let first = pixel(&snapshot.first)?;
    let second = snapshot.second.as_ref().and_then(|second| pixel(second));
    let quantity = viewer.inspector.settings.quantity();
    let mut lines = vec![format!("pixel {x}, {y}")];
    match second.filter(|_| viewer.comparison.target != CompareTarget::Nothing) {
        Some(second) => {
            lines.extend([
                format!("first    {}", value(quantity, first)),
                format!("second {}", value(quantity, second)),
            ]);
            if quantity == Quantity::Colour {
                let apart = (0..3).map(|c| (first[c] - second[c]).abs()).fold(0.0, f32::max);
                lines.push(format!("apart   {apart:.4}, {:.1} steps of 255", apart * 255.0));
            }
        }
        None => lines.push(value(quantity, first)),
    }
    if viewer.inspector.settings.view_mode().look == Look::Attribute(Attribute::Depth)
        && let Some(depth) = quantity.value(first)
    {
        let place = DVec2::new(x.into(), y.into()) + 0.5;
        let DVec3 { x, y, z } = viewer.view.camera().unprojected(place, f64::from(depth));
        lines.push(format!("world {x:.4} {y:.4} {z:.4}"));
    }
    Some(lines.join("\n"))
}

/// The value of a pixel as text.
fn value(quantity: Quantity, pixel: [f32; 4]) -> String {
    let [r, g, b, alpha] = pixel;
    match quantity {
        Quantity::Colour => {
            let [red, green, blue] = [r, g, b].map(to_byte);
            format!("{r:.4} {g:.4} {b:.4}, #{red:02x}{green:02x}{blue:02x}, alpha {alpha:.4}")
        }
        Quantity::Number(_) => format!("{r:.0}"),
        _ => quantity.value(pixel).map_or_else(|| "nothing".to_owned(), |value| format!("{value:.5}")),
    }
}

/// The name of the view mode, its false colours, and the ends of the scale.
fn legend(viewer: &Viewer, free: Rect, ui: &Ui) {
    let mode = viewer.inspector.settings.view_mode();
    if viewer.inspector.settings.mode == 0 {
        return;
    }
    let painter = painter(ui);
    let right = free.right() - MARGIN;
    let ends = match mode.numbers {
        Numbers::None => None,
        Numbers::Counts | Numbers::Mean(_) => Some(viewer.inspector.settings.ranges[viewer.inspector.settings.mode]),
        Numbers::Coverage | Numbers::Transmittance => Some([0.0, 1.0]),
    };
    let title = if mode.unit.is_empty() { mode.title.to_owned() } else { format!("{}: {}", mode.title, mode.unit) };
    let below = if viewer.comparison.target == CompareTarget::Nothing { MARGIN } else { MARGIN + 24.0 };
    label(&painter, (pos2(right, below), Align2::RIGHT_TOP), title);
    let Some([low, high]) = ends else { return };
    let bar = Rect::from_min_max(pos2(right - 160.0, below + 24.0), pos2(right, below + 36.0));
    let width = bar.width() / 64.0;
    for i in 0..64 {
        let [r, g, b] = false_colour(f64::from(i) / 63.0);
        let left = pos2(bar.left() + i as f32 * width, bar.top());
        painter.rect_filled(Rect::from_min_size(left, vec2(width + 0.5, 12.0)), 0.0, Color32::from_rgb(r, g, b));
    }
    painter.rect_stroke(bar, 0.0, Stroke::new(1.0, Color32::WHITE), StrokeKind::Outside);
    label(&painter, (bar.left_bottom() + vec2(0.0, 4.0), Align2::LEFT_TOP), short(low));
    label(&painter, (bar.right_bottom() + vec2(0.0, 4.0), Align2::RIGHT_TOP), short(high));
}

/// A number with four significant digits.
fn short(value: f32) -> String {
    let digits = 3 - (value.abs().max(1e-6).log10().floor() as i32);
    let text = format!("{value:.*}", digits.clamp(0, 6) as usize);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// The area of the pictures that is compared, and what a photograph covers of the view.
fn area(viewer: &Viewer, pair: &Pair, ui: &Ui) {
    if viewer.comparison.target == CompareTarget::Nothing || viewer.mismatch(pair).is_some() {
        return;
    }
    let points = ui.ctx().pixels_per_point();
    let corner = |x: u32, y: u32| pos2(x as f32 / points, y as f32 / points);
    let outline = |[left, top, right, bottom]: Area, width: f32| {
        let rect = Rect::from_min_max(corner(left, top), corner(right, bottom));
        painter(ui).rect_stroke(rect, 0.0, Stroke::new(width, Color32::WHITE), StrokeKind::Outside);
        rect
    };
    if let Some(covered) = viewer.covered(pair) {
        let rect = outline(covered, 1.0);
        let place = (rect.left_bottom() + vec2(MARGIN, MARGIN), Align2::LEFT_TOP);
        label(&painter(ui), place, format!("{} ends here", viewer.second_name(pair)));
    }
    if let Some(area) = viewer.comparison.area {
        outline(area, 1.5);
    }
}
