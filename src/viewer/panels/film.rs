//! The page Path: the list of keys of the camera path, its files, and writing pictures and films.

use std::path::PathBuf;

use egui::{DragValue, ScrollArea, Stroke, TextEdit, Ui};

use super::theme::{MARK, PATH};
use super::world_painter::WorldPainter;
use crate::camera::Timeline;
use crate::viewer::model::{Action, KeyChange, Request, Viewer};

/// Greatest height of the list of keys, in points.
const LIST: f32 = 200.0;

pub(super) fn show(viewer: &mut Viewer, ui: &mut Ui) {
    ScrollArea::vertical().id_salt("keys").max_height(LIST).auto_shrink([false, true]).show(ui, |ui| keys(viewer, ui));
    files(viewer, ui);
    ui.separator();
    export(viewer, ui);
}

fn keys(viewer: &mut Viewer, ui: &mut Ui) {
    let mut change = None;
    let keys = viewer.film.timeline.keys();
    for (i, key) in keys.iter().enumerate() {
        let (low, high) = viewer.film.room_of(i);
        let high = high.unwrap_or(low.max(3600.0));
        ui.horizontal(|ui| {
            let mut seconds = key.seconds;
            let field = DragValue::new(&mut seconds).speed(0.05).range(low..=high).clamp_existing_to_range(false);
            if ui.add(field.suffix(" s")).changed() {
                change = Some(KeyChange::Move(i, seconds));
            }
            let mut rests = key.rests;
            let hint = "The motion slows down before this key, stands still, and speeds up after it";
            if ui.checkbox(&mut rests, "rest").on_hover_text(hint).changed() {
                change = Some(KeyChange::Rest(i, rests));
            }
            let buttons = [
                ("go", "Go to this view", KeyChange::Show(key.seconds)),
                ("set", "Replace it by the view that is shown", KeyChange::Replace(key.seconds)),
                ("x", "Remove it", KeyChange::Remove(i)),
            ];
            for (name, hint, wanted) in buttons {
                if ui.small_button(name).on_hover_text(hint).clicked() {
                    change = Some(wanted);
                }
            }
        });
    }
    if let Some(change) = change {
        viewer.change_key(change);
    }
}

fn files(viewer: &mut Viewer, ui: &mut Ui) {
    ui.horizontal(|ui| {
        ui.add(TextEdit::singleline(&mut viewer.film.file).desired_width(110.0));
        let path = PathBuf::from(&viewer.film.file);
        if ui.button("Save path").clicked() {
            match viewer.film.timeline.write(&path) {
                Ok(()) => viewer.messages.note(format!("{} written", path.display())),
                Err(problem) => viewer.messages.error(format!("{problem:#}")),
            }
        }
        if ui.button("Load path").on_hover_text("Also any cameras.json, a second for each camera").clicked() {
            match Timeline::read(&path) {
                Ok(timeline) => viewer.film.timeline = timeline,
                Err(problem) => viewer.messages.error(format!("{}: {problem:#}", path.display())),
            }
        }
    });
}

fn export(viewer: &mut Viewer, ui: &mut Ui) {
    let window = viewer.view.size;
    let export = &mut viewer.export;
    ui.horizontal(|ui| {
        let mut is_own = export.size.is_some();
        if ui.checkbox(&mut is_own, "other size than shown").changed() {
            export.size = is_own.then_some(window);
        }
        if let Some([width, height]) = &mut export.size {
            ui.add(DragValue::new(width).range(1..=16384));
            ui.add(DragValue::new(height).range(1..=16384));
        }
    });
    ui.horizontal(|ui| {
        ui.add(TextEdit::singleline(&mut export.picture).desired_width(150.0));
        let key = viewer.setup.bindings.text(Action::Screenshot);
        if ui.button("Write picture").on_hover_text(key).clicked() {
            viewer.requests.push(Request::WritePicture(None));
        }
        let key = viewer.setup.bindings.text(Action::CopyPicture);
        if ui.button("Copy it").on_hover_text(format!("To the clipboard, as it is seen ({key})")).clicked() {
            viewer.requests.push(Request::CopyPicture);
        }
    });
    let export = &mut viewer.export;
    if export.picture.to_ascii_lowercase().ends_with(".exr") {
        let hint = "Channels A and Z beside the colours: the coverage, and the mean depth of what a pixel shows";
        ui.checkbox(&mut export.has_layers, "with coverage and depth").on_hover_text(hint);
    }
    ui.horizontal(|ui| {
        let hint = "A folder for numbered pictures, or a video: a name that ends in .mp4, .mkv, .mov or .webm";
        ui.add(TextEdit::singleline(&mut export.film).desired_width(90.0)).on_hover_text(hint);
        ui.add(DragValue::new(&mut viewer.film.fps).speed(0.1).range(1.0..=240.0).suffix(" fps"));
        if ui.button("Write film").clicked() {
            viewer.requests.push(Request::WriteFilm(None));
        }
    });
    let Some(fraction) = export.progress else { return };
    ui.horizontal(|ui| {
        ui.add(egui::ProgressBar::new(fraction as f32).desired_width(150.0).show_percentage());
        if ui.button("Cancel").on_hover_text("Pictures that are written stay").clicked() {
            export.cancel.cancel();
        }
    });
}

/// Draws the path over the picture: its curve, its keys, and the position at the current time.
pub(super) fn curve(viewer: &Viewer, world: &WorldPainter) {
    let keys = viewer.film.timeline.keys();
    let [colour, at] = [PATH, MARK];
    let steps = (CURVE_STEPS * keys.len()).min(LARGEST_CURVE);
    let (begin, end) = (keys.first().map_or(0.0, |key| key.seconds), viewer.film.end());
    let time = |i: usize| begin + (end - begin) * i as f64 / steps.max(1) as f64;
    let place = |seconds: f64| viewer.film.timeline.at(seconds).map(|camera| camera.position);
    let places: Vec<_> = (0..=steps).filter_map(|i| place(time(i))).collect();
    for ends in places.windows(2) {
        world.line([ends[0], ends[1]], Stroke::new(1.5, colour));
    }
    for (i, key) in keys.iter().enumerate() {
        world.dot(key.camera.position, 3.0, colour, &i.to_string());
    }
    if let Some(now) = place(viewer.film.now) {
        world.dot(now, 4.0, at, "");
    }
}

/// Segments of the curve per key, and most segments.
const CURVE_STEPS: usize = 16;
const LARGEST_CURVE: usize = 2000;
