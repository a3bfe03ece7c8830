//! The panels: all settings and measurements, and what is drawn over the picture.

mod cameras;
mod compare;
mod edit;
mod film;
mod guides;
mod help;
mod inside;
mod over;
mod quality;
mod readout;
mod scenes;
mod space;
mod time;
mod view;

use egui::{Panel, RichText, ScrollArea, Theme, Ui};

use crate::viewer::frame::Pair;
use crate::viewer::model::{Action, Chosen, Saved, Tab, Viewer};
use crate::viewer::window::input;
use space::Space;

/// The least width of the panels in points, and the largest part of the window that they take.
const WIDTHS: (f32, f32) = (200.0, 0.6);

/// Lays out all panels, and handles the mouse over the picture beside them.
pub fn show(viewer: &mut Viewer, pair: &Pair, ui: &mut Ui) {
    let theme = if viewer.kept.is_light { Theme::Light } else { Theme::Dark };
    if ui.ctx().theme() != theme {
        ui.ctx().set_theme(theme);
    }
    if !viewer.panels.are_hidden {
        let width = ui.available_width();
        let panel = Panel::right("panels").default_size(340.0).size_range(WIDTHS.0..=(width * WIDTHS.1).max(WIDTHS.0));
        panel.show(ui, |ui| {
            tabs(viewer, ui);
            // What is too wide scrolls, so that the panel keeps its width.
            ScrollArea::both().id_salt(viewer.kept.tab).auto_shrink(false).show(ui, |ui| page(viewer, pair, ui));
        });
    }
    // Lines and labels over the picture end where the panels begin.
    let free = ui.available_rect_before_wrap();
    ui.set_clip_rect(free);
    let pixels = (free.size() * ui.ctx().pixels_per_point()).round();
    viewer.make_room(viewer.window, [pixels.x as u32, pixels.y as u32]);
    input::mouse(viewer, ui);
    over::show(viewer, pair, free, ui);
    readout::show(viewer, free, ui);
    let space = Space::new(viewer, ui);
    readout::marks(viewer, &space, ui);
    inside::frustum(viewer, &space);
    if viewer.kept.shows_cameras && !viewer.panels.are_hidden {
        cameras::over_picture(viewer, &space, ui);
    }
    guides::show(viewer, &space, free, ui);
    edit::over_picture(viewer, &space, ui);
    if !viewer.panels.are_hidden && viewer.kept.tab == Tab::Path {
        film::curve(viewer, &space);
    }
    help::show(viewer, ui.ctx());
    inside::explanation(viewer, pair, ui.ctx());
    for chosen in viewer.dialog.show(ui.ctx()) {
        match chosen {
            Chosen::Open(file) => viewer.drop_file(&file),
            Chosen::Save(Saved::Project, file) => viewer.save_project(&file),
            Chosen::Save(Saved::Scene, file) => viewer.save_scene(&file),
        }
    }
}

/// The titles of the pages, and what concerns all of them.
fn tabs(viewer: &mut Viewer, ui: &mut Ui) {
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        for (tab, title) in Tab::ALL {
            ui.selectable_value(&mut viewer.kept.tab, tab, title);
        }
        let key = viewer.setup.bindings.text(Action::Help);
        if ui.button("?").on_hover_text(format!("Mouse and keys ({key})")).clicked() {
            viewer.panels.shows_help = !viewer.panels.shows_help;
        }
        let (sign, other) = if viewer.kept.is_light { ("🌙", "dark") } else { ("☀", "light") };
        if ui.button(sign).on_hover_text(format!("Make the panels {other}")).clicked() {
            viewer.kept.is_light = !viewer.kept.is_light;
        }
    });
    ui.separator();
}

/// The sections of the page that is open.
fn page(viewer: &mut Viewer, pair: &Pair, ui: &mut Ui) {
    match viewer.kept.tab {
        Tab::Scene => {
            section(ui, "Scenes", |ui| scenes::show(viewer, pair, ui));
            section(ui, "View", |ui| view::show(viewer, ui));
            section(ui, "GPU time", |ui| time::show(viewer, pair, ui));
        }
        Tab::Quality => {
            section(ui, "Quality and speed", |ui| quality::show(viewer, pair, ui));
            section(ui, "Time by stage", |ui| time::show(viewer, pair, ui));
        }
        Tab::Inside => {
            section(ui, "Look inside", |ui| inside::show(viewer, pair, ui));
            section(ui, "Memory", |ui| time::memory(pair, ui));
        }
        Tab::Compare => section(ui, "Compare", |ui| compare::show(viewer, ui)),
        Tab::Path => section(ui, "Path and files", |ui| film::show(viewer, ui)),
        Tab::Edit => edit::show(viewer, ui),
    }
}

fn section(ui: &mut Ui, title: &str, add: impl FnOnce(&mut Ui)) {
    egui::CollapsingHeader::new(RichText::new(title).strong()).default_open(true).show(ui, add);
}
