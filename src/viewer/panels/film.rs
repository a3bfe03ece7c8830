//! The panel of paths and files: keys on a timeline, playing, and writing pictures and frames.

use std::path::PathBuf;

use egui::{DragValue, Slider, TextEdit, Ui};

use super::super::state::{Request, Viewer};
use crate::camera::Timeline;

pub(super) fn show(viewer: &mut Viewer, ui: &mut Ui) {
    ui.horizontal(|ui| {
        if ui.button("Add key").clicked() {
            viewer.add_key();
        }
        let film = &mut viewer.film;
        let text = if film.is_playing { "Stop" } else { "Play" };
        if ui.add_enabled(film.timeline.keys().len() > 1, egui::Button::new(text)).clicked() {
            film.toggle();
        }
        ui.add(DragValue::new(&mut film.step).speed(0.1).range(0.1..=60.0).suffix(" s per key"));
    });
    let end = viewer.film.end();
    if end > 0.0 {
        let mut now = viewer.film.now;
        if ui.add(Slider::new(&mut now, 0.0..=end).suffix(" s").text("time")).changed() {
            viewer.show_time(now);
        }
    }
    keys(viewer, ui);
    files(viewer, ui);
    ui.separator();
    export(viewer, ui);
}

/// Seconds between keys that are dragged.
const APART: f64 = 0.05;

fn keys(viewer: &mut Viewer, ui: &mut Ui) {
    let (mut removed, mut moved, mut shown) = (None, None, None);
    let keys = viewer.film.timeline.keys();
    for (i, key) in keys.iter().enumerate() {
        // Keys stay in their order, so that a key which is dragged replaces none and stays under the pointer.
        let low = if i == 0 { 0.0 } else { keys[i - 1].seconds + APART };
        let high = keys.get(i + 1).map_or(3600.0, |next| next.seconds - APART).max(low);
        ui.horizontal(|ui| {
            let mut seconds = key.seconds;
            let field = DragValue::new(&mut seconds).speed(0.05).range(low..=high).clamp_existing_to_range(false);
            if ui.add(field.suffix(" s")).changed() {
                moved = Some((i, seconds));
            }
            if ui.small_button("go").clicked() {
                shown = Some(key.seconds);
            }
            if ui.small_button("x").clicked() {
                removed = Some(i);
            }
        });
    }
    if let Some((i, seconds)) = moved
        && let Err(problem) = viewer.film.timeline.retime(i, seconds)
    {
        viewer.messages.note(format!("{problem:#}"));
    }
    if let Some(i) = removed {
        viewer.film.timeline.remove(i);
    }
    if let Some(seconds) = shown {
        viewer.show_time(seconds);
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
        if ui.button("Load path").clicked() {
            match Timeline::read(&path) {
                Ok(timeline) => viewer.film.timeline = timeline,
                Err(problem) => viewer.messages.error(format!("{}: {problem:#}", path.display())),
            }
        }
    });
}

fn export(viewer: &mut Viewer, ui: &mut Ui) {
    let window = viewer.size;
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
        if ui.button("Write picture").clicked() {
            viewer.requests.push(Request::WritePicture);
        }
    });
    let export = &mut viewer.export;
    ui.horizontal(|ui| {
        ui.add(TextEdit::singleline(&mut export.folder).desired_width(90.0));
        ui.add(DragValue::new(&mut viewer.film.fps).range(1.0..=240.0).suffix(" fps"));
        if ui.button("Write frames").clicked() {
            viewer.requests.push(Request::WriteFilm);
        }
    });
    if let Some(fraction) = export.progress {
        ui.add(egui::ProgressBar::new(fraction as f32).show_percentage());
    }
}
