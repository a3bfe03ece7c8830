//! Mouse, keys and dropped files.

use std::time::Duration;

use egui::{Event as Input, Key, Modifiers, Order, PointerButton, Pos2, Rect, Sense, Ui};
use glam::{DVec2, DVec3};

use crate::render::SelectionMode;
use crate::viewer::model::{
    Action, Chord, CompareMode, CompareTarget, Comparison, Drag, DragMotion, Request, Tool, Viewer, area_between,
};

/// The factor by which the fast key speeds flying up, and the slow key slows it down.
const FAST: f64 = 5.0;
/// Scrolled points per step of the dolly.
const STEP_POINTS: f64 = 50.0;
/// Distance in points within which a drag takes hold of the split.
const GRIP_POINTS: f32 = 6.0;

/// The longest time of the first step of a motion, in seconds: the previous frame may be long past.
const FIRST_STEP: f64 = 0.1;
/// The longest time of a step, in seconds, so that the view does not jump after the program stood still.
const LONGEST_STEP: f64 = 5.0;

/// Time after the last event of a wheel for which egui smooths its scrolling.
const SCROLLING: Duration = Duration::from_millis(160);

/// Handles dropped files and motion since the previous frame, `seconds` ago. A motion that continues lasts all of that
/// time, even if frames are slow. Returns the keys and the events of the pointer for [`handle_events`].
pub fn handle(viewer: &mut Viewer, ui: &mut Ui, seconds: f64) -> Vec<Input> {
    let (was_gliding, was_playing) = (viewer.view.navigator.is_gliding(), viewer.film.is_playing);
    let dropped = ui.input(|input| input.raw.dropped_files.clone());
    for file in &dropped {
        viewer.drop_file(file.path());
    }
    // A header or a button with the keyboard focus takes no letters.
    let is_typing = ui.ctx().text_edit_focused();
    let events = take_events(viewer, ui, is_typing);
    let can_flicker = !is_typing && viewer.comparison.target != CompareTarget::Nothing;
    viewer.comparison.is_flicked = can_flicker && held(viewer, ui, Action::Flicker);
    let step = |goes_on: bool| seconds.min(if goes_on { LONGEST_STEP } else { FIRST_STEP });
    viewer.view.is_flying = !is_typing && fly(viewer, ui, step(viewer.view.is_flying));
    let is_gliding = viewer.view.navigator.advance(step(was_gliding));
    if was_playing {
        viewer.play(step(true));
    }
    if viewer.view.is_flying || is_gliding {
        ui.ctx().request_repaint();
    }
    let is_pressed = ui.input(|input| input.pointer.any_down()) || ui.ctx().egui_is_using_pointer();
    // The smoothed scrolling of a wheel lasts several frames, and is one undo step.
    let is_scrolling = ui.input(|input| input.is_scrolling());
    if is_scrolling {
        ui.ctx().request_repaint_after(SCROLLING);
    }
    let is_moving =
        viewer.view.is_flying || viewer.view.navigator.is_gliding() || viewer.film.is_playing || is_scrolling;
    // A second pass of the layout comes between the end of a stroke and its last edit.
    let is_first_pass = ui.ctx().current_pass_index() == 0;
    if is_first_pass && !(is_moving || is_pressed || viewer.pointer.drag.is_some()) {
        viewer.record_undo_step();
    }
    events
}

/// True while the key of an action is held.
fn held(viewer: &Viewer, ui: &Ui, action: Action) -> bool {
    ui.input(|input| match viewer.setup.bindings.chord(action) {
        Chord::Key(shortcut) => input.key_down(shortcut.logical_key),
        Chord::Held(modifiers) => input.modifiers.contains(modifiers),
    })
}

/// Takes away the events of keys that have an action, so that a button with the keyboard focus does not answer them,
/// too. Returns all events since the previous frame that the viewer handles.
fn take_events(viewer: &Viewer, ui: &Ui, is_typing: bool) -> Vec<Input> {
    // Some keyboards have a key for the question mark, others need Shift and another key.
    let has_question = ui.input(|input| input.key_pressed(Key::Questionmark));
    let mut taken = Vec::new();
    let mut is_left = |event: &Input| {
        let is_own = match event {
            Input::Key { key, modifiers, pressed: true, .. } => {
                let action = viewer.setup.bindings.action(*key, *modifiers);
                // While text is typed, only a function key counts, which types nothing.
                let writes = |action| matches!(action, Action::CopyPicture | Action::Screenshot);
                let is_function_key = (Key::F1..=Key::F35).contains(key);
                action.is_some_and(|action| !is_typing || is_function_key && writes(action))
            }
            // egui turns the usual clipboard keys into events of their own.
            Input::Copy | Input::Paste(_) => !is_typing,
            Input::Text(text) => !is_typing && text == "?" && !has_question,
            _ => false,
        };
        let is_shared = matches!(
            event,
            Input::PointerMoved(_)
                | Input::PointerButton { .. }
                | Input::PointerGone
                | Input::WindowFocused(_)
                | Input::Key { key: Key::Escape, pressed: true, .. }
        );
        if is_own || is_shared && !(is_typing && matches!(event, Input::Key { .. })) {
            taken.push(event.clone());
        }
        !is_own
    };
    ui.input_mut(|input| input.events.retain(&mut is_left));
    taken
}

/// Handles a key or a command of the clipboard.
fn key(viewer: &mut Viewer, ui: &Ui, event: &Input) {
    match event {
        Input::Copy => viewer.copy_view(),
        Input::Paste(text) => viewer.paste_view(text),
        Input::Text(_) => viewer.act(Action::Help, None),
        Input::Key { key, modifiers, repeat, .. } => match viewer.setup.bindings.action(*key, *modifiers) {
            Some(action) if !repeat || action.repeats() => {
                let pixel = viewer.pointer.position.and_then(|pos| pixel_at(viewer, ui, pos));
                viewer.act(action, pixel);
            }
            None if *key == Key::Escape => viewer.escape(),
            _ => {}
        },
        _ => {}
    }
}

/// Flies while keys are held; returns true if the view moves.
fn fly(viewer: &mut Viewer, ui: &Ui, seconds: f64) -> bool {
    let held = |action| held(viewer, ui, action);
    // Ctrl is the slow key, so Ctrl with a direction key is no shortcut here.
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
    viewer.view.navigator.fly(direction, seconds, pace);
    viewer.view.camera_index = None;
    true
}

/// Handles keys, and the mouse over the picture. Events are handled one by one, in their order, so that a drag loses
/// none between two frames, and slow frames do what fast ones do.
pub fn handle_events(viewer: &mut Viewer, ui: &mut Ui, rect: Rect, events: Vec<Input>) {
    let response = ui.allocate_rect(rect, Sense::click_and_drag());
    let size = viewer.view.size;
    let (mut before, mut has_moved) = (viewer.view.navigator.camera(size), false);
    let mut has_stroke = false;
    for event in events {
        if let Input::PointerMoved(pos) | Input::PointerButton { pos, .. } = event {
            viewer.pointer.position = Some(pos);
        }
        match event {
            Input::PointerButton { pos, button, pressed: true, modifiers } if viewer.pointer.drag.is_none() => {
                viewer.pointer.drag = drag_at(viewer, ui, (rect, pos), button, modifiers);
                if viewer.pointer.drag.is_some_and(|drag| drag.motion == DragMotion::Stroke) {
                    viewer.begin_stroke(pixel_position(ui, pos), mode(modifiers));
                    has_stroke = true;
                }
            }
            Input::PointerMoved(pos) => has_stroke |= follow(viewer, ui, pos),
            Input::PointerButton { pos, button, pressed: false, .. }
                if viewer.pointer.drag.is_some_and(|drag| drag.button == button) =>
            {
                follow(viewer, ui, pos);
                viewer.pointer.drag = None;
                viewer.end_stroke();
                has_stroke = false;
            }
            Input::WindowFocused(false) => viewer.cancel_stroke(),
            Input::PointerGone => viewer.pointer.position = None,
            event => {
                // Keys say themselves which camera of the file they go to.
                has_moved |= viewer.view.navigator.camera(size) != before;
                key(viewer, ui, &event);
                before = viewer.view.navigator.camera(size);
            }
        }
    }
    if has_stroke {
        viewer.apply_stroke(true);
    }
    viewer.pointer.pixel = response.hovered().then(|| pixel_under_cursor(viewer, ui)).flatten();
    if response.hovered() {
        if response.hover_pos().is_some_and(|pos| is_at_split(viewer, ui, pos)) {
            ui.ctx().set_cursor_icon(egui::CursorIcon::ResizeHorizontal);
        }
        let scrolled = ui.input(|input| input.smooth_scroll_delta().y);
        viewer.view.navigator.dolly(f64::from(scrolled) / STEP_POINTS);
        let zoom = ui.input(|input| input.zoom_delta());
        if zoom != 1.0 {
            viewer.view.navigator.dolly(f64::from(zoom).ln() * 10.0);
        }
    }
    if has_moved || viewer.view.navigator.camera(size) != before {
        viewer.view.camera_index = None;
        viewer.film.is_playing = false;
    }
    let points = f64::from(ui.ctx().pixels_per_point());
    let place = viewer.pointer.pixel.map(|pixel| DVec2::from(pixel.map(f64::from)) + 0.5);
    let shows_cameras =
        viewer.panels.recent.shows_cameras && !viewer.panels.are_hidden && viewer.pointer.drag.is_none();
    let near = place
        .filter(|_| shows_cameras)
        .and_then(|place| viewer.cameras.at(&viewer.view.camera(), place, GRIP_POINTS as f64 * points));
    viewer.pointer.camera = near;
    if let Some(camera) = near {
        ui.ctx().set_cursor_icon(egui::CursorIcon::PointingHand);
        if response.clicked() {
            viewer.go_to_camera(camera, false);
        }
    }
    if response.double_clicked_by(PointerButton::Primary)
        && !viewer.uses_tool()
        && let Some(pixel) = pixel_under_cursor(viewer, ui)
    {
        viewer.requests.push(Request::Focus(pixel));
    }
}

/// The drag that a press starts; `None` if the press hits a window over the picture, or the edge of the panel.
fn drag_at(
    viewer: &Viewer,
    ui: &Ui,
    (rect, pos): (Rect, Pos2),
    button: PointerButton,
    held: Modifiers,
) -> Option<Drag> {
    let edge = ui.style().interaction.resize_grab_radius_side;
    let is_under = ui.ctx().layer_id_at(pos).is_some_and(|layer| layer.order != Order::Background);
    if is_under || !rect.contains(pos) || !viewer.panels.are_hidden && pos.x > rect.right() - edge {
        return None;
    }
    let motion = match button {
        PointerButton::Primary if is_at_split(viewer, ui, pos) => DragMotion::Split,
        PointerButton::Primary if viewer.uses_tool() && !held.alt => match viewer.editing.tool {
            Tool::Place => viewer.handle_at(pixel_position(ui, pos), f64::from(ui.ctx().pixels_per_point()))?,
            Tool::Box => viewer.face_at(pixel_position(ui, pos), f64::from(ui.ctx().pixels_per_point()))?,
            _ => DragMotion::Stroke,
        },
        PointerButton::Primary if held.shift => DragMotion::Pan,
        PointerButton::Primary if held.command && viewer.comparison.target != CompareTarget::Nothing => {
            DragMotion::Area(pixel_at(viewer, ui, pos)?)
        }
        PointerButton::Primary => DragMotion::Orbit,
        PointerButton::Middle => DragMotion::Pan,
        PointerButton::Secondary => DragMotion::Look,
        _ => return None,
    };
    Some(Drag { button, motion, position: pos })
}

/// Continues a drag to this position. Returns true if a stroke of a tool goes on.
fn follow(viewer: &mut Viewer, ui: &Ui, pos: Pos2) -> bool {
    let Some(drag) = &mut viewer.pointer.drag else { return false };
    let points = ui.ctx().pixels_per_point();
    let moved = (pos - drag.position) * points;
    drag.position = pos;
    if moved == egui::Vec2::ZERO {
        return false;
    }
    let (motion, moved, size) = (drag.motion, DVec2::new(moved.x.into(), moved.y.into()), viewer.view.size);
    match motion {
        DragMotion::Orbit => viewer.view.navigator.orbit(moved, size),
        DragMotion::Pan => viewer.view.navigator.pan(moved, size),
        DragMotion::Look => viewer.view.navigator.look(moved, size),
        DragMotion::Split => viewer.comparison.split = (pos.x * points / size[0] as f32).clamp(0.0, 1.0),
        DragMotion::Stroke => {
            let place = pixel_position(ui, pos);
            viewer.pointer.stroke.iter_mut().for_each(|stroke| stroke.points.push(place));
        }
        DragMotion::Handle(number, handle) => {
            let to = pixel_position(ui, pos);
            viewer.drag_handle(number, handle, to - moved, to);
        }
        DragMotion::Face(axis, is_greater) => {
            let to = pixel_position(ui, pos);
            viewer.drag_face((axis, is_greater), to - moved, to);
        }
        DragMotion::Area(from) => {
            let to = [pos.x, pos.y].map(|place| (place * points).max(0.0) as u32);
            viewer.comparison.area = area_between(from, to, size);
        }
    }
    motion == DragMotion::Stroke
}

/// The selection mode of a stroke that starts with these modifiers.
fn mode(held: Modifiers) -> SelectionMode {
    match held {
        Modifiers { shift: true, .. } => SelectionMode::Add,
        Modifiers { command: true, .. } => SelectionMode::Subtract,
        _ => SelectionMode::Replace,
    }
}

/// A position in the window, in pixels.
fn pixel_position(ui: &Ui, pos: Pos2) -> DVec2 {
    let place = pos * ui.ctx().pixels_per_point();
    DVec2::new(place.x.into(), place.y.into())
}

/// True if a position is near the line between two pictures.
fn is_at_split(viewer: &Viewer, ui: &Ui, pos: Pos2) -> bool {
    let Comparison { target, mode, split, .. } = &viewer.comparison;
    let width = viewer.view.size[0] as f32 / ui.ctx().pixels_per_point();
    *target != CompareTarget::Nothing && *mode == CompareMode::Split && (pos.x - split * width).abs() < GRIP_POINTS
}

/// The pixel of the picture under the cursor; `None` if the cursor is outside the picture.
fn pixel_under_cursor(viewer: &Viewer, ui: &Ui) -> Option<[u32; 2]> {
    pixel_at(viewer, ui, ui.input(|input| input.pointer.latest_pos())?)
}

/// The pixel of the picture at a position in points; `None` outside the picture.
fn pixel_at(viewer: &Viewer, ui: &Ui, pos: Pos2) -> Option<[u32; 2]> {
    let at = pos * ui.ctx().pixels_per_point();
    let is_inside =
        at.x >= 0.0 && at.y >= 0.0 && at.x < viewer.view.size[0] as f32 && at.y < viewer.view.size[1] as f32;
    is_inside.then_some([at.x as u32, at.y as u32])
}
