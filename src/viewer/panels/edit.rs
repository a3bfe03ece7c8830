//! The page Edit: tools, selections by value and by box, changes of the selected Gaussians, and saving.

use egui::{Align, Button, Color32, ComboBox, DragValue, Grid, Layout, Pos2, Rect, Sense, Stroke, Ui, pos2, vec2};
use glam::DVec2;
use indicatif::HumanCount as count;

use super::section;
use super::theme::MARK;
use super::world_painter::WorldPainter;
use crate::render::SelectionMode;
use crate::viewer::model::{
    Action, BoxHandles, Change, Counts, DragMotion, Gizmo, Handle, Histogram, Property, SaveTarget, Selection, Tool,
    ToolStroke, Viewer,
};

/// Colours of the axes x, y and z.
pub(super) const AXES: [Color32; 3] =
    [Color32::from_rgb(235, 90, 80), Color32::from_rgb(120, 200, 80), Color32::from_rgb(90, 150, 255)];

pub(super) fn show(viewer: &mut Viewer, ui: &mut Ui) {
    if let Some((_, _, name, help)) = Tool::ALL.iter().find(|(tool, ..)| *tool == viewer.editing.tool) {
        ui.strong(*name);
        ui.label(*help);
    }
    if !matches!(viewer.editing.tool, Tool::Look | Tool::Box | Tool::Place) {
        ui.weak("Shift adds, Ctrl subtracts; with Alt, and with the other buttons, the view moves as ever.");
    }
    match viewer.editing.tool {
        Tool::Brush => {
            let field = DragValue::new(&mut viewer.editing.brush_px).range(1.0..=500.0).suffix(" px");
            ui.horizontal(|ui| (ui.label("Radius of the brush"), ui.add(field)));
        }
        Tool::Place => {
            placed_scene(viewer, ui);
            ui.weak("The page Inside levels it by three points, and aligns it with another scene by pairs of points.");
        }
        _ => {}
    }
    ui.checkbox(&mut viewer.editing.only_visible, "Only what is seen").on_hover_text(
        "Selections leave out Gaussians that have less than 1/255 of the light of every pixel: what is hidden by \
         others, or too faint",
    );
    section(viewer, ui, "Selection", selection);
    section(viewer, ui, "Select by value", by_value);
    section(viewer, ui, "Select by box", by_box);
    section(viewer, ui, "Save", |viewer, ui| {
        ui.label("The scenes that are shown, where they are placed, without what is deleted. Hidden ones are saved.");
        ui.horizontal(|ui| {
            if ui.button("Save the scene...").clicked() {
                viewer.panels.dialog.save_file(SaveTarget::Scene);
            }
            let hint = viewer.setup.bindings.text(Action::Save);
            if ui.button("Save a project...").on_hover_text(hint).clicked() {
                viewer.panels.dialog.save_file(SaveTarget::Project);
            }
        });
    });
}

/// The scene that the handles, levels and alignments place.
pub(super) fn placed_scene(viewer: &mut Viewer, ui: &mut Ui) {
    let placed = viewer.placed_layer();
    let name = |number| viewer.scenes.layer(number).map(|layer| layer.name.clone());
    let text = placed.and_then(name).unwrap_or_else(|| "no scene".to_owned());
    ui.horizontal(|ui| {
        ui.label("Scene");
        ComboBox::from_id_salt("placed").width(180.0).selected_text(text).show_ui(ui, |ui| {
            for layer in &viewer.scenes.layers {
                ui.selectable_value(&mut viewer.editing.placed_layer, Some(layer.number), &layer.name);
            }
        });
    });
}

fn selection(viewer: &mut Viewer, ui: &mut Ui) {
    let Counts { selected, hidden, deleted } = viewer.scenes.edit_counts();
    let text = format!(
        "{} selected, {} hidden, {} deleted",
        count(selected as u64),
        count(hidden as u64),
        count(deleted as u64)
    );
    let label = ui.label(text);
    if let Some(ms) = viewer.editing.selection_ms {
        label.on_hover_text(format!("The last selection took {ms:.3} ms of the GPU."));
    }
    let rows = [
        ("All", Some(Action::SelectAll), Change::SelectAll, true),
        ("None", Some(Action::SelectNone), Change::SelectNone, selected > 0),
        ("Invert", Some(Action::Invert), Change::Invert, true),
        ("Delete", Some(Action::Delete), Change::Delete, selected > 0),
        ("Keep only these", None, Change::Crop, selected > 0),
        ("Hide", Some(Action::Hide), Change::Hide, selected > 0),
        ("Show hidden", Some(Action::ShowHidden), Change::ShowHidden, hidden > 0),
    ];
    ui.horizontal_wrapped(|ui| {
        for (name, action, change, can) in rows {
            let key = action.map(|action| viewer.setup.bindings.text(action)).unwrap_or_default();
            if ui.add_enabled(can, Button::new(name)).on_hover_text(key).clicked() {
                match action {
                    Some(action) => viewer.act(action, None),
                    None => viewer.change(change),
                }
            }
        }
    });
    ui.horizontal(|ui| {
        for (name, copies, hint) in [
            (
                "Separate",
                false,
                "Move what is selected into a scene of its own: it can be placed, tinted and saved alone",
            ),
            ("Duplicate", true, "Copy what is selected into a scene of its own"),
        ] {
            if ui.add_enabled(selected > 0, Button::new(name)).on_hover_text(hint).clicked() {
                viewer.separate(copies);
            }
        }
    });
    if selected > 0 {
        ui.weak(
            "What is selected is shown in yellow, unless pictures are compared or the scene is drawn in pages; what is \
             written has its own colours.",
        );
    }
}

/// The buttons of the three selection modes.
fn mode_buttons(ui: &mut Ui) -> Option<SelectionMode> {
    let mut wanted = None;
    ui.horizontal(|ui| {
        for (name, mode) in
            [("Select", SelectionMode::Replace), ("Add", SelectionMode::Add), ("Subtract", SelectionMode::Subtract)]
        {
            if ui.button(name).clicked() {
                wanted = Some(mode);
            }
        }
    });
    wanted
}

fn by_value(viewer: &mut Viewer, ui: &mut Ui) {
    viewer.editing.are_values_due = true;
    ui.horizontal(|ui| {
        let editing = &mut viewer.editing;
        ComboBox::from_id_salt("property").width(110.0).selected_text(editing.property.name()).show_ui(ui, |ui| {
            for (property, name) in Property::ALL {
                ui.selectable_value(&mut editing.property, property, name);
            }
            if let Property::Colour(_) = editing.property {
                let _ = ui.selectable_label(true, editing.property.name());
            }
        });
    });
    ui.horizontal(|ui| {
        for (name, value) in ["from", "to"].iter().zip(&mut viewer.editing.range) {
            ui.label(*name);
            // In steps that suit numbers of any size.
            let speed = f64::from(*value).clamp(1e-5, 1e3) * 0.01;
            ui.add(DragValue::new(value).speed(speed).range(0.0..=f32::MAX).custom_formatter(|v, _| limit(v as f32)));
        }
    });
    if let Some((_, why)) = &viewer.editing.refused {
        ui.weak(why);
    } else if viewer.editing.is_finding {
        ui.weak("values are computed");
    }
    let known = viewer.editing.values.as_ref().filter(|values| values.property == viewer.editing.property);
    let dragged = known.and_then(|values| histogram(&values.histogram, &mut viewer.editing.range, ui));
    let selection = Selection::Values(viewer.editing.property, viewer.editing.range[0]..=viewer.editing.range[1]);
    if let Some(goes_on) = dragged {
        viewer.select_while_dragging(&selection, goes_on);
    }
    if let Some(mode) = mode_buttons(ui) {
        viewer.select(&selection, mode);
    }
}

/// The histogram of a property, with the range that is selected. A drag sets the range; returns whether it goes on.
fn histogram(histogram: &Histogram, range: &mut [f32; 2], ui: &mut Ui) -> Option<bool> {
    let hint = "Drag to select the Gaussians of a range. Heights are logarithmic: a bar of one Gaussian is seen, too.";
    let (response, painter) = ui.allocate_painter(vec2(ui.available_width(), 72.0), Sense::drag());
    let response = response.on_hover_text(hint);
    let (rect, visuals) = (response.rect, ui.visuals());
    painter.rect_filled(rect, 2.0, visuals.extreme_bg_color);
    let most = histogram.counts.iter().copied().max().unwrap_or(0).max(1);
    let width = rect.width() / histogram.counts.len() as f32;
    let ends = range.map(|value| rect.left() + histogram.place(value) * rect.width());
    let selected = Rect::from_x_y_ranges(ends[0]..=ends[1].max(ends[0] + 1.0), rect.y_range());
    painter.rect_filled(selected, 0.0, visuals.selection.bg_fill.gamma_multiply(0.5));
    for (i, number) in histogram.counts.iter().enumerate().filter(|(_, number)| **number > 0) {
        let height = f64::from(*number + 1).ln() / f64::from(most + 1).ln();
        let left = rect.left() + i as f32 * width;
        let top = rect.bottom() - height as f32 * (rect.height() - 4.0);
        let bar = Rect::from_min_max(pos2(left, top), pos2(left + (width - 0.5).max(0.5), rect.bottom()));
        painter.rect_filled(bar, 0.0, visuals.text_color());
    }
    ui.horizontal(|ui| {
        ui.weak(short(histogram.low));
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            ui.weak(short(histogram.high));
            ui.centered_and_justified(|ui| ui.weak(if histogram.is_logarithmic { "logarithmic" } else { "linear" }));
        });
    });
    let place = |pos: Pos2| ((pos.x - rect.left()) / rect.width()).clamp(0.0, 1.0);
    let (from, to) = (ui.input(|input| input.pointer.press_origin()), response.interact_pointer_pos());
    let is_dragged = response.dragged() || response.drag_stopped();
    if let (true, Some(from), Some(to)) = (is_dragged, from, to) {
        let [low, high] = [place(from).min(place(to)), place(from).max(place(to))];
        // The first and the last bar also have the values beyond.
        let low = if low > 0.0 { histogram.value(low) } else { 0.0 };
        *range = [low, if high < 1.0 { histogram.value(high) } else { f32::MAX }];
    }
    is_dragged.then_some(!response.drag_stopped())
}

/// An end of a range.
fn limit(value: f32) -> String {
    if value == f32::MAX { "no limit".to_owned() } else { short(value) }
}

/// A number with few digits.
fn short(value: f32) -> String {
    if value == 0.0 || (1e-3..1e4).contains(&value) { format!("{value:.3}") } else { format!("{value:.1e}") }
}

fn by_box(viewer: &mut Viewer, ui: &mut Ui) {
    let mut corners = viewer.bounds();
    Grid::new("box").num_columns(4).show(ui, |ui| {
        for (name, corner) in ["From x y z", "To x y z"].iter().zip(&mut corners) {
            ui.label(*name);
            for value in corner.as_mut() {
                ui.add(DragValue::new(value).speed(0.01));
            }
            ui.end_row();
        }
    });
    if corners != viewer.bounds() {
        viewer.editing.bounds = Some(corners);
    }
    if let Some(mode) = mode_buttons(ui) {
        viewer.select(&Selection::Box(corners[0], corners[1]), mode);
    }
}

/// Draws the stroke of a tool, the brush, and the handles of a scene over the picture.
pub(super) fn over_picture(viewer: &Viewer, world: &WorldPainter, ui: &Ui) {
    if viewer.panels.are_hidden {
        return;
    }
    let line = Stroke::new(1.5, MARK);
    let painter = super::overlay::painter(ui);
    let points = f64::from(ui.ctx().pixels_per_point());
    let at = |place: DVec2| egui::pos2((place.x / points) as f32, (place.y / points) as f32);
    if let Some(ToolStroke { points: stroke, .. }) = &viewer.pointer.stroke
        && let (Some(first), Some(last)) = (stroke.first(), stroke.last())
    {
        match viewer.editing.tool {
            Tool::Rectangle => {
                let rect = egui::Rect::from_two_pos(at(*first), at(*last));
                painter.rect_stroke(rect, 0.0, line, egui::StrokeKind::Middle);
            }
            Tool::Lasso => {
                let closed = stroke.iter().chain([first]).map(|place| at(*place)).collect();
                painter.line(closed, line);
            }
            Tool::Brush => {
                let wide =
                    Stroke::new((2.0 * viewer.editing.brush_px / points) as f32, line.color.gamma_multiply(0.35));
                painter.line(stroke.iter().map(|place| at(*place)).collect(), wide);
            }
            Tool::Ball => drop(painter.circle_stroke(at(*first), (first.distance(*last) / points) as f32, line)),
            Tool::Look | Tool::Polygon | Tool::Box | Tool::Colour | Tool::Place => {}
        }
    }
    if viewer.editing.tool == Tool::Polygon {
        let cursor = viewer.pointer.pixel.map(|pixel| DVec2::from(pixel.map(f64::from)) + 0.5);
        let corners = &viewer.editing.polygon;
        painter.line(corners.iter().chain(cursor.iter().take(corners.len())).map(|place| at(*place)).collect(), line);
        for corner in corners {
            painter.circle_filled(at(*corner), 3.0, line.color);
        }
    }
    if viewer.editing.tool == Tool::Box {
        bounds(viewer, world, line);
    }
    if let (Tool::Brush, Some(pixel)) = (viewer.editing.tool, viewer.pointer.pixel) {
        painter.circle_stroke(at(DVec2::from(pixel.map(f64::from))), (viewer.editing.brush_px / points) as f32, line);
    }
    if let (Tool::Place, Some(gizmo)) = (viewer.editing.tool, viewer.gizmo()) {
        handles(viewer, &gizmo, world, ui);
    }
}

/// The edges of the box that selects, and the handles of its faces.
fn bounds(viewer: &Viewer, world: &WorldPainter, line: Stroke) {
    let handles = BoxHandles::new(&viewer.view.camera(), viewer.bounds());
    handles.edges().for_each(|ends| world.line(ends, line));
    for (axis, colour) in AXES.into_iter().enumerate() {
        for is_greater in [false, true] {
            world.dot(handles.face(axis, is_greater), 5.0, colour, "");
        }
    }
}

/// The arrows, the rings and the square of the gizmo.
fn handles(viewer: &Viewer, gizmo: &Gizmo, world: &WorldPainter, ui: &Ui) {
    let held = viewer.pointer.drag.and_then(|drag| match drag.motion {
        DragMotion::Handle(_, handle) => Some(handle),
        _ => None,
    });
    let width = |handle: Handle| if held == Some(handle) { 4.0 } else { 2.0 };
    for (axis, colour) in AXES.into_iter().enumerate() {
        let end = gizmo.end(axis);
        world.line([gizmo.centre, end], Stroke::new(width(Handle::Move(axis)), colour));
        world.dot(end, 5.0, colour, ["x", "y", "z"][axis]);
        for ends in gizmo.ring(axis).windows(2) {
            world.line([ends[0], ends[1]], Stroke::new(width(Handle::Turn(axis)), colour.gamma_multiply(0.8)));
        }
    }
    if let Some(centre) = world.position(gizmo.centre) {
        let square = egui::Rect::from_center_size(centre, vec2(10.0, 10.0));
        super::overlay::painter(ui).rect_filled(square, 1.0, Color32::WHITE);
    }
}
