//! The panels, the input, and everything drawn over the picture.
//!
//! - `input` - mouse, keys and dropped files
//! - `scenes`, `view`, `gpu_time` - the page Scene
//! - `quality` - the page Quality: presets, knobs, error budget
//! - `inspection`, `measures` - the page Inside: view modes, and the explanation of a pixel; points that measure
//! - `compare`, `cameras` - the page Compare, cameras over the picture, and the table of photographs
//! - `film`, `timeline` - the page Path: the list of keys, and files to write; the timeline under the picture
//! - `edit`, `tool_bar` - the page Edit: selections, placement; the tools beside the picture
//! - `overlay`, `readout`, `guides`, `world_painter` - labels and messages, numbers, axes and grid, lines in world
//!   space
//! - `help` - the help window

mod cameras;
mod compare;
mod edit;
mod film;
mod gpu_time;
mod guides;
mod help;
mod input;
mod inspection;
mod measures;
mod overlay;
mod quality;
mod readout;
mod scenes;
pub(crate) mod theme;
mod timeline;
mod tool_bar;
mod view;
mod world_painter;

use egui::{Button, Panel, RichText, ScrollArea, Theme, Ui};
use egui_phosphor::regular as icons;

use crate::viewer::model::{Action, DialogResult, Pair, SaveTarget, Tab, Viewer};
pub(crate) use input::handle as handle_input;
use world_painter::WorldPainter;

/// Least width of the panels in points, and their largest fraction of the window.
const WIDTHS: (f32, f32) = (200.0, 0.6);

/// Least width of a window in points that shows two pages beside each other.
const WIDE: f32 = 1100.0;

/// Lays out all panels, and handles the events of [`handle_input`] for the picture beside them.
pub fn show(viewer: &mut Viewer, pair: &Pair, ui: &mut Ui, events: Vec<egui::Event>) {
    let theme = if viewer.panels.recent.is_light { Theme::Light } else { Theme::Dark };
    if ui.ctx().theme() != theme {
        ui.ctx().set_theme(theme);
    }
    columns(viewer, pair, ui);
    // Lines and labels over the picture are clipped at the panels.
    let free = ui.available_rect_before_wrap();
    ui.set_clip_rect(free);
    let pixels = (free.size() * ui.ctx().pixels_per_point()).round();
    viewer.pictures.are_stale |= viewer.view.set_sizes(viewer.view.window_size, [pixels.x as u32, pixels.y as u32]);
    input::handle_events(viewer, ui, free, events);
    if viewer.panels.are_elsewhere {
        return;
    }
    overlay::show(viewer, pair, free, ui);
    readout::show(viewer, pair, free, ui);
    let world = WorldPainter::new(viewer, ui);
    let depths = viewer.inspector.depths.clone();
    guides::show(viewer, &WorldPainter::new(viewer, ui).behind(depths.as_ref()), free, ui);
    measures::over_picture(viewer, &world, ui);
    inspection::frustum(viewer, &world);
    if viewer.panels.recent.shows_cameras && !viewer.panels.are_hidden {
        cameras::over_picture(viewer, &world, ui);
    }
    edit::over_picture(viewer, &world, ui);
    tool_bar::show(viewer, free, ui);
    if viewer.panels.shows(Tab::Path) {
        film::curve(viewer, &world.behind(depths.as_ref()));
    }
    help::show(viewer, ui.ctx());
    inspection::over_picture(viewer, pair, free, ui.ctx());
    for chosen in viewer.panels.dialog.show(ui.ctx()) {
        match chosen {
            DialogResult::Open(file) => viewer.drop_file(&file),
            DialogResult::Save(SaveTarget::Project, file) => viewer.save_project(&file),
            DialogResult::Save(SaveTarget::Scene, file) => viewer.save_scene(&file),
        }
    }
}

/// The panels beside the picture and under it.
fn columns(viewer: &mut Viewer, pair: &Pair, ui: &mut Ui) {
    if !viewer.panels.are_hidden {
        let width = ui.available_width();
        viewer.panels.is_wide = width >= WIDE;
        let panel = Panel::right("panels").default_size(372.0).size_range(WIDTHS.0..=(width * WIDTHS.1).max(WIDTHS.0));
        panel.show(ui, |ui| {
            tabs(viewer, ui);
            overlay::docked_errors(viewer, ui);
            inspection::docked(viewer, pair, ui);
            page(viewer, pair, viewer.panels.recent.tab, ui);
        });
        if let Some(tab) = viewer.panels.beside() {
            let panel = Panel::right("beside").default_size(300.0).size_range(WIDTHS.0..=0.3 * width);
            panel.show(ui, |ui| beside(viewer, pair, tab, ui));
        }
        if viewer.panels.shows(Tab::Path) {
            timeline::show(viewer, ui);
        }
    }
}

/// The titles of the pages, help, and the theme.
fn tabs(viewer: &mut Viewer, ui: &mut Ui) {
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        let beside = viewer.panels.beside();
        for (tab, title) in Tab::ALL.into_iter().filter(|(tab, _)| Some(*tab) != beside) {
            ui.selectable_value(&mut viewer.panels.recent.tab, tab, title);
        }
        let hint = "Keep this page open beside the others, in a window that is wide enough";
        let can = viewer.panels.is_wide && beside.is_none();
        if ui.add_enabled(can, Button::new(icons::COLUMNS)).on_hover_text(hint).on_disabled_hover_text(hint).clicked() {
            viewer.panels.recent.keep_beside();
        }
        let key = viewer.setup.bindings.text(Action::Help);
        if ui.button("?").on_hover_text(format!("Mouse and keys ({key})")).clicked() {
            viewer.panels.shows_help = !viewer.panels.shows_help;
        }
        let (sign, other) = if viewer.panels.recent.is_light { ("🌙", "dark") } else { ("☀", "light") };
        if ui.button(sign).on_hover_text(format!("Make the panels {other}")).clicked() {
            viewer.panels.recent.is_light = !viewer.panels.recent.is_light;
        }
    });
    speed(viewer, ui);
    ui.separator();
}

/// The GPU time of a frame, and the frames a second of the last motion.
fn speed(viewer: &mut Viewer, ui: &mut Ui) {
    viewer.timing.frame_times.summarize();
    // The line is there before the first frame, so that nothing jumps.
    let Some(ms) = viewer.timing.frame_times.digest().map(|digest| digest.whole.median) else {
        return drop(ui.weak("no frame yet"));
    };
    let rate = viewer.timing.pace.frames_per_second().map_or_else(String::new, |fps| format!(", {fps:.0} fps"));
    let digits = if ms < 100.0 { 2 } else { 0 };
    ui.weak(format!("{ms:.digits$} ms{rate}"))
        .on_hover_text("The median GPU time of the last frames, and the frames a second of the last motion");
}

/// The page that is kept open beside the others.
fn beside(viewer: &mut Viewer, pair: &Pair, tab: Tab, ui: &mut Ui) {
    ui.horizontal(|ui| {
        ui.strong(tab.title());
        if ui.button(icons::X).on_hover_text("Put this page back among the others").clicked() {
            viewer.panels.recent.beside = None;
        }
    });
    ui.separator();
    page(viewer, pair, tab, ui);
}

/// A page. Wide contents scroll, so that the panel keeps its width.
fn page(viewer: &mut Viewer, pair: &Pair, tab: Tab, ui: &mut Ui) {
    let area = ScrollArea::both().id_salt(tab).auto_shrink(false);
    area.show(ui, |ui| sections(viewer, pair, tab, ui));
}

fn sections(viewer: &mut Viewer, pair: &Pair, tab: Tab, ui: &mut Ui) {
    match tab {
        Tab::Scene => {
            section(viewer, ui, "Scenes", |viewer, ui| scenes::show(viewer, pair, ui));
            section(viewer, ui, "View", view::show);
            section(viewer, ui, "GPU time", |viewer, ui| gpu_time::show(viewer, pair, ui));
        }
        Tab::Quality => section(viewer, ui, "Quality and speed", |viewer, ui| quality::show(viewer, pair, ui)),
        Tab::Inside => {
            section(viewer, ui, "View mode", |viewer, ui| inspection::show(viewer, pair, ui));
            section(viewer, ui, "Measure", measures::show);
            section(viewer, ui, "Memory", |_, ui| gpu_time::memory(pair, ui));
        }
        Tab::Compare => section(viewer, ui, "Compare", |viewer, ui| compare::show(viewer, pair, ui)),
        Tab::Path => section(viewer, ui, "Path and files", film::show),
        Tab::Edit => edit::show(viewer, ui),
    }
}

/// A section that can be closed. The next window has it as it was left.
fn section(viewer: &mut Viewer, ui: &mut Ui, title: &str, add: impl FnOnce(&mut Viewer, &mut Ui)) {
    let is_open = !viewer.panels.recent.closed.contains(title);
    let header = egui::CollapsingHeader::new(RichText::new(title).strong()).default_open(is_open);
    let response = header.show(ui, |ui| add(viewer, ui)).header_response;
    if response.clicked() {
        match is_open {
            true => drop(viewer.panels.recent.closed.insert(title.to_owned())),
            false => drop(viewer.panels.recent.closed.remove(title)),
        }
    }
}
