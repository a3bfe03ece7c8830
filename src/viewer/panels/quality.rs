//! The page Quality: presets, every knob with its cost in this view, and the error budget.

use egui::{ComboBox, DragValue, Grid, ProgressBar, RichText, Ui};

use crate::options::{KNOBS, Kind, Knob, Options, Value};
use crate::rules::Rules;
use crate::viewer::jobs::{ALL_KNOBS, KnobCost};
use crate::viewer::model::{MAX_ERRORS, MIN_PSNRS, Measurement, Pair, Purpose, RateControl, Request, Viewer};

pub(super) fn show(viewer: &mut Viewer, pair: &Pair, ui: &mut Ui) {
    presets(viewer, ui);
    let has_levels = viewer.scenes.have_levels();
    let (costs, content) = viewer.measuring.costs.clone().unzip();
    let mismatch = content.flatten().and_then(|content| content.difference(&viewer.picture_content()?));
    let cost = |knob: &str| costs.as_ref().and_then(|costs| costs.knobs.iter().find(|cost| cost.knob == knob));
    let exact_ms = costs.as_ref().map(|costs| costs.exact_ms);
    let options = &mut viewer.options;
    // Costs are outdated if the picture or the value of the knob has changed.
    let is_old = |name: &str, options: &Options| {
        let measured = costs.as_ref().map(|costs| costs.options);
        let knob = KNOBS.iter().find(|knob| knob.name == name);
        mismatch.is_some()
            || measured.is_some_and(|measured| match knob {
                Some(knob) => (knob.get)(&measured) != (knob.get)(options),
                None => measured != *options,
            })
    };
    Grid::new("knobs").num_columns(2).striped(true).show(ui, |ui| {
        let mut row = |name: &str, help: &str, add: &mut dyn FnMut(&mut Ui, &mut Options)| {
            ui.label(in_words(name)).on_hover_text(help);
            // The cost is below the value, so that the panel has room for both.
            ui.vertical(|ui| {
                add(ui, options);
                if let Some(cost) = cost(name) {
                    let (brief, whole) = described(cost, exact_ms);
                    match is_old(name, options) {
                        true => ui
                            .label(RichText::new(brief).weak().strikethrough())
                            .on_hover_text("measured of other settings"),
                        false => ui.label(brief).on_hover_text(whole),
                    };
                }
            });
            ui.end_row();
        };
        // The near plane is in the view panel.
        for knob in KNOBS.iter().filter(|knob| knob.name != "near" && (has_levels || !knob.is_of_levels())) {
            let help = format!("{}\n\n--{}", knob.help, knob.name);
            row(knob.name, &help, &mut |ui, options| edit(ui, knob, options));
        }
        if exact_ms.is_some() {
            row(ALL_KNOBS, "All of these settings together", &mut |ui, _| drop(ui.label("")));
        }
    });
    ui.horizontal(|ui| {
        let measure = egui::Button::new("Measure what they cost here");
        if ui.add_enabled(viewer.measuring.running.is_none() && pair.first.is_some(), measure).clicked() {
            viewer.requests.push(Request::Measure);
        }
    });
    rate(viewer, ui);
    progress(viewer, Purpose::Costs, ui);
    if let Some(ms) = exact_ms {
        ui.label(format!("GPU time of the exact frame {ms:.3} ms; each knob alone, dB to the exact picture"));
        if let Some(of) = mismatch {
            ui.label(format!("These figures are of {of}: measure again."));
        }
    }
    budget(viewer, pair, ui);
}

/// The name of a knob in words.
fn in_words(name: &str) -> String {
    let words: Vec<&str> = name.split('-').map(|word| if word == "sh" { "SH" } else { word }).collect();
    let text = words.join(" ");
    text[..1].to_uppercase() + &text[1..]
}

/// The frame rate to keep.
fn rate(viewer: &mut Viewer, ui: &mut Ui) {
    ui.horizontal(|ui| {
        let mut keeps = viewer.timing.rate.is_some();
        let hint = "While the view moves, pictures that take too long are drawn at a lower scale, and whole again when \
                    it rests. Scenes with levels of detail have fewer nodes, also at rest. What is written has neither";
        if ui.checkbox(&mut keeps, "Keep").on_hover_text(hint).changed() {
            viewer.timing.rate = keeps.then(|| RateControl::new(60.0));
            viewer.pictures.are_stale = true;
        }
        match &mut viewer.timing.rate {
            Some(rate) => drop(ui.add(DragValue::new(&mut rate.fps).range(1.0..=1000.0))),
            None => drop(ui.label("60")),
        }
        ui.label("frames a second");
    });
}

/// A widget for the value of a knob.
fn edit(ui: &mut Ui, knob: &Knob, options: &mut Options) {
    let mut value = (knob.get)(options);
    match (&mut value, knob.kind) {
        (Value::Number(number), Kind::Number { usual: [low, high], is_fraction: true, .. }) => {
            fraction(ui, number, low..=high);
        }
        (Value::Number(number), Kind::Number { usual: [low, high], .. }) => {
            ui.add(DragValue::new(number).speed(0.01).range(low..=high));
        }
        (Value::Count(count), Kind::Count([low, high])) if high - low < 8 => {
            ui.add(egui::Slider::new(count, low..=high));
        }
        (Value::Count(count), Kind::Count([low, high])) => {
            ui.add(DragValue::new(count).range(low..=high));
        }
        (Value::Name(name), Kind::Name(names)) => {
            let is_drawable = |name: &&'static str| knob.turned(options, Value::Name(name)).undrawable().is_none();
            choice(ui, knob.name, name, names().into_iter().filter(is_drawable));
        }
        (Value::Flag(flag), Kind::Flag) => {
            ui.checkbox(flag, "");
        }
        (value, kind) => unreachable!("{}: {value:?} is of the kind {kind:?}", knob.name),
    }
    if value != (knob.get)(options) {
        (knob.set)(options, value);
    }
}

/// Change of the frame time from `exact_ms`, and PSNR to the exact picture: a short and a long text.
fn described(cost: &KnobCost, exact_ms: Option<f64>) -> (String, String) {
    let saved = cost.ms - exact_ms.unwrap_or(cost.ms);
    let psnr = if cost.psnr.is_finite() { format!("{:.1} dB", cost.psnr) } else { "equal".to_owned() };
    let whole = format!("A frame takes {:.3} ms, {saved:+.3} ms to the exact one; {psnr} to its picture", cost.ms);
    (format!("{saved:+.3} ms, {psnr}"), whole)
}

/// A widget for a threshold that is shown as a fraction, such as 1/255.
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

fn choice(ui: &mut Ui, id: &str, name: &mut &'static str, all: impl Iterator<Item = &'static str>) {
    ComboBox::from_id_salt(id).width(80.0).selected_text(*name).show_ui(ui, |ui| {
        for one in all {
            ui.selectable_value(name, one, one);
        }
    });
}

fn presets(viewer: &mut Viewer, ui: &mut Ui) {
    ui.horizontal_wrapped(|ui| {
        let is_chosen = |preset: &Options| viewer.options == viewer.preset(preset);
        if let Some(preset) = preset_buttons(ui, is_chosen) {
            viewer.options = viewer.preset(&preset);
        }
    });
}

/// A button for each preset; those with the rules of other renderers, and the portable path, are in a menu. Returns the
/// preset that was clicked.
pub(super) fn preset_buttons(ui: &mut Ui, is_chosen: impl Fn(&Options) -> bool) -> Option<Options> {
    let trained = Options::EXACT.rules;
    let has_trained_rules = |rules: Rules| Rules { alpha_min: trained.alpha_min, ..rules } == trained;
    let is_usual = |options: &Options| has_trained_rules(options.rules) && !options.portable;
    let (usual, others): (Vec<_>, Vec<_>) = Options::PRESETS.iter().partition(|(_, options)| is_usual(options));
    let mut clicked = None;
    let mut button = |ui: &mut Ui, (name, options): &(&str, Options)| {
        if ui.selectable_label(is_chosen(options), *name).clicked() {
            clicked = Some(*options);
            ui.close();
        }
    };
    usual.into_iter().for_each(|preset| button(ui, preset));
    let chosen = others.iter().find(|(_, options)| is_chosen(options));
    let title = chosen.map_or_else(|| "others ⏷".to_owned(), |(name, _)| format!("{name} ⏷"));
    let menu = ui.menu_button(title, |ui| others.into_iter().for_each(|preset| button(ui, preset)));
    menu.response.on_hover_text("The rules of other renderers, and the path that runs on every device");
    clicked
}

fn budget(viewer: &mut Viewer, pair: &Pair, ui: &mut Ui) {
    ui.horizontal(|ui| {
        let budget = &mut viewer.measuring.budget;
        ui.label("budget:");
        ui.selectable_value(&mut budget.is_psnr, false, "error");
        ui.selectable_value(&mut budget.is_psnr, true, "dB");
        match budget.is_psnr {
            true => ui.add(DragValue::new(&mut budget.min_psnr).range(MIN_PSNRS)),
            false => ui.add(DragValue::new(&mut budget.max_error).speed(0.001).range(MAX_ERRORS)),
        };
        let button = egui::Button::new("Choose");
        if ui.add_enabled(viewer.measuring.running.is_none() && pair.first.is_some(), button).clicked() {
            viewer.requests.push(Request::Choose);
        }
    });
    progress(viewer, Purpose::Choice, ui);
    if let Some(chosen) = &viewer.measuring.budget.chosen {
        ui.label(chosen);
    }
}

/// Progress of a measurement, the remaining time, and a button that cancels it.
pub(super) fn progress(viewer: &Viewer, purpose: Purpose, ui: &mut Ui) {
    let Some(measurement) = viewer.measuring.running.as_ref().filter(|work| work.purpose == purpose) else { return };
    let Measurement { fraction, since, cancel, .. } = measurement;
    let passed = since.elapsed().as_secs_f64();
    let left = if *fraction > 0.0 { format!(", {:.0} s left", passed / fraction - passed) } else { String::new() };
    ui.horizontal(|ui| {
        let is_cancelled = cancel.is_cancelled();
        let text = if is_cancelled { "ending".to_owned() } else { format!("{:.0} %{left}", fraction * 100.0) };
        ui.add(ProgressBar::new(*fraction as f32).desired_width(200.0).text(text));
        if ui.add_enabled(!is_cancelled, egui::Button::new("Cancel")).clicked() {
            cancel.cancel();
        }
    });
}
