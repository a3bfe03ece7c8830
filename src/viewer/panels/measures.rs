//! Measures: their list in the page Inside, and their points and numbers over the picture.

use egui::{Align2, Button, Color32, ComboBox, DragValue, Stroke, TextEdit, Ui};
use egui_phosphor::regular as icons;

use super::overlay::{label, painter};
use super::theme::MARK;
use super::world_painter::WorldPainter;
use crate::viewer::model::{Action, MeasureKind, Viewer};

pub(super) fn show(viewer: &mut Viewer, ui: &mut Ui) {
    let key = viewer.setup.bindings.text(Action::Mark);
    ui.label(format!("{key} adds the point under the cursor, and copies its position; Esc ends a measure."));
    ui.horizontal(|ui| {
        let kind = &mut viewer.ruler.kind;
        ui.label("Next");
        ComboBox::from_id_salt("measure").width(90.0).selected_text(kind.name()).show_ui(ui, |ui| {
            for (one, name, hint) in MeasureKind::ALL {
                if ui.selectable_value(kind, one, name).on_hover_text(hint).clicked() {
                    viewer.ruler.open = None;
                }
            }
        });
    });
    ui.weak(MeasureKind::ALL[viewer.ruler.kind as usize].2);
    let (mut removed, mut opened) = (None, None);
    for (i, measure) in viewer.measures.all.iter().enumerate() {
        ui.horizontal(|ui| {
            let is_open = viewer.ruler.open == Some(i);
            let points = measure.points.len();
            let reading = viewer.measures.reading(measure);
            let text = match reading.is_empty() {
                true => format!("{} {}, {points} points", i + 1, measure.kind.name()),
                false => format!("{} {}: {reading}", i + 1, measure.kind.name()),
            };
            let positions = || {
                let lines = measure.points().map(|p| format!("{:.6}, {:.6}, {:.6}", p.x, p.y, p.z));
                lines.collect::<Vec<_>>().join("\n")
            };
            let row = ui.add(Button::selectable(is_open, text)).on_hover_ui(|ui| drop(ui.label(positions())));
            if row.clicked() {
                opened = Some((!is_open).then_some(i));
            }
            if ui.small_button(icons::X).on_hover_text("Remove it").clicked() {
                removed = Some(i);
            }
        });
    }
    if let Some(opened) = opened {
        viewer.ruler.open = opened;
    }
    if let Some(index) = removed {
        viewer.remove_measure(index);
    }
    unit(viewer, ui);
    placing(viewer, ui);
}

/// The unit of lengths, by one that is known.
fn unit(viewer: &mut Viewer, ui: &mut Ui) {
    let has_line = viewer.open_measure().is_some_and(|measure| !measure.lines().is_empty());
    ui.horizontal(|ui| {
        ui.label("The last line is");
        ui.add(DragValue::new(&mut viewer.ruler.known).speed(0.01).range(1e-9..=1e9));
        ui.add(TextEdit::singleline(&mut viewer.ruler.unit).desired_width(30.0));
        let hint = "All lengths are then shown in this unit";
        if ui.add_enabled(has_line, Button::new("Set")).on_hover_text(hint).clicked() {
            viewer.set_unit().unwrap_or_else(|why| viewer.messages.note(why));
        }
    });
    if let Some(unit) = &viewer.measures.unit {
        let text = format!("1 {} is {:.5} world units", unit.name, 1.0 / unit.per_world);
        ui.horizontal(|ui| {
            ui.label(text);
            if ui.small_button(icons::X).on_hover_text("Show world units again").clicked() {
                viewer.measures.unit = None;
            }
        });
    }
}

/// The buttons that place a scene by the points of the open measure.
fn placing(viewer: &mut Viewer, ui: &mut Ui) {
    let Some(measure) = viewer.open_measure() else { return };
    let (kind, points, lines) = (measure.kind, measure.points.len(), measure.lines());
    if kind == MeasureKind::Pairs {
        super::edit::placed_scene(viewer, ui);
        for (i, [a, b]) in lines.iter().enumerate() {
            ui.label(format!("pair {}: {} apart", i + 1, viewer.measures.length(a.distance(*b))));
        }
        ui.horizontal(|ui| {
            let hint = "Places the scene so that the squares of these distances are least; they are then what is left";
            if ui.add_enabled(lines.len() > 2, Button::new("Align")).on_hover_text(hint).clicked() {
                viewer.align_by_pairs();
            }
            ui.checkbox(&mut viewer.ruler.scales, "and scale");
        });
    } else if points > 2 {
        super::edit::placed_scene(viewer, ui);
        ui.horizontal(|ui| {
            let rows = [
                ("Level", false, "Turns the scene until the last three points are level"),
                ("Level and orient", true, "Also moves the first of them to the origin, the second onto the axis x"),
            ];
            for (name, orients, hint) in rows {
                if ui.button(name).on_hover_text(hint).clicked() {
                    viewer.level_by_points(orients);
                }
            }
        });
    }
}

/// Draws the measures over the picture.
pub(super) fn over_picture(viewer: &Viewer, world: &WorldPainter, ui: &Ui) {
    for (i, measure) in viewer.measures.all.iter().enumerate() {
        let colour = if viewer.ruler.open == Some(i) { MARK } else { Color32::from_gray(220) };
        measure.points().for_each(|point| world.dot(point, 3.0, colour, ""));
        measure.lines().into_iter().for_each(|line| world.line(line, Stroke::new(1.5, colour)));
        for (place, text) in viewer.measures.labels(measure) {
            if let Some(at) = world.position(place) {
                label(&painter(ui), (at, Align2::CENTER_CENTER), text);
            }
        }
    }
}
