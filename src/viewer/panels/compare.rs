//! What the picture is held against, and how.

use egui::{DragValue, Slider, Ui};

use super::super::comparison::{Way, With};
use super::super::state::Viewer;
use crate::options::Options;
use crate::rules::Rules;

pub(super) fn show(viewer: &mut Viewer, ui: &mut Ui) {
    let comparison = &mut viewer.comparison;
    ui.horizontal_wrapped(|ui| {
        ui.selectable_value(&mut comparison.with, With::Nothing, "nothing");
        ui.selectable_value(&mut comparison.with, With::Options(None), "other scenes")
            .on_hover_text("each scene then has a second box for the second picture");
        for (name, preset) in &Options::PRESETS {
            ui.selectable_value(&mut comparison.with, With::Options(Some(*preset)), *name);
        }
        if comparison.picture.is_some() && comparison.drawn_for.is_none() {
            ui.selectable_value(&mut comparison.with, With::Picture, "photograph");
        }
    });
    let is_drawing = comparison.is_drawing;
    ui.horizontal(|ui| {
        if ui.add_enabled(!is_drawing, egui::Button::new("Draw the float64 reference")).clicked() {
            viewer.compare_with_reference();
        }
        if is_drawing {
            ui.spinner();
        }
    });
    if viewer.shows_another_view() {
        ui.label("The reference was drawn for another view: draw it anew.");
    }
    let comparison = &mut viewer.comparison;
    ui.label("A photograph: drop it on the window, and go to its camera.");
    ui.horizontal(|ui| {
        ui.selectable_value(&mut comparison.way, Way::Split, "split");
        ui.selectable_value(&mut comparison.way, Way::Flicker, "flicker");
        ui.selectable_value(&mut comparison.way, Way::Difference, "difference");
    });
    match comparison.way {
        Way::Split => {
            ui.add(Slider::new(&mut comparison.split, 0.0..=1.0).text("split"));
        }
        Way::Flicker => {
            ui.horizontal(|ui| {
                ui.add(DragValue::new(&mut comparison.flicker_hz).speed(0.1).range(0.0..=10.0).suffix(" Hz"));
                ui.label("by itself; or hold Space");
            });
        }
        Way::Difference => {
            ui.add(Slider::new(&mut comparison.gain, 1.0..=1000.0).logarithmic(true).text("times"));
        }
    }
}

/// What the first picture is called where another is beside it.
pub(super) fn first_name(viewer: &Viewer) -> String {
    let options = &viewer.options;
    let like = |preset: &Options| {
        let rules = Rules { near: options.rules.near, antialiased: options.rules.antialiased, ..preset.rules };
        Options { rules, ..*preset } == *options
    };
    let known = Options::PRESETS.iter().find(|(_, preset)| like(preset));
    known.map_or_else(|| "these options".to_owned(), |(name, _)| (*name).to_owned())
}

/// What the second picture is called.
pub(super) fn second_name(viewer: &Viewer) -> String {
    match &viewer.comparison.with {
        With::Nothing => String::new(),
        With::Options(None) => "other scenes".to_owned(),
        With::Options(Some(options)) => {
            let known = Options::PRESETS.iter().find(|(_, preset)| preset == options);
            known.map_or_else(|| "other options".to_owned(), |(name, _)| (*name).to_owned())
        }
        With::Reference | With::Picture => {
            viewer.comparison.picture.as_ref().map_or_else(String::new, |(n, _)| n.clone())
        }
    }
}
