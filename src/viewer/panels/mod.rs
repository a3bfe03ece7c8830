//! The panels: all settings and measurements, and what is drawn over the picture.

mod compare;
mod film;
mod help;
mod inside;
mod quality;
mod scenes;
mod time;
mod view;

use egui::{Align2, Color32, Context, Frame, Panel, RichText, ScrollArea, Stroke, Ui};

use super::comparison::{CompareMode, CompareTarget};
use super::input;
use super::screen::Pair;
use super::state::Viewer;

/// Lays out all panels, and handles the mouse over the picture behind them.
pub fn show(viewer: &mut Viewer, pair: &Pair, ui: &mut Ui) {
    if !viewer.panels.are_hidden {
        Panel::right("panels").default_size(320.0).show(ui, |ui| {
            ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
                section(ui, "Scenes", true, |ui| scenes::show(viewer, pair, ui));
                section(ui, "View", true, |ui| view::show(viewer, ui));
                section(ui, "Time", true, |ui| time::show(viewer, pair, ui));
                section(ui, "Look inside", true, |ui| inside::show(viewer, pair, ui));
                section(ui, "Quality and speed", true, |ui| quality::show(viewer, pair, ui));
                section(ui, "Compare", false, |ui| compare::show(viewer, ui));
                section(ui, "Path and files", false, |ui| film::show(viewer, ui));
                section(ui, "Memory", false, |ui| time::memory(pair, ui));
            });
        });
    }
    // Lines and labels over the picture end where the panels begin.
    ui.set_clip_rect(ui.available_rect_before_wrap());
    input::mouse(viewer, ui);
    split_line(viewer, ui);
    inside::frustum(viewer, ui);
    messages(viewer, ui.ctx());
    help::show(viewer, ui.ctx());
    inside::explanation(viewer, pair, ui.ctx());
}

fn section(ui: &mut Ui, title: &str, is_open: bool, add: impl FnOnce(&mut Ui)) {
    egui::CollapsingHeader::new(RichText::new(title).strong()).default_open(is_open).show(ui, add);
}

/// The messages, in the lower left corner.
fn messages(viewer: &mut Viewer, context: &Context) {
    let mut closed = None;
    egui::Area::new("messages".into()).anchor(Align2::LEFT_BOTTOM, [12.0, -12.0]).show(context, |ui| {
        ui.set_max_width(560f32.min(context.content_rect().width() - 40.0));
        for (place, message) in viewer.messages.shown().iter().enumerate() {
            let colour = if message.is_error { Color32::from_rgb(255, 120, 100) } else { Color32::LIGHT_GRAY };
            Frame::popup(ui.style()).show(ui, |ui| {
                ui.horizontal_wrapped(|ui| {
                    if message.is_error && ui.small_button("x").clicked() {
                        closed = Some(place);
                    }
                    ui.label(RichText::new(&message.text).color(colour));
                });
            });
        }
    });
    if let Some(place) = closed {
        viewer.messages.close(place);
    }
}

/// The line between two pictures, and their names.
fn split_line(viewer: &Viewer, ui: &Ui) {
    let comparison = &viewer.comparison;
    if viewer.panels.are_hidden || comparison.target == CompareTarget::Nothing {
        return;
    }
    let points = ui.ctx().pixels_per_point();
    let [width, height] = viewer.size.map(|side| side as f32 / points);
    let x = comparison.split * width;
    let painter = ui.ctx().layer_painter(egui::LayerId::background()).with_clip_rect(ui.clip_rect());
    let reference_of_another = viewer.reference_of_another();
    if comparison.mode == CompareMode::Split && reference_of_another.is_none() {
        painter.vline(x, 0.0..=height, Stroke::new(1.0, Color32::WHITE));
    }
    let label = |text: String, left: Option<f32>| {
        let galley = painter.layout_no_wrap(text, egui::FontId::proportional(13.0), Color32::WHITE);
        let at = egui::pos2(left.unwrap_or(x - 6.0 - galley.size().x), 6.0);
        let back = egui::Rect::from_min_size(at, galley.size()).expand(3.0);
        painter.rect_filled(back, 2.0, Color32::from_black_alpha(150));
        painter.galley(at, galley, Color32::WHITE);
    };
    if let Some(of) = reference_of_another {
        return label(format!("the float64 reference was drawn of {of}: only these options are shown"), Some(6.0));
    }
    let [first, second] = [compare::first_name(viewer), compare::second_name(viewer)];
    match comparison.mode {
        CompareMode::Split => {
            label(first, None);
            label(second, Some(x + 6.0));
        }
        CompareMode::Flicker => label(format!("{first}, {second}"), Some(6.0)),
        CompareMode::Difference => {
            label(format!("{first}, difference to {second}, amplified {} times", comparison.gain), Some(6.0));
        }
    }
}
