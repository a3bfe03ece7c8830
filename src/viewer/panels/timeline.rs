//! The timeline under the picture: the keys of the camera path, the speed of the camera, and the current time.

use egui::{Align2, Button, DragValue, FontId, Panel, Pos2, Rect, RichText, Sense, Shape, Stroke, Ui, pos2, vec2};
use egui_phosphor::regular as icons;

use crate::viewer::model::{Action, KeyChange, Request, Viewer};

/// Height of the track in points.
const TRACK: f32 = 40.0;
/// Half the diagonal of the mark of a key, in points.
const KEY: f32 = 6.0;
/// Least distance of the marks of the ruler, in points.
const TICK: f32 = 56.0;
/// Segments of the curve of the speed.
const PARTS: usize = 160;
/// Most keys that can be dragged; the page Path lists all.
const DRAGGED: usize = 200;
/// Shows the timeline at the lower edge of what is left of the window.
pub(super) fn show(viewer: &mut Viewer, ui: &mut Ui) {
    Panel::bottom("timeline").resizable(false).show(ui, |ui| {
        ui.horizontal_wrapped(|ui| buttons(viewer, ui));
        track(viewer, ui);
    });
}

fn icon(ui: &mut Ui, is_possible: bool, icon: &str, hint: &str) -> bool {
    ui.add_enabled(is_possible, Button::new(RichText::new(icon).size(16.0))).on_hover_text(hint).clicked()
}

fn buttons(viewer: &mut Viewer, ui: &mut Ui) {
    let key = |viewer: &Viewer, action| viewer.setup.bindings.text(action);
    let keys = viewer.film.timeline.keys().len();
    if icon(ui, true, icons::PLUS, &format!("Add the view after the last key ({})", key(viewer, Action::AddKey))) {
        viewer.add_key();
    }
    let hint = "Insert the view at the time that is shown: between two keys, or in place of the one that is there";
    if icon(ui, keys > 0, icons::ARROW_LINE_DOWN, hint) {
        viewer.insert_key(viewer.film.now);
    }
    let is_open = keys > 1 && !viewer.film.timeline.is_closed();
    if icon(ui, is_open, icons::LINK, "Close: the path ends at its first view, and plays again and again") {
        viewer.close_path().unwrap_or_else(|why| viewer.messages.note(why));
    }
    if icon(ui, true, icons::ARROWS_CLOCKWISE, "Turn: a path once around the pivot, from this view back to it") {
        viewer.turn_path();
    }
    ui.separator();
    let (sign, verb) = if viewer.film.is_playing { (icons::STOP, "Stop") } else { (icons::PLAY, "Play") };
    if icon(ui, keys > 1, sign, &format!("{verb} ({})", key(viewer, Action::Play))) {
        viewer.film.toggle();
    }
    let repeat = Button::selectable(viewer.film.repeats, RichText::new(icons::REPEAT).size(16.0));
    if ui.add(repeat).on_hover_text("Play again and again").clicked() {
        viewer.film.repeats = !viewer.film.repeats;
    }
    ui.separator();
    for (sign, action, verb) in
        [(icons::ARROW_U_UP_LEFT, Action::Undo, "Undo"), (icons::ARROW_U_UP_RIGHT, Action::Redo, "Redo")]
    {
        if icon(ui, true, sign, &format!("{verb} ({})", key(viewer, action))) {
            viewer.act(action, None);
        }
    }
    ui.separator();
    if icon(ui, keys > 0, icons::FILM_STRIP, "Write the film: its file is named in the page Path") {
        viewer.requests.push(Request::WriteFilm(None));
    }
    let field = DragValue::new(&mut viewer.film.step).speed(0.1).range(0.1..=60.0).suffix(" s per key");
    ui.add(field).on_hover_text("Between the keys that are added");
    if keys > 0 {
        let keys = if keys == 1 { "1 key".to_owned() } else { format!("{keys} keys") };
        ui.label(format!("{:.2} of {:.2} s, {keys}", viewer.film.now, viewer.film.end()));
    }
}

/// The time axis of the track.
struct Axis {
    /// The part of the window from time 0 to the last time.
    rect: Rect,
    /// Seconds at the right end.
    seconds: f64,
}

impl Axis {
    fn x(&self, seconds: f64) -> f32 {
        self.rect.left() + (seconds / self.seconds) as f32 * self.rect.width()
    }

    fn seconds(&self, pos: Pos2) -> f64 {
        f64::from((pos.x - self.rect.left()) / self.rect.width()).clamp(0.0, 1.0) * self.seconds
    }
}

fn track(viewer: &mut Viewer, ui: &mut Ui) {
    let (response, painter) = ui.allocate_painter(vec2(ui.available_width(), TRACK), Sense::click_and_drag());
    let rect = response.rect;
    let visuals = ui.visuals().clone();
    painter.rect_filled(rect, 2.0, visuals.extreme_bg_color);
    if viewer.film.timeline.keys().is_empty() {
        let key = viewer.setup.bindings.text(Action::AddKey);
        let text = format!("No key yet: {key} adds the view, Turn makes a path around the pivot.");
        let font = FontId::proportional(13.0);
        painter.text(rect.center(), Align2::CENTER_CENTER, text, font, visuals.weak_text_color());
        return;
    }
    // The last key has room behind it to be dragged into. The scale stays while something is dragged.
    if !ui.input(|input| input.pointer.any_down()) {
        viewer.film.shown_seconds = (1.1 * viewer.film.end()).max(1.0);
    }
    let axis = Axis { rect: rect.shrink2(vec2(2.0 * KEY, 0.0)), seconds: viewer.film.shown_seconds.max(1.0) };
    let grey = Stroke::new(1.0, visuals.weak_text_color());
    let step = tick(axis.seconds * f64::from(TICK / axis.rect.width()));
    for i in 0..=(axis.seconds / step) as u32 {
        let seconds = f64::from(i) * step;
        let at = pos2(axis.x(seconds), rect.bottom());
        painter.line_segment([at, at - vec2(0.0, 4.0)], grey);
        let text = format!("{}", (seconds * 1e3).round() / 1e3);
        painter.text(at - vec2(0.0, 4.0), Align2::CENTER_BOTTOM, text, FontId::proportional(9.0), grey.color);
    }
    painter.add(Shape::line(speeds(viewer, &axis), Stroke::new(1.0, visuals.hyperlink_color)));
    let response = response.on_hover_text("The line is the speed of the camera; drag to go to a time");
    keys(viewer, &axis, ui);
    if let Some(pos) = response.interact_pointer_pos().filter(|_| response.is_pointer_button_down_on()) {
        viewer.film.is_playing = false;
        viewer.show_time(axis.seconds(pos).min(viewer.film.end()));
    }
    let now = axis.x(viewer.film.now);
    painter.vline(now, rect.y_range(), Stroke::new(1.5, super::theme::MARK));
}

/// The marks of keys, which can be dragged.
fn keys(viewer: &mut Viewer, axis: &Axis, ui: &mut Ui) {
    let keys = viewer.film.timeline.keys();
    let mut change = None;
    for (i, key) in keys.iter().enumerate() {
        let at = pos2(axis.x(key.seconds), axis.rect.top() + KEY + 4.0);
        let area = Rect::from_center_size(at, vec2(2.0 * KEY, 2.0 * KEY));
        let colour = if key.rests { ui.visuals().strong_text_color() } else { super::theme::PATH };
        let [dx, dy] = [vec2(KEY, 0.0), vec2(0.0, KEY)];
        let outline = match key.rests {
            true => vec![area.left_top(), area.right_top(), area.right_bottom(), area.left_bottom()],
            false => vec![at - dy, at + dx, at + dy, at - dx],
        };
        ui.painter().add(Shape::convex_polygon(outline, colour, Stroke::NONE));
        if keys.len() > DRAGGED {
            continue;
        }
        let response = ui.interact(area, ui.id().with(("key", i)), Sense::click_and_drag());
        if response.dragged()
            && let Some(pos) = response.interact_pointer_pos()
        {
            let (low, high) = viewer.film.room_of(i);
            change = Some(KeyChange::Move(i, axis.seconds(pos).clamp(low, high.unwrap_or(f64::INFINITY))));
        }
        if response.clicked() {
            change = Some(KeyChange::Show(key.seconds));
        }
        let rests = if key.rests { ", rests" } else { "" };
        let response = response.on_hover_text(format!(
            "key {i} at {:.2} s{rests}\nDrag to move it in time, click to go there; the right button has more",
            key.seconds
        ));
        response.context_menu(|ui| {
            let hint = "The motion slows down before this key, stands still, and speeds up after it";
            let mut rests = key.rests;
            if ui.checkbox(&mut rests, "Rest").on_hover_text(hint).changed() {
                change = Some(KeyChange::Rest(i, rests));
            }
            for (name, wanted) in
                [("Replace by the view", KeyChange::Replace(key.seconds)), ("Remove", KeyChange::Remove(i))]
            {
                if ui.button(name).clicked() {
                    change = Some(wanted);
                    ui.close();
                }
            }
        });
    }
    if let Some(change) = change {
        viewer.change_key(change);
    }
}

/// The curve of the camera's speed along the path, the greatest at the top of the track.
fn speeds(viewer: &Viewer, axis: &Axis) -> Vec<Pos2> {
    let end = viewer.film.end();
    let time = |part: usize| end * part as f64 / PARTS as f64;
    let places: Vec<_> = (0..=PARTS).filter_map(|part| viewer.film.timeline.at(time(part))).collect();
    let speeds: Vec<f64> = places.windows(2).map(|pair| pair[0].position.distance(pair[1].position)).collect();
    let most = speeds.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let height = axis.rect.height() - 4.0;
    let point = |(part, speed): (usize, &f64)| {
        let middle = (time(part) + time(part + 1)) / 2.0;
        pos2(axis.x(middle), axis.rect.bottom() - 2.0 - (speed / most) as f32 * height)
    };
    speeds.iter().enumerate().map(point).collect()
}

/// The least of 1, 2 and 5 times a power of ten that is no less than this.
fn tick(least: f64) -> f64 {
    let power = 10f64.powf(least.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|factor| factor * power).find(|step| *step >= least).unwrap_or(10.0 * power)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers() {
        for (least, expected) in [(0.9, 1.0), (1.0, 1.0), (1.2, 2.0), (2.5, 5.0), (7.0, 10.0), (0.03, 0.05)] {
            assert!((tick(least) / expected - 1.0).abs() < 1e-9, "{least}: {}", tick(least));
        }
    }
}
