//! The bar of tools beside the picture: icons, with names, keys and hints.

use egui::{Align2, Area, Button, Frame, Order, Rect, RichText, Ui, vec2};
use egui_phosphor::regular as icons;

use crate::viewer::model::{Tool, Viewer};

/// Size of an icon in points.
const ICON: f32 = 18.0;
/// Height of a button in points.
const BUTTON: f32 = 28.0;

/// Shows the bar at the left edge of the picture, if it has room for it.
pub(super) fn show(viewer: &mut Viewer, free: Rect, ui: &Ui) {
    // Selections need the whole scene in memory.
    let is_paged = viewer.scenes.are_paged();
    let is_usable = |tool: Tool| !is_paged || matches!(tool, Tool::Look | Tool::Place);
    let tools: Vec<_> = Tool::ALL.into_iter().filter(|(tool, ..)| is_usable(*tool)).collect();
    let height = BUTTON * (tools.len() as f32 + 1.0);
    if viewer.panels.are_hidden
        || viewer.scenes.layers.is_empty()
        || free.height() < height
        || free.width() < 8.0 * BUTTON
    {
        return;
    }
    let area = Area::new("tools".into()).pivot(Align2::LEFT_CENTER).fixed_pos(free.left_center() + vec2(8.0, 0.0));
    area.order(Order::Middle).fade_in(false).show(ui.ctx(), |ui| {
        Frame::popup(ui.style()).inner_margin(2.0).show(ui, |ui| {
            ui.spacing_mut().item_spacing = vec2(0.0, 0.0);
            for (tool, action, name, help) in tools {
                let icon = RichText::new(icon(tool)).size(ICON);
                let button = Button::selectable(viewer.editing.tool == tool, icon).min_size(vec2(BUTTON, BUTTON));
                // The text is made only where it is seen.
                let hint = |ui: &mut Ui| {
                    let key = viewer.setup.bindings.text(action);
                    ui.label(format!("{name} ({key})\n{help}"));
                };
                if ui.add(button).on_hover_ui(hint).clicked() {
                    viewer.use_tool(tool);
                }
            }
        });
    });
}

fn icon(tool: Tool) -> &'static str {
    match tool {
        Tool::Look => icons::HAND,
        Tool::Rectangle => icons::SELECTION,
        Tool::Lasso => icons::LASSO,
        Tool::Polygon => icons::POLYGON,
        Tool::Brush => icons::PAINT_BRUSH,
        Tool::Ball => icons::SPHERE,
        Tool::Box => icons::CUBE_FOCUS,
        Tool::Colour => icons::EYEDROPPER,
        Tool::Place => icons::ARROWS_OUT_CARDINAL,
    }
}
