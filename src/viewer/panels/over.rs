//! What is said over the picture: names of two pictures, why there is none, messages, and what a dropped file becomes.

use egui::{Align2, Area, Color32, Context, FontId, Frame, LayerId, Painter, Pos2, Rect, RichText, Stroke, Ui};
use indicatif::HumanCount;

use crate::viewer::frame::{Pair, Side};
use crate::viewer::model::{Action, CompareMode, CompareTarget, Viewer};

/// Space in points between the edge of the picture and what is said over it.
pub(super) const MARGIN: f32 = 6.0;

/// The name of the messages among what lies over the picture.
const MESSAGES: &str = "messages";

/// `free`: the part of the window that the picture has.
pub(super) fn show(viewer: &mut Viewer, pair: &Pair, free: Rect, ui: &Ui) {
    split_line(viewer, ui);
    if viewer.layers.is_empty() && !viewer.panels.are_hidden {
        begin(viewer, free, ui.ctx());
    } else if let Some(text) = waits_for(viewer, pair) {
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
    messages(viewer, ui.ctx());
    drop_hint(free, ui.ctx());
}

/// A painter between the picture and all windows.
pub(super) fn painter(ui: &Ui) -> Painter {
    ui.ctx().layer_painter(LayerId::background()).with_clip_rect(ui.clip_rect())
}

/// Writes a text that can be read over any picture, with this corner of it at a place.
pub(super) fn label(painter: &Painter, (place, corner): (Pos2, Align2), text: String) {
    let galley = painter.layout_no_wrap(text, FontId::proportional(13.0), Color32::WHITE);
    let rect = corner.anchor_size(place, galley.size());
    painter.rect_filled(rect.expand(3.0), 2.0, Color32::from_black_alpha(170));
    painter.galley(rect.min, galley, Color32::WHITE);
}

/// What the picture waits for, or why it is black.
fn waits_for(viewer: &Viewer, pair: &Pair) -> Option<String> {
    let mut parts = Vec::new();
    for layer in &viewer.layers {
        let Some(fraction) = layer.progress else { continue };
        parts.push(format!("reading {}, {:.0} %", layer.name, 100.0 * fraction));
    }
    if viewer.building[Side::First as usize] {
        let held = viewer.layers.iter().filter_map(|layer| layer.held.as_ref());
        let gaussians: usize = held.map(crate::viewer::model::Held::count).sum();
        parts.push(format!("bringing {} Gaussians to the GPU", HumanCount(gaussians as u64)));
    }
    let are_hidden = !viewer.layers.iter().any(|layer| layer.is_shown[0]);
    if parts.is_empty() && are_hidden && !viewer.layers.is_empty() && pair.first.is_none() {
        parts.push("no scene is shown: tick one in the page Scene".to_owned());
    }
    (!parts.is_empty()).then(|| parts.join("; "))
}

/// What can be done with an empty window.
fn begin(viewer: &mut Viewer, free: Rect, context: &Context) {
    let mut chosen = None;
    Area::new("begin".into()).pivot(Align2::CENTER_CENTER).fixed_pos(free.center()).show(context, |ui| {
        Frame::window(ui.style()).inner_margin(16.0).show(ui, |ui| {
            ui.set_max_width((free.width() - 60.0).clamp(120.0, 380.0));
            ui.heading("Open a scene");
            ui.label("Drop files on the window: scenes, cameras, pictures to compare with.");
            ui.horizontal_wrapped(|ui| {
                let key = viewer.setup.bindings.text(Action::OpenFile);
                if ui.button(format!("Open... ({key})")).clicked() {
                    viewer.dialog.ask();
                }
                if ui.button("A cactus").on_hover_text("a procedural scene of 200,000 Gaussians").clicked() {
                    chosen = Some("cactus:200000".into());
                }
            });
            if !viewer.kept.recent.is_empty() {
                ui.add_space(6.0);
                ui.strong("Opened lately");
                for file in &viewer.kept.recent {
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

/// A picture that could not be built can be tried again.
fn refusal(viewer: &mut Viewer, pair: &Pair, free: Rect, context: &Context) {
    if pair.first.is_some() || viewer.refused[0].is_none() || viewer.building[0] {
        return;
    }
    Area::new("refusal".into()).pivot(Align2::CENTER_CENTER).fixed_pos(free.center()).show(context, |ui| {
        Frame::popup(ui.style()).show(ui, |ui| {
            ui.label("These scenes could not be drawn.");
            if ui.button("Try again").clicked() {
                viewer.refused = [None, None];
                viewer.is_stale = true;
            }
        });
    });
}

/// Says what a file becomes that is held over the window.
fn drop_hint(free: Rect, context: &Context) {
    if context.input(|input| input.raw.hovered_files.is_empty()) {
        return;
    }
    let painter = context.layer_painter(LayerId::new(egui::Order::Foreground, "drop".into()));
    painter.rect_filled(free, 0.0, Color32::from_black_alpha(150));
    painter.rect_stroke(free.shrink(8.0), 6.0, Stroke::new(2.0, Color32::WHITE), egui::StrokeKind::Inside);
    let text = "Drop: a scene, cameras, or a picture to compare with";
    label(&painter, (free.center(), Align2::CENTER_CENTER), text.to_owned());
}

/// The messages, in the lower left corner.
fn messages(viewer: &mut Viewer, context: &Context) {
    let mut closed = None;
    Area::new(MESSAGES.into()).anchor(Align2::LEFT_BOTTOM, [12.0, -12.0]).show(context, |ui| {
        ui.set_max_width(560f32.min(context.content_rect().width() - 40.0));
        let errors = viewer.messages.shown().iter().filter(|message| message.is_error).count();
        for (place, message) in viewer.messages.shown().iter().enumerate() {
            let colour = if message.is_error { ui.visuals().error_fg_color } else { ui.visuals().strong_text_color() };
            Frame::popup(ui.style()).show(ui, |ui| {
                ui.horizontal_top(|ui| {
                    if message.is_error && ui.small_button("x").on_hover_text("close").clicked() {
                        closed = Some(place);
                    }
                    ui.add(egui::Label::new(RichText::new(&message.text).color(colour)).wrap());
                });
            });
        }
        if errors > 1 && ui.button("Close all (Esc)").clicked() {
            viewer.messages.close_errors();
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
    let painter = painter(ui);
    let left = (Pos2::new(MARGIN, MARGIN), Align2::LEFT_TOP);
    if let Some(of) = viewer.reference_of_another() {
        return label(&painter, left, format!("the float64 reference was drawn of {of}: only these options are shown"));
    }
    let [first, second] = [viewer.first_name(), viewer.second_name()];
    match comparison.mode {
        CompareMode::Split => {
            painter.vline(x, 0.0..=height, Stroke::new(1.0, Color32::WHITE));
            label(&painter, (Pos2::new(x - MARGIN, MARGIN), Align2::RIGHT_TOP), first);
            label(&painter, (Pos2::new(x + MARGIN, MARGIN), Align2::LEFT_TOP), second);
        }
        CompareMode::Flicker => label(&painter, left, format!("{first}, {second}")),
        CompareMode::Difference => {
            let text = format!("{first}, difference to {second}, amplified {} times", comparison.gain);
            label(&painter, left, text);
        }
    }
}
