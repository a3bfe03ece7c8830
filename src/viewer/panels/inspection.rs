//! The page Inside: view modes, frozen culling, and the explanation of a pixel.

use egui::{Color32, ComboBox, Context, DragValue, Grid, ScrollArea, Stroke, Ui, Window};

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
    let key = viewer.setup.bindings.text(Action::Mark);
    ui.label(format!("{key} marks the point under the cursor; lines show how far marks are apart."));
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

/// The window that explains a pixel: its splats front to back, each of which can be isolated.
pub(super) fn explanation(viewer: &mut Viewer, pair: &Pair, context: &Context) {
    let Some(ExplainedPixel { pixel, side, view, explanation }) = &viewer.inspector.explanation else { return };
    let mut is_open = true;
    let mut chosen = None;
    let is_moved = *view != viewer.view.camera();
    let points = context.pixels_per_point();
    let at = egui::pos2(pixel[0] as f32 + 0.5, pixel[1] as f32 + 0.5) / points;
    if !is_moved {
        mark(context, at);
    }
    // The window opens beside the pixel.
    let width = viewer.view.size[0] as f32 / points;
    let beside = if at.x < width / 2.0 { width / 2.0 } else { 12.0 };
    let [r, g, b] = explanation.colour(viewer.view.background);
    let of = if *side == Side::Second { " of the second picture" } else { "" };
    let window = Window::new(format!("Pixel {}, {}{of}", pixel[0], pixel[1])).open(&mut is_open);
    window.default_size([460.0, 320.0]).default_pos([beside, 24.0]).show(context, |ui| {
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
        ui.horizontal(|ui| {
            for title in ["Gaussian", "depth", "alpha", "T before", "share", "colour"] {
                ui.add_sized([62.0, 14.0], egui::Label::new(title));
            }
        });
        let rows = explanation.splats.len();
        ScrollArea::vertical().auto_shrink([false, false]).max_height(360.0).show_rows(ui, 18.0, rows, |ui, rows| {
            Grid::new("splats").num_columns(6).min_col_width(62.0).striped(true).show(ui, |ui| {
                for Explained { gaussian, depth, alpha, transmittance, colour, share } in &explanation.splats[rows] {
                    let is_alone = *side == Side::First && viewer.inspector.settings.isolated == Some(*gaussian);
                    let name = egui::Button::selectable(is_alone, gaussian.to_string());
                    // Only Gaussians of the first picture can be drawn alone.
                    if ui.add_enabled(*side == Side::First, name).clicked() {
                        chosen = Some((!is_alone).then_some(*gaussian));
                    }
                    ui.monospace(format!("{depth:.4}"));
                    ui.monospace(format!("{alpha:.4}"));
                    ui.monospace(format!("{transmittance:.4}"));
                    ui.monospace(format!("{share:.4}"));
                    let [r, g, b] = colour.map(to_byte);
                    super::gpu_time::swatch(ui, Color32::from_rgb(r, g, b)).on_hover_text(format!("{colour:.4?}"));
                    ui.end_row();
                }
            });
        });
    });
    if let Some(isolated) = chosen {
        viewer.inspector.settings.isolated = isolated.filter(|_| pair.first.is_some());
    }
    if !is_open {
        viewer.inspector.explanation = None;
    }
}

/// Draws the frustum at which culling is frozen, if the view has left it.
pub(super) fn frustum(viewer: &Viewer, world: &WorldPainter) {
    let Some(from) = viewer.inspector.settings.culled_from.as_ref().filter(|from| **from != viewer.view.camera())
    else {
        return;
    };
    let deep = from.position.distance(viewer.view.navigator.pivot()).max(1e-6);
    world.frustum(from, deep, Stroke::new(1.5, Color32::from_rgb(255, 200, 60)));
}
