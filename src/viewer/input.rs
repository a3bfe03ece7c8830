//! Mouse, keys and dropped files.

use egui::{Event as Input, Key, PointerButton, Sense, Ui};
use glam::{DVec2, DVec3};

use super::comparison::{CompareMode, CompareTarget};
use super::keys::{Action, Chord};
use super::state::{Request, Viewer, WindowRequest};

/// The factor by which the fast key speeds flying up, and the slow key slows it down.
const FAST: f64 = 5.0;
/// Scrolled points per step of the dolly.
const STEP_POINTS: f64 = 50.0;
/// Distance in points within which a drag takes hold of the split.
const GRIP_POINTS: f32 = 6.0;

/// Handles keys, dropped files and motion since the previous frame, `seconds` ago.
pub fn handle(viewer: &mut Viewer, ui: &mut Ui, seconds: f64) {
    let dropped = ui.input(|input| input.raw.dropped_files.clone());
    for file in &dropped {
        viewer.drop_file(file.path());
    }
    // A header or a button that Tab has reached takes no letters.
    let is_typing = ui.ctx().text_edit_focused();
    if !is_typing {
        keys(viewer, ui);
    }
    let is_moving = !is_typing && fly(viewer, ui, seconds);
    let is_gliding = viewer.navigator.advance(seconds);
    viewer.play(seconds);
    if is_moving || is_gliding {
        ui.ctx().request_repaint();
    }
}

/// Number of presses of an action's key since the previous frame, which may be several if frames take long. The repeats
/// of a held key count only if `repeats`.
fn presses(viewer: &Viewer, ui: &Ui, action: Action, repeats: bool) -> usize {
    let Chord::Key(shortcut) = viewer.setup.bindings.chord(action) else { return 0 };
    let mut count = 0;
    let mut is_other = |event: &Input| {
        let Input::Key { key, modifiers, pressed: true, repeat, .. } = event else { return true };
        let is_it = *key == shortcut.logical_key && modifiers.matches_logically(shortcut.modifiers);
        count += usize::from(is_it && (repeats || !repeat));
        !is_it
    };
    ui.input_mut(|input| input.events.retain(&mut is_other));
    count
}

/// True if the key of an action was pressed; repeats of a held key do not count.
fn pressed(viewer: &Viewer, ui: &Ui, action: Action) -> bool {
    presses(viewer, ui, action, false) > 0
}

/// True while the key of an action is held.
fn held(viewer: &Viewer, ui: &Ui, action: Action) -> bool {
    ui.input(|input| match viewer.setup.bindings.chord(action) {
        Chord::Key(shortcut) => input.key_down(shortcut.logical_key),
        Chord::Held(modifiers) => input.modifiers.contains(modifiers),
    })
}

fn keys(viewer: &mut Viewer, ui: &mut Ui) {
    // egui turns the usual clipboard keys into events of their own.
    let clipboard = ui.input(|input| input.events.clone());
    for event in clipboard {
        match event {
            Input::Copy => viewer.copy_view(),
            Input::Paste(text) => viewer.paste_view(&text),
            _ => {}
        }
    }
    (0..presses(viewer, ui, Action::NextCamera, true)).for_each(|_| viewer.step_camera(true));
    (0..presses(viewer, ui, Action::PreviousCamera, true)).for_each(|_| viewer.step_camera(false));
    if pressed(viewer, ui, Action::NearestCamera) {
        viewer.go_to_nearest_camera();
    }
    if pressed(viewer, ui, Action::FlipUp) {
        viewer.navigator.flip_up();
        viewer.camera = None;
    }
    if pressed(viewer, ui, Action::Frame) {
        viewer.frame_scene();
    }
    if pressed(viewer, ui, Action::Reset) {
        viewer.reset_view();
    }
    if pressed(viewer, ui, Action::FullScreen) {
        viewer.requests.push(Request::Window(WindowRequest::ToggleFullScreen));
    }
    if pressed(viewer, ui, Action::HidePanels) {
        viewer.panels.are_hidden = !viewer.panels.are_hidden;
    }
    // Some keyboards have a key for the question mark, others need Shift and another key.
    let asks = ui.input(|input| input.events.iter().any(|event| *event == Input::Text("?".to_owned())));
    if pressed(viewer, ui, Action::Help) || asks {
        viewer.panels.shows_help = !viewer.panels.shows_help;
    }
    if ui.input(|input| input.key_pressed(Key::Escape)) {
        viewer.panels.shows_help = false;
        viewer.explanation = None;
        viewer.inspection.isolated = None;
    }
    if pressed(viewer, ui, Action::Screenshot) {
        viewer.requests.push(Request::WritePicture);
    }
    if pressed(viewer, ui, Action::CopyView) {
        viewer.copy_view();
    }
    if pressed(viewer, ui, Action::FreezeCulling) {
        viewer.toggle_frozen_culling();
    }
    if pressed(viewer, ui, Action::Pick)
        && let Some(pixel) = pixel_under_cursor(viewer, ui)
    {
        viewer.requests.push(Request::Pick(pixel));
    }
    if pressed(viewer, ui, Action::AddKey) {
        viewer.add_key();
    }
    if pressed(viewer, ui, Action::Play) {
        viewer.film.toggle();
    }
    let in_pages = viewer.is_in_pages();
    (0..presses(viewer, ui, Action::NextLook, true)).for_each(|_| viewer.inspection.step(true, in_pages));
    (0..presses(viewer, ui, Action::PreviousLook, true)).for_each(|_| viewer.inspection.step(false, in_pages));
    if pressed(viewer, ui, Action::Quit) {
        viewer.requests.push(Request::Window(WindowRequest::Quit));
    }
    let can_flicker = viewer.comparison.target != CompareTarget::Nothing;
    viewer.comparison.is_flicked = can_flicker && held(viewer, ui, Action::Flicker);
}

/// Flies while keys are held; returns true if the view moves.
fn fly(viewer: &mut Viewer, ui: &Ui, seconds: f64) -> bool {
    let held = |action| held(viewer, ui, action);
    // A held Ctrl also slows down, so Ctrl with a direction key is not taken for a shortcut here.
    let along = |plus, minus| f64::from(u8::from(held(plus))) - f64::from(u8::from(held(minus)));
    let direction = DVec3::new(
        along(Action::Right, Action::Left),
        along(Action::Down, Action::Up),
        along(Action::Forward, Action::Back),
    );
    if direction == DVec3::ZERO {
        return false;
    }
    let pace = if held(Action::Fast) { FAST } else { 1.0 } * if held(Action::Slow) { 1.0 / FAST } else { 1.0 };
    viewer.navigator.fly(direction, seconds, pace);
    viewer.camera = None;
    true
}

/// Handles the mouse over the picture.
pub fn mouse(viewer: &mut Viewer, ui: &mut Ui) {
    let rect = ui.available_rect_before_wrap();
    let response = ui.allocate_rect(rect, Sense::click_and_drag());
    let points = ui.ctx().pixels_per_point();
    let size = viewer.size;
    let to_pixels = |v: egui::Vec2| DVec2::new(f64::from(v.x), f64::from(v.y)) * f64::from(points);
    let drag = to_pixels(response.drag_delta());
    let shift = ui.input(|input| input.modifiers.shift);
    if drag_split(viewer, ui, &response) {
        return;
    }
    let before = viewer.navigator.camera(size);
    if drag != DVec2::ZERO {
        if response.dragged_by(PointerButton::Middle) || response.dragged_by(PointerButton::Primary) && shift {
            viewer.navigator.pan(drag, size);
        } else if response.dragged_by(PointerButton::Primary) {
            viewer.navigator.orbit(drag, size);
        } else if response.dragged_by(PointerButton::Secondary) {
            viewer.navigator.look(drag, size);
        }
    }
    if response.hovered() {
        let scrolled = ui.input(|input| input.smooth_scroll_delta().y);
        viewer.navigator.dolly(f64::from(scrolled) / STEP_POINTS);
        let zoom = ui.input(|input| input.zoom_delta());
        if zoom != 1.0 {
            viewer.navigator.dolly(f64::from(zoom).ln() * 10.0);
        }
    }
    if viewer.navigator.camera(size) != before {
        viewer.camera = None;
        viewer.film.is_playing = false;
    }
    if response.double_clicked_by(PointerButton::Primary)
        && let Some(pixel) = pixel_under_cursor(viewer, ui)
    {
        viewer.requests.push(Request::Focus(pixel));
    }
}

/// Moves the split with the mouse; returns true while it is dragged.
fn drag_split(viewer: &mut Viewer, ui: &Ui, response: &egui::Response) -> bool {
    let comparison = &mut viewer.comparison;
    if comparison.target == CompareTarget::Nothing || comparison.mode != CompareMode::Split {
        return false;
    }
    let width = viewer.size[0] as f32 / ui.ctx().pixels_per_point();
    let at = comparison.split * width;
    let is_near = |x: f32| (x - at).abs() < GRIP_POINTS;
    let began = ui.input(|input| input.pointer.press_origin());
    if response.hover_pos().is_some_and(|p| is_near(p.x)) {
        ui.ctx().set_cursor_icon(egui::CursorIcon::ResizeHorizontal);
    }
    if response.drag_started_by(PointerButton::Primary) {
        comparison.is_dragged = began.is_some_and(|p| is_near(p.x));
    }
    if !response.dragged_by(PointerButton::Primary) {
        comparison.is_dragged = false;
    }
    if comparison.is_dragged
        && let Some(p) = response.interact_pointer_pos()
    {
        comparison.split = (p.x / width).clamp(0.0, 1.0);
    }
    comparison.is_dragged
}

/// The pixel of the picture under the cursor; `None` if the cursor is outside the window.
fn pixel_under_cursor(viewer: &Viewer, ui: &Ui) -> Option<[u32; 2]> {
    let at = ui.input(|input| input.pointer.latest_pos())? * ui.ctx().pixels_per_point();
    let is_inside = at.x >= 0.0 && at.y >= 0.0 && at.x < viewer.size[0] as f32 && at.y < viewer.size[1] as f32;
    is_inside.then_some([at.x as u32, at.y as u32])
}
