//! Every knob of accuracy and speed, what it costs in this view, presets, and the error budget.

use egui::{ComboBox, DragValue, Grid, Ui};

use super::super::measuring::{ALL, Cost};
use super::super::screen::Pair;
use super::super::state::{Viewer, Wish};
use crate::options::{Options, Storage};
use crate::rules::{Footprint, Order, Rules};
use crate::scene::MAX_SH_DEGREE;

pub(super) fn show(viewer: &mut Viewer, pair: &Pair, ui: &mut Ui) {
    presets(viewer, ui);
    let costs = viewer.costs.clone();
    let cost = |knob: &str| costs.as_ref().and_then(|costs| costs.knobs.iter().find(|cost| cost.knob == knob));
    let exact_ms = costs.as_ref().map(|costs| costs.exact_ms);
    let Options { rules, stop, key_bits, sh_degree, sh_storage, shape_storage, scale, portable } =
        &mut viewer.options;
    Grid::new("knobs").num_columns(3).striped(true).show(ui, |ui| {
        let row = |name: &str, ui: &mut Ui, add: &mut dyn FnMut(&mut Ui)| {
            ui.label(name);
            add(ui);
            ui.label(cost(name).map_or_else(String::new, |cost| said(cost, exact_ms)));
            ui.end_row();
        };
        row("stop", ui, &mut |ui| fraction(ui, stop, 0.0..=1.0));
        row("alpha-min", ui, &mut |ui| fraction(ui, &mut rules.alpha_min, 1e-6..=1.0));
        row("key-bits", ui, &mut |ui| drop(ui.add(DragValue::new(key_bits).range(8..=32))));
        row("sh-degree", ui, &mut |ui| drop(ui.add(egui::Slider::new(sh_degree, 0..=MAX_SH_DEGREE))));
        row("sh-storage", ui, &mut |ui| choice(ui, "sh", sh_storage, &STORAGES));
        row("shape-storage", ui, &mut |ui| choice(ui, "shape", shape_storage, &STORAGES));
        row("scale", ui, &mut |ui| drop(ui.add(DragValue::new(scale).speed(0.01).range(0.05..=1.0))));
        row("portable", ui, &mut |ui| drop(ui.checkbox(portable, "")));
        let extents = [Footprint::Exact, Footprint::ThreeSigma, Footprint::ThreeSigmaSquares];
        row("extent", ui, &mut |ui| choice(ui, "extent", &mut rules.extent, &extents));
        row("order", ui, &mut |ui| choice(ui, "order", &mut rules.order, &[Order::Depth, Order::Distance]));
        row("antialiased", ui, &mut |ui| drop(ui.checkbox(&mut rules.antialiased, "")));
        row(ALL, ui, &mut |ui| drop(ui.label("")));
    });
    ui.horizontal(|ui| {
        let measure = egui::Button::new("Measure what they cost here");
        if ui.add_enabled(!viewer.is_measuring && pair.first.is_some(), measure).clicked() {
            viewer.wishes.push(Wish::Measure);
        }
        if viewer.is_measuring {
            ui.spinner();
        }
    });
    if let Some(ms) = exact_ms {
        ui.label(format!("GPU time of the exact frame {ms:.3} ms; each knob alone, dB to the exact picture"));
    }
    budget(viewer, pair, ui);
}

const STORAGES: [Storage; 4] = [Storage::Lossless, Storage::F32, Storage::F16, Storage::U8];

/// Time before and after, and how far the picture is from the exact one.
fn said(cost: &Cost, exact_ms: Option<f64>) -> String {
    let saved = cost.ms - exact_ms.unwrap_or(cost.ms);
    let psnr = if cost.psnr.is_finite() { format!("{:.1} dB", cost.psnr) } else { "equal".to_owned() };
    format!("{:.3} ms ({saved:+.3}), {psnr}", cost.ms)
}

/// A threshold that one thinks of as one part of many.
fn fraction(ui: &mut Ui, value: &mut f32, range: std::ops::RangeInclusive<f32>) {
    let formatted = |v: f64, _: std::ops::RangeInclusive<usize>| match v {
        v if v <= 0.0 => "0".to_owned(),
        v if v > 0.5 => format!("{v:.3}"),
        v => format!("1/{:.0}", 1.0 / v),
    };
    let parsed = |text: &str| match text.split_once('/') {
        Some((a, b)) => Some(a.trim().parse::<f64>().ok()? / b.trim().parse::<f64>().ok()?),
        None => text.trim().parse().ok(),
    };
    let speed = f64::from(value.max(1e-4)) * 0.02;
    ui.add(DragValue::new(value).range(range).speed(speed).custom_formatter(formatted).custom_parser(parsed));
}

fn choice<T: Copy + PartialEq + std::fmt::Debug>(ui: &mut Ui, id: &str, value: &mut T, all: &[T]) {
    ComboBox::from_id_salt(id).width(80.0).selected_text(format!("{value:?}")).show_ui(ui, |ui| {
        for one in all {
            ui.selectable_value(value, *one, format!("{one:?}"));
        }
    });
}

fn presets(viewer: &mut Viewer, ui: &mut Ui) {
    let options = &mut viewer.options;
    // What a preset does not say: the scene's own near plane and antialiasing.
    let of = |preset: &Options, options: &Options| {
        let Rules { near, antialiased, .. } = options.rules;
        Options { rules: Rules { near: preset.rules.near.min(near), antialiased, ..preset.rules }, ..*preset }
    };
    ui.horizontal_wrapped(|ui| {
        for (name, preset) in &Options::PRESETS {
            let wanted = of(preset, options);
            if ui.selectable_label(*options == wanted, *name).clicked() {
                *options = wanted;
            }
        }
    });
}

fn budget(viewer: &mut Viewer, pair: &Pair, ui: &mut Ui) {
    ui.horizontal(|ui| {
        let budget = &mut viewer.budget;
        ui.label("budget:");
        ui.selectable_value(&mut budget.is_psnr, false, "error");
        ui.selectable_value(&mut budget.is_psnr, true, "dB");
        match budget.is_psnr {
            true => ui.add(DragValue::new(&mut budget.min_psnr).range(20.0..=120.0)),
            false => ui.add(DragValue::new(&mut budget.max_error).speed(0.001).range(1e-5..=1.0)),
        };
        let button = egui::Button::new("Choose");
        if ui.add_enabled(!budget.is_choosing && pair.first.is_some(), button).clicked() {
            viewer.wishes.push(Wish::Choose);
        }
        if viewer.budget.is_choosing {
            ui.spinner();
        }
    });
}
