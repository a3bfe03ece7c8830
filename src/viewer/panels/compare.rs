//! The page Compare: the second picture, the way to show both, and the numbers of their difference.

use egui::{DragValue, Grid, Response, Slider, Ui};

use super::quality::preset_buttons;
use crate::options::Options;
use crate::viewer::model::{Action, CompareMode, CompareTarget, Comparison, Pair, PairDifference, PictureOf, Viewer};

pub(super) fn show(viewer: &mut Viewer, pair: &Pair, ui: &mut Ui) {
    ui.horizontal_wrapped(|ui| {
        let comparison = &mut viewer.comparison;
        button(ui, comparison, "nothing", CompareTarget::Nothing);
        button(ui, comparison, "other scenes", CompareTarget::Options(None))
            .on_hover_text("each picture then has scenes of its own");
        let is_chosen = |preset: &Options| comparison.target == CompareTarget::Options(Some(*preset));
        if let Some(preset) = preset_buttons(ui, is_chosen) {
            comparison.choose(CompareTarget::Options(Some(preset)));
        }
        if comparison.picture.as_ref().is_some_and(|picture| matches!(picture.of, PictureOf::File(_))) {
            button(ui, comparison, "picture", CompareTarget::Picture);
        }
        let follows = comparison.target == CompareTarget::Picture && comparison.photograph_camera().is_some();
        let hint = "Each camera is compared with its own photograph, also the next ones";
        if viewer.cameras.photographs.is_some()
            && ui.selectable_label(follows, "photographs").on_hover_text(hint).clicked()
        {
            viewer.compare_with_photographs();
        }
    });
    let layers = &viewer.scenes.layers;
    let has_sets = layers.len() > 1 || layers.iter().any(|layer| layer.is_shown[0] != layer.is_shown[1]);
    if matches!(viewer.comparison.target, CompareTarget::Options(_)) && has_sets {
        Grid::new("sets").num_columns(3).show(ui, |ui| {
            for title in ["first", "second"] {
                ui.weak(title);
            }
            ui.end_row();
            for layer in &mut viewer.scenes.layers {
                for is_shown in &mut layer.is_shown {
                    ui.checkbox(is_shown, "");
                }
                ui.label(&layer.name);
                ui.end_row();
            }
        });
    }
    let comparison = &mut viewer.comparison;
    let is_loading = comparison.requests_under_way > 0;
    ui.horizontal(|ui| {
        if ui.add_enabled(!is_loading, egui::Button::new("Draw the float64 reference")).clicked() {
            viewer.compare_with_reference();
        }
        if is_loading {
            ui.spinner();
        }
    });
    let flicker_key = viewer.setup.bindings.text(Action::Flicker);
    let comparison = &mut viewer.comparison;
    if viewer.cameras.photographs.is_none() {
        ui.label("To compare with photographs, drop them or their folder on the window.");
    }
    ui.horizontal(|ui| {
        ui.selectable_value(&mut comparison.mode, CompareMode::Split, "split");
        ui.selectable_value(&mut comparison.mode, CompareMode::Flicker, "flicker");
        ui.selectable_value(&mut comparison.mode, CompareMode::Difference, "difference");
    });
    match comparison.mode {
        CompareMode::Split => {
            ui.add(Slider::new(&mut comparison.split, 0.0..=1.0).text("split"));
        }
        CompareMode::Flicker => {
            ui.horizontal(|ui| {
                ui.add(DragValue::new(&mut comparison.flicker_hz).speed(0.1).range(0.0..=10.0).suffix(" Hz"));
                ui.label(format!("automatically; or hold {flicker_key}"));
            });
        }
        CompareMode::Difference => {
            ui.add(Slider::new(&mut comparison.gain, 1.0..=1000.0).logarithmic(true).text("amplification"));
        }
    }
    numbers(viewer, pair, ui);
    super::cameras::table(viewer, ui);
}

/// A button that chooses what is compared with.
fn button(ui: &mut Ui, comparison: &mut Comparison, name: &str, target: CompareTarget) -> Response {
    let button = ui.selectable_label(comparison.target == target, name);
    if button.clicked() {
        comparison.choose(target);
    }
    button
}

/// The measured difference of the two pictures.
fn numbers(viewer: &mut Viewer, pair: &Pair, ui: &mut Ui) {
    if viewer.comparison.target == CompareTarget::Nothing {
        return;
    }
    if let Some(of) = viewer.mismatch(pair) {
        ui.separator();
        let remedy = match viewer.comparison.target {
            CompareTarget::Reference => "draw it again",
            _ => "go to its camera",
        };
        ui.label(format!("The {} is of {of}: {remedy} to compare.", viewer.second_name(pair)));
        return;
    }
    let comparison = &mut viewer.comparison;
    let now = viewer.inspector.snapshot.as_ref().map(|snapshot| (snapshot.number, comparison.area));
    ui.separator();
    ui.horizontal(|ui| {
        match comparison.area {
            Some([left, top, right, bottom]) => {
                ui.label(format!("Pixels {left}, {top} to {}, {}", right - 1, bottom - 1));
                if ui.small_button("All").on_hover_text("Compare the whole pictures (Esc)").clicked() {
                    comparison.area = None;
                }
            }
            None if viewer.inspector.snapshot.as_ref().is_some_and(|snapshot| snapshot.covered.is_some()) => {
                ui.label("Inside the photograph").on_hover_text("Rows of the view above and below it do not count");
            }
            None => drop(ui.label("The whole pictures").on_hover_text("Ctrl and a drag compare a part of them")),
        }
        if comparison.is_measuring {
            ui.spinner();
        }
    });
    let Some(PairDifference { number, area, difference }) = &comparison.pair_difference else { return };
    // While the view moves, the last numbers are shown as outdated.
    let is_old = now != Some((*number, *area));
    let infinite = |value: Option<f64>, text: &dyn Fn(f64) -> String| value.map_or_else(|| "equal".to_owned(), text);
    let rows = [
        ("PSNR", infinite(difference.psnr_db, &|db| format!("{db:.2} dB")), "of the colours, white is 1"),
        ("Largest error", format!("{:.4}", difference.max_error), "of a colour value; white is 1"),
        ("SSIM", difference.ssim.map_or_else(String::new, |ssim| format!("{ssim:.5}")), "1 for equal pictures"),
        ("FLIP", format!("{:.5}", difference.flip), "0 for equal pictures, 1 at most"),
        ("In 8 bits", format!("{:.2} % differ", 100.0 * difference.changed8), "of the colour values"),
    ];
    egui::Grid::new("apart").num_columns(2).striped(true).show(ui, |ui| {
        for (name, value, help) in rows {
            ui.label(name).on_hover_text(help);
            match is_old {
                true => ui.weak(value).on_hover_text("of the view before"),
                false => ui.monospace(value),
            };
            ui.end_row();
        }
    });
}
