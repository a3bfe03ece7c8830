//! Labels over the picture: names of two pictures, progress, messages, the start page, and the hint for dropped files.

use egui::{
    Align2, Area, Color32, Context, FontId, Frame, LayerId, Painter, Panel, Pos2, Rect, RichText, ScrollArea, Stroke,
    Ui, Vec2,
};
use indicatif::HumanCount;

use crate::viewer::model::{Action, CompareMode, CompareTarget, LoadedScene, Pair, Side, Viewer};

/// Space between the edge of the picture and labels, in points.
pub(super) const MARGIN: f32 = 6.0;

/// The height of a row of labels, in points.
const ROW: f32 = 24.0;

/// The identifier of the area of messages.
const MESSAGES: &str = "messages";

/// Draws the labels. `free` is the rectangle of the picture.
pub(super) fn show(viewer: &mut Viewer, pair: &Pair, free: Rect, ui: &Ui) {
    split_line(viewer, pair, ui);
    if viewer.scenes.layers.is_empty() && !viewer.panels.are_hidden {
        // The hint for dropped files takes the place of the card.
        if !are_files_held(ui.ctx()) {
            start_page(viewer, free, ui.ctx());
        }
    } else if let Some(text) = progress_text(viewer, pair) {
        let messages = ui.ctx().memory(|memory| memory.area_rect(MESSAGES));
        let messages = messages.filter(|_| !viewer.messages.shown().is_empty());
        let bottom = messages.map_or(free.bottom(), |messages| messages.top());
        let place = match pair.first.is_some() {
            true => (egui::pos2(free.left() + MARGIN, bottom - MARGIN), Align2::LEFT_BOTTOM),
            false => (free.center(), Align2::CENTER_CENTER),
        };
        label(&painter(ui), place, text);
    }
    refusal(viewer, pair, free, ui.ctx());
    messages(viewer, free, ui.ctx());
    drop_hint(free, ui.ctx());
}

/// A painter between the picture and all windows.
pub(super) fn painter(ui: &Ui) -> Painter {
    ui.ctx().layer_painter(LayerId::background()).with_clip_rect(ui.clip_rect())
}

/// Draws a text on a dark ground, with this corner at a position. A text at a position that is seen is seen whole.
pub(super) fn label(painter: &Painter, (place, corner): (Pos2, Align2), text: String) {
    let seen = painter.clip_rect().shrink(MARGIN);
    let galley = painter.layout(text, FontId::proportional(13.0), Color32::WHITE, seen.width().max(1.0));
    let mut rect = corner.anchor_size(place, galley.size());
    if painter.clip_rect().contains(place) {
        let inside = rect.min + (seen.max - rect.max).min(Vec2::ZERO);
        // The beginning is seen of what is larger than the picture.
        rect = rect.translate(inside.max(seen.min) - rect.min);
    }
    painter.rect_filled(rect.expand(3.0), 2.0, Color32::from_black_alpha(170));
    painter.galley(rect.min, galley, Color32::WHITE);
}

/// A text about running reads and builds, or the reason why the picture is black.
fn progress_text(viewer: &Viewer, pair: &Pair) -> Option<String> {
    let mut parts = Vec::new();
    for layer in &viewer.scenes.layers {
        let Some(fraction) = layer.progress else { continue };
        parts.push(format!("reading {}, {:.0} %", layer.name, 100.0 * fraction));
    }
    if viewer.pictures.building[Side::First as usize].is_some() {
        let scenes = viewer.scenes.layers.iter().filter_map(|layer| layer.scene.as_ref());
        let gaussians: usize = scenes.map(LoadedScene::count).sum();
        parts.push(format!("bringing {} Gaussians to the GPU", HumanCount(gaussians as u64)));
    }
    if parts.is_empty() {
        parts.extend(viewer.why_nothing_is_seen(pair));
    }
    (!parts.is_empty()).then(|| parts.join("; "))
}

/// The start page of a window without scenes.
fn start_page(viewer: &mut Viewer, free: Rect, context: &Context) {
    let mut chosen = None;
    Area::new("begin".into()).pivot(Align2::CENTER_CENTER).fixed_pos(free.center()).show(context, |ui| {
        Frame::window(ui.style()).inner_margin(16.0).show(ui, |ui| {
            ui.set_max_width((free.width() - 60.0).clamp(120.0, 380.0));
            ui.heading("Open a scene");
            ui.label("Drop files on the window: scenes, cameras, pictures to compare with.");
            ui.horizontal_wrapped(|ui| {
                let key = viewer.setup.bindings.text(Action::OpenFile);
                if ui.button(format!("Open... ({key})")).clicked() {
                    viewer.panels.dialog.open_files();
                }
                if ui.button("A cactus").on_hover_text("a procedural scene of 200,000 Gaussians").clicked() {
                    chosen = Some("cactus:200000".into());
                }
            });
            if !viewer.panels.recent.files.is_empty() {
                ui.add_space(6.0);
                ui.strong("Opened lately");
                for file in &viewer.panels.recent.files {
                    let name = file.file_name().unwrap_or(file.as_os_str()).to_string_lossy();
                    if ui.link(name).on_hover_text(file.display().to_string()).clicked() {
                        chosen = Some(file.clone());
                    }
                }
            }
            ui.add_space(6.0);
            ui.weak(format!("{} shows what mouse and keys do.", viewer.setup.bindings.text(Action::Help)));
        });
    });
    if let Some(file) = chosen {
        viewer.drop_file(&file);
    }
}

/// The button to retry a build that failed.
fn refusal(viewer: &mut Viewer, pair: &Pair, free: Rect, context: &Context) {
    if pair.first.is_some() || viewer.pictures.refused[0].is_none() || viewer.pictures.building[0].is_some() {
        return;
    }
    Area::new("refusal".into()).pivot(Align2::CENTER_CENTER).fixed_pos(free.center()).show(context, |ui| {
        Frame::popup(ui.style()).show(ui, |ui| {
            ui.label("These scenes could not be drawn.");
            if ui.button("Try again").clicked() {
                viewer.pictures.refused = [None, None];
                viewer.pictures.are_stale = true;
            }
        });
    });
}

fn are_files_held(context: &Context) -> bool {
    context.input(|input| !input.raw.hovered_files.is_empty())
}

/// The hint for files that are held over the window.
fn drop_hint(free: Rect, context: &Context) {
    if !are_files_held(context) {
        return;
    }
    let painter = context.layer_painter(LayerId::new(egui::Order::Foreground, "drop".into()));
    painter.rect_filled(free, 0.0, Color32::from_black_alpha(150));
    painter.rect_stroke(free.shrink(8.0), 6.0, Stroke::new(2.0, Color32::WHITE), egui::StrokeKind::Inside);
    let text = "Drop: a scene, cameras, or a picture to compare with";
    label(&painter, (free.center(), Align2::CENTER_CENTER), text.to_owned());
}

/// The messages over the picture, in the lower left corner: errors have a place in the panel, if that is shown.
fn messages(viewer: &mut Viewer, free: Rect, context: &Context) {
    let shows_errors = viewer.panels.are_hidden;
    let has_errors = shows_errors && viewer.messages.shown().iter().any(|message| message.is_error);
    let corner = free.left_bottom() + Vec2::new(12.0, -12.0);
    let area = Area::new(MESSAGES.into()).pivot(Align2::LEFT_BOTTOM).fixed_pos(corner);
    // Notes go by themselves, and a click on one is meant for the picture below. Messages lie over the start page.
    let area = area.interactable(has_errors).order(egui::Order::Foreground);
    // Without this, egui would draw the first message of a session nearly transparent, until the next layout.
    area.fade_in(false).show(context, |ui| {
        ui.set_max_width(560f32.min(free.width() - 40.0));
        list(viewer, ui, |is_error| !is_error || shows_errors);
    });
}

/// The errors, at the lower edge of the panel.
pub(super) fn docked_errors(viewer: &mut Viewer, ui: &mut Ui) {
    if !viewer.messages.shown().iter().any(|message| message.is_error) {
        return;
    }
    let most = 0.5 * ui.available_height();
    Panel::bottom("errors").resizable(false).show(ui, |ui| {
        ScrollArea::vertical().max_height(most).show(ui, |ui| list(viewer, ui, |is_error| is_error));
    });
}

/// Lists messages. Errors can be closed.
fn list(viewer: &mut Viewer, ui: &mut Ui, is_listed: impl Fn(bool) -> bool) {
    let mut closed = None;
    let mut errors = 0;
    for (index, message) in viewer.messages.shown().iter().enumerate().filter(|(_, one)| is_listed(one.is_error)) {
        let colour = if message.is_error { ui.visuals().error_fg_color } else { ui.visuals().strong_text_color() };
        errors += usize::from(message.is_error);
        Frame::popup(ui.style()).show(ui, |ui| {
            ui.horizontal_top(|ui| {
                if message.is_error && ui.small_button("x").on_hover_text("close").clicked() {
                    closed = Some(index);
                }
                ui.add(egui::Label::new(RichText::new(&message.text).color(colour)).wrap());
            });
        });
    }
    if errors > 1 && ui.button("Close all (Esc)").clicked() {
        viewer.messages.close_errors();
    }
    if let Some(index) = closed {
        viewer.messages.close(index);
    }
}

/// The line between two pictures, and their names.
fn split_line(viewer: &Viewer, pair: &Pair, ui: &Ui) {
    let comparison = &viewer.comparison;
    if viewer.panels.are_hidden || comparison.target == CompareTarget::Nothing {
        return;
    }
    let points = ui.ctx().pixels_per_point();
    let [width, height] = viewer.view.size.map(|side| side as f32 / points);
    let x = comparison.split * width;
    let painter = painter(ui);
    let left = (Pos2::new(MARGIN, MARGIN), Align2::LEFT_TOP);
    if let Some(of) = viewer.mismatch(pair) {
        return label(&painter, left, format!("{} is of {of} and not shown", viewer.second_name(pair)));
    }
    let [first, second] = [viewer.first_name(pair), viewer.second_name(pair)];
    match comparison.mode {
        CompareMode::Split => {
            painter.vline(x, 0.0..=height, Stroke::new(1.0, Color32::WHITE));
            // Near an edge, where a name is moved over the line, it has a row of its own.
            let row = |is_near: bool| if is_near { MARGIN + ROW } else { MARGIN };
            let (first_row, second_row) = (row(x < 0.35 * width), row(x > 0.65 * width));
            label(&painter, (Pos2::new(x - MARGIN, first_row), Align2::RIGHT_TOP), first);
            label(&painter, (Pos2::new(x + MARGIN, second_row), Align2::LEFT_TOP), second);
        }
        CompareMode::Flicker => label(&painter, left, format!("{first}, {second}")),
        CompareMode::Difference => {
            let text = format!("{first}, difference to {second}, amplified {} times", comparison.gain);
            label(&painter, left, text);
        }
    }
}
