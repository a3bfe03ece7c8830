//! The page Inside: view modes, frozen culling, and the explanation of a pixel.

use egui::{Color32, ComboBox, Context, DragValue, Panel, Pos2, Rect, ScrollArea, Stroke, Ui, Window, pos2, vec2};
use egui_phosphor::regular as icons;

use super::theme::MARK;
use super::world_painter::WorldPainter;
use crate::pixels::to_byte;
use crate::render::{Explained, false_colour};
use crate::viewer::model::{Action, ExplainedPixel, Numbers, Pair, Request, Side, VIEW_MODES, Viewer};

pub(super) fn show(viewer: &mut Viewer, pair: &Pair, ui: &mut Ui) {
    let is_paged = viewer.scenes.are_paged();
    let inspection = &mut viewer.inspector.settings;
    ComboBox::from_id_salt("view mode").width(180.0).selected_text(inspection.view_mode().title).show_ui(ui, |ui| {
        for (i, mode) in VIEW_MODES.iter().enumerate().filter(|(_, mode)| mode.suits(is_paged)) {
            ui.selectable_value(&mut inspection.mode, i, mode.title).on_hover_text(mode.unit);
        }
    });
    if matches!(inspection.view_mode().numbers, Numbers::Counts | Numbers::Mean(_)) {
        ui.horizontal(|ui| {
            let [low, high] = &mut inspection.ranges[inspection.mode];
            ui.add(DragValue::new(low).speed(0.05));
            scale(ui);
            ui.add(DragValue::new(high).speed(0.05));
            if ui.button("Fit").on_hover_text("to all values of the picture but the hundredth at each end").clicked() {
                viewer.requests.push(Request::FitRange);
            }
        });
    }
    let mut is_frozen = viewer.inspector.settings.culled_from.is_some();
    let hint = "What is culled stays culled while the view moves, and the frustum is shown";
    if ui.checkbox(&mut is_frozen, "Freeze culling").on_hover_text(hint).changed() {
        viewer.toggle_frozen_culling();
    }
    let inspection = &mut viewer.inspector.settings;
    if let Some(index) = inspection.isolated {
        ui.horizontal(|ui| {
            ui.label(format!("only Gaussian {index} is drawn"));
            if ui.small_button("draw all").clicked() {
                inspection.isolated = None;
            }
        });
    }
    let key = viewer.setup.bindings.text(Action::Pick);
    ui.label(format!("{key} explains the pixel under the cursor."));
    if let (Some(first), Some(index)) = (&pair.first, viewer.inspector.settings.isolated) {
        let i = index as usize;
        if let Some(gaussians) = first.gaussians.as_ref().filter(|gaussians| i < gaussians.len()) {
            ui.label(format!(
                "mean {:?}\nscales {:?}\nrotation {:?}\nopacity {}",
                gaussians.means()[i],
                gaussians.scales()[i],
                gaussians.rotations()[i],
                gaussians.opacities()[i]
            ));
        }
    }
}

/// The false colours, from low to high.
fn scale(ui: &mut Ui) {
    let (response, painter) = ui.allocate_painter(egui::vec2(110.0, 14.0), egui::Sense::hover());
    let width = response.rect.width() / 64.0;
    for i in 0..64 {
        let [r, g, b] = false_colour(f64::from(i) / 63.0);
        let left = response.rect.left_top() + egui::vec2(i as f32 * width, 0.0);
        let bar = egui::Rect::from_min_size(left, egui::vec2(width + 0.5, response.rect.height()));
        painter.rect_filled(bar, 0.0, Color32::from_rgb(r, g, b));
    }
}

/// Marks the explained pixel without covering it.
fn mark(context: &Context, at: egui::Pos2) {
    let painter = context.layer_painter(egui::LayerId::background());
    for (radius, colour) in [(7.0, Color32::BLACK), (6.0, Color32::WHITE)] {
        painter.circle_stroke(at, radius, Stroke::new(1.0, colour));
    }
}

/// Marks the explained pixel, and explains it in a window beside it while the panels are hidden.
pub(super) fn over_picture(viewer: &mut Viewer, pair: &Pair, free: Rect, context: &Context) {
    let Some(ExplainedPixel { pixel, view, .. }) = &viewer.inspector.explanation else { return };
    let points = context.pixels_per_point();
    let at = pos2(pixel[0] as f32 + 0.5, pixel[1] as f32 + 0.5) / points;
    if *view == viewer.view.camera() {
        mark(context, at);
    }
    if !viewer.panels.are_hidden {
        return;
    }
    let place = beside(free, at);
    let window = Window::new("explanation").title_bar(false).resizable(false).fixed_rect(place.shrink(12.0));
    window.show(context, |ui| explanation(viewer, pair, ui));
}

/// The largest part of a rectangle at one side of a position in it.
fn beside(free: Rect, at: Pos2) -> Rect {
    let sides = [
        Rect::from_min_max(free.min, pos2(at.x, free.bottom())),
        Rect::from_min_max(pos2(at.x, free.top()), free.max),
        Rect::from_min_max(free.min, pos2(free.right(), at.y)),
        Rect::from_min_max(pos2(free.left(), at.y), free.max),
    ];
    // A table is wider than high.
    let fits = |side: &Rect| side.width().min(WIDTH) * side.height().min(HEIGHT);
    let largest = sides.into_iter().max_by(|a, b| fits(a).total_cmp(&fits(b))).unwrap_or(free);
    let size = vec2(WIDTH, HEIGHT).min(largest.size());
    // As far from the position as possible.
    let corner = largest.center() - at;
    let left = if corner.x < 0.0 { largest.left() } else { largest.right() - size.x };
    let top = if corner.y < 0.0 { largest.top() } else { largest.bottom() - size.y };
    Rect::from_min_size(pos2(left, top), size)
}

/// Explains a pixel above the page of the panel.
pub(super) fn docked(viewer: &mut Viewer, pair: &Pair, ui: &mut Ui) {
    if viewer.inspector.explanation.is_none() {
        return;
    }
    let height = ui.available_height();
    let panel = Panel::top("explanation").resizable(true).default_size(0.45 * height);
    panel.size_range(80f32.min(0.5 * height)..=0.8 * height).show(ui, |ui| explanation(viewer, pair, ui));
}

/// The splats of the explained pixel front to back, each of which can be isolated.
fn explanation(viewer: &mut Viewer, pair: &Pair, ui: &mut Ui) {
    let Some(ExplainedPixel { pixel, side, view, explanation }) = &viewer.inspector.explanation else { return };
    let (mut chosen, mut is_closed) = (None, false);
    let is_moved = *view != viewer.view.camera();
    let [r, g, b] = explanation.colour(viewer.view.background);
    let of = if *side == Side::Second { " of the second picture" } else { "" };
    ui.horizontal(|ui| {
        ui.strong(format!("Pixel {}, {}{of}", pixel[0], pixel[1]));
        is_closed = ui.small_button(icons::X).on_hover_text("close (Esc)").clicked();
    });
    if is_moved {
        ui.label("The view has moved since: these numbers are of the pixel as it was.");
    }
    let end = if explanation.is_stopped { "stopped before the end of the list" } else { "to the end of the list" };
    let depth = explanation.depth().map_or_else(|| "nothing".to_owned(), |z| format!("{z:.4}"));
    ui.label(format!(
        "{} splats blended, {end}; transmittance left {:.5}\ncolour {r:.4} {g:.4} {b:.4}, depth {depth}",
        explanation.splats.len(),
        explanation.transmittance
    ));
    if *side == Side::First {
        ui.label("Click a Gaussian to draw only it; Esc draws all.");
    }
    ui.spacing_mut().item_spacing.x = 4.0;
    ui.horizontal(|ui| {
        for (title, width) in COLUMNS {
            ui.add_sized([width, 14.0], egui::Label::new(title));
        }
    });
    let rows = explanation.splats.len();
    ScrollArea::vertical().auto_shrink([false, false]).show_rows(ui, 18.0, rows, |ui, rows| {
        for Explained { gaussian, depth, alpha, transmittance, colour, share } in &explanation.splats[rows] {
            ui.horizontal(|ui| {
                let is_alone = *side == Side::First && viewer.inspector.settings.isolated == Some(*gaussian);
                let name = egui::Button::selectable(is_alone, gaussian.to_string());
                // Only Gaussians of the first picture can be drawn alone.
                let row = ui.add_enabled_ui(*side == Side::First, |ui| ui.add_sized([COLUMNS[0].1, 18.0], name));
                if row.inner.clicked() {
                    chosen = Some((!is_alone).then_some(*gaussian));
                }
                let numbers = [format!("{depth:.3}"), short(*alpha), short(*transmittance), short(*share)];
                for (number, (_, width)) in numbers.into_iter().zip(&COLUMNS[1..]) {
                    ui.add_sized([*width, 18.0], egui::Label::new(egui::RichText::new(number).monospace()));
                }
                let [r, g, b] = colour.map(to_byte);
                super::gpu_time::swatch(ui, Color32::from_rgb(r, g, b)).on_hover_text(format!("{colour:.4?}"));
            });
        }
    });
    if let Some(isolated) = chosen {
        viewer.inspector.settings.isolated = isolated.filter(|_| pair.first.is_some());
    }
    if is_closed {
        viewer.inspector.explanation = None;
    }
}

/// A number between 0 and 1 with four decimals.
fn short(value: f32) -> String {
    format!("{value:.4}")
}

/// The columns of the table of splats: titles, and widths in points.
const COLUMNS: [(&str, f32); 6] =
    [("Gaussian", 64.0), ("depth", 58.0), ("alpha", 46.0), ("T before", 52.0), ("share", 46.0), ("", 18.0)];

/// Largest size of the window that explains a pixel, in points.
const WIDTH: f32 = 380.0;
const HEIGHT: f32 = 340.0;

/// Draws the frustum at which culling is frozen, if the view has left it.
pub(super) fn frustum(viewer: &Viewer, world: &WorldPainter) {
    let Some(from) = viewer.inspector.settings.culled_from.as_ref().filter(|from| **from != viewer.view.camera())
    else {
        return;
    };
    let deep = from.position.distance(viewer.view.navigator.pivot()).max(1e-6);
    world.frustum(from, deep, Stroke::new(1.5, MARK));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The window leaves the pixel that it explains free, whatever the picture and the pixel.
    #[test]
    fn the_window_lies_beside_its_pixel() {
        for size in
            [vec2(320.0, 240.0), vec2(560.0, 560.0), vec2(900.0, 560.0), vec2(300.0, 900.0), vec2(1920.0, 1080.0)]
        {
            let free = Rect::from_min_size(Pos2::ZERO, size);
            for (x, y) in (1..20).flat_map(|x| (1..20).map(move |y| (x, y))) {
                let at = pos2(size.x * x as f32 / 20.0, size.y * y as f32 / 20.0);
                let place = beside(free, at);
                assert!(!place.shrink(12.0).contains(at) && free.contains_rect(place), "{size}: {at} in {place}");
                assert!(place.width() >= 150.0 && place.height() >= 120.0, "{size}: {place}");
            }
        }
    }
}
