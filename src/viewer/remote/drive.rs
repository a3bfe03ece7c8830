//! What messages do.

use egui::{Event, Modifiers, MouseWheelUnit, PointerButton, Pos2, TouchPhase, Vec2};

use super::messages::{BudgetEntry, Button, ClientMessage, CompareBy, Held, InputEvent};
use crate::camera::Timeline;
use crate::options::{Knob, Options};
use crate::scene::SceneInstances;
use crate::viewer::frame::Session;
use crate::viewer::model::{
    ACTIONS, Action, Chord, CompareMode, CompareTarget, MAX_ERRORS, MIN_PSNRS, Measures, Purpose, Request, Viewer,
    needs_whole, view_mode,
};

/// The actions of messages that are done at once. Those on files, the clipboard and the window are not among them.
pub(super) const ACTS: [Action; 13] = [
    Action::NextCamera,
    Action::PreviousCamera,
    Action::NearestCamera,
    Action::FlipUp,
    Action::Frame,
    Action::Reset,
    Action::Undo,
    Action::Redo,
    Action::FreezeCulling,
    Action::NextLook,
    Action::PreviousLook,
    Action::AddKey,
    Action::Play,
];

/// The actions that last while their key is held.
pub(super) const HELD: [Action; 9] = [
    Action::Forward,
    Action::Back,
    Action::Left,
    Action::Right,
    Action::Up,
    Action::Down,
    Action::Fast,
    Action::Slow,
    Action::Flicker,
];

/// The name of the message that closes messages and explanations, like the key Escape.
pub(super) const ESCAPE: &str = "escape";

/// Most requests that wait for a frame.
const MAX_REQUESTS: usize = 64;

/// Most events of one message.
const MAX_EVENTS: usize = 256;

/// Most keys of a camera path, most measures, and their most points.
const MAX_KEYS: usize = 100;
const MAX_MEASURES: usize = 100;
const MAX_POINTS: usize = 1000;

/// Most characters of the name of a unit.
const MAX_NAME: usize = 16;

/// Does what a message asks of a viewer. Returns the events for the next frame.
///
/// # Errors
/// A sentence for the user if it cannot be done.
pub fn drive(session: &mut Session, message: ClientMessage) -> Result<Vec<Event>, String> {
    let viewer = &mut session.viewer;
    if viewer.requests.len() > MAX_REQUESTS {
        return Err("too much is asked for at once".to_owned());
    }
    match message {
        ClientMessage::Input { events, .. } if events.len() > MAX_EVENTS => {
            return Err(format!("a message has {MAX_EVENTS} events at most"));
        }
        ClientMessage::Input { events, .. } => {
            let mut all = Vec::new();
            for event in &events {
                all.extend(held_keys(event).map(Event::ModifiersChanged));
                all.extend(input(viewer, event)?);
            }
            return Ok(all);
        }
        ClientMessage::Act { action } if action == ESCAPE => viewer.escape(),
        ClientMessage::Act { action } if action == "add-key" && viewer.film.timeline.keys().len() >= MAX_KEYS => {
            return Err(format!("a path has {MAX_KEYS} keys at most"));
        }
        ClientMessage::Act { action } => viewer.act(named(&action, &ACTS)?, None),
        ClientMessage::Set { knob, value } => {
            let knob = Knob::named(&knob).ok_or_else(|| format!("there is no knob {knob}"))?;
            let value = knob.parse(&value).map_err(|problem| format!("{}: {problem}", knob.name))?;
            let turned = knob.turned(&viewer.options, value);
            if let Some(why) = turned.undrawable() {
                return Err(format!("{}: {why}", knob.name));
            }
            viewer.options = turned;
        }
        ClientMessage::Preset { name } => viewer.options = viewer.preset(&preset(&name)?),
        ClientMessage::Budget { .. } if viewer.measuring.running.is_some() => {
            return Err("something is being measured: ask again when it is done".to_owned());
        }
        ClientMessage::Budget { budget } => choose(session, budget)?,
        ClientMessage::StopBudget => {
            // The user may be measuring something else.
            let running = viewer.measuring.running.iter().filter(|running| running.purpose == Purpose::Choice);
            running.for_each(|running| running.cancel.cancel());
        }
        ClientMessage::Look { name, range } => look(viewer, &name, range)?,
        ClientMessage::Camera { index } if index >= viewer.cameras.list.len() => {
            return Err(format!("there is no camera {index}"));
        }
        ClientMessage::Camera { index } => viewer.go_to_camera(index, false),
        ClientMessage::View { view } => {
            let camera = crate::camera::from_json(&view.to_string());
            viewer.view.snap(&camera.map_err(|problem| format!("this is no view: {problem:#}"))?);
            viewer.pictures.are_stale = true;
        }
        ClientMessage::Compare { with } => match with.as_str() {
            "nothing" => viewer.comparison.choose(CompareTarget::Nothing),
            "reference" | "photographs" if viewer.comparison.requests_under_way > 0 => {
                return Err("a picture that was asked for before is being drawn or read: ask again later".to_owned());
            }
            "reference" => viewer.compare_with_reference(),
            "photographs" if !viewer.cameras.have_photographs() => return Err("no camera has a photograph".to_owned()),
            "photographs" => viewer.compare_with_photographs(),
            name => viewer.comparison.choose(CompareTarget::Options(Some(preset(name)?))),
        },
        ClientMessage::CompareBy { mode, split, gain } => {
            let comparison = &mut viewer.comparison;
            comparison.mode = mode_of(mode);
            comparison.split = split.filter(|split| split.is_finite()).unwrap_or(comparison.split).clamp(0.0, 1.0);
            comparison.gain = gain.filter(|gain| gain.is_finite()).unwrap_or(comparison.gain).clamp(1.0, 1000.0);
        }
        ClientMessage::Explain { pixel } => viewer.requests.push(Request::Pick(inside(viewer, pixel)?)),
        ClientMessage::Focus { pixel } => viewer.requests.push(Request::Focus(inside(viewer, pixel)?)),
        ClientMessage::Mark { .. } if !has_room(viewer) => return Err(too_much()),
        ClientMessage::Mark { pixel } => viewer.requests.push(Request::Mark(inside(viewer, pixel)?)),
        ClientMessage::Measure { kind } => (viewer.ruler.kind, viewer.ruler.open) = (kind, None),
        ClientMessage::Measures { measures } => {
            measures.check().map_err(|problem| format!("these are no measures: {problem:#}"))?;
            if measures.all.len() > MAX_MEASURES || points(&measures) > MAX_POINTS {
                return Err(too_much());
            }
            measures.unit.as_ref().map_or(Ok(()), |unit| check_name(&unit.name))?;
            (viewer.measures, viewer.ruler.open) = (measures, None);
        }
        ClientMessage::Unit { name, length } => {
            check_name(&name)?;
            if !(1e-9..=1e9).contains(&length) {
                return Err("the length of a line is from 1e-9 to 1e9".to_owned());
            }
            (viewer.ruler.unit, viewer.ruler.known) = (name, length);
            viewer.set_unit()?;
        }
        ClientMessage::Path { keys } => {
            let path = Timeline::of_value(&keys).map_err(|problem| format!("this is no camera path: {problem:#}"))?;
            if path.keys().len() > MAX_KEYS {
                return Err(too_many_keys());
            }
            (viewer.film.timeline, viewer.film.is_playing) = (path, false);
            viewer.film.now = viewer.film.now.min(viewer.film.end());
        }
        ClientMessage::Turn => viewer.turn_path(),
        ClientMessage::ClosePath if viewer.film.timeline.keys().len() >= MAX_KEYS => return Err(too_many_keys()),
        ClientMessage::ClosePath => viewer.close_path()?,
        ClientMessage::Time { seconds } => {
            viewer.film.is_playing = false;
            viewer.show_time(if seconds.is_finite() { seconds.clamp(0.0, viewer.film.end()) } else { 0.0 });
        }
        ClientMessage::StopFilm => viewer.export.cancel.cancel(),
        ClientMessage::Show { scene, is_shown } => match viewer.scenes.layers.get_mut(scene) {
            Some(layer) => layer.is_shown = [is_shown; 2],
            None => return Err(format!("there is no scene {scene}")),
        },
        ClientMessage::Place { scene, placement } => match viewer.scenes.layers.get_mut(scene) {
            Some(layer) => {
                // Paged scenes are drawn as instances, whose limits hold for all scenes: others are refused.
                let found = placement.transform().and_then(|transform| SceneInstances::new(vec![transform]));
                found.map_err(|error| format!("scene {scene} cannot be placed there: {}", error.root_cause()))?;
                layer.placement = placement;
            }
            None => return Err(format!("there is no scene {scene}")),
        },
        ClientMessage::Close { .. } if viewer.scenes.layers.len() == 1 => {
            return Err("the last scene stays open".to_owned());
        }
        ClientMessage::Close { scene } => match viewer.scenes.layers.get(scene).map(|layer| layer.number) {
            Some(number) => viewer.close(number),
            None => return Err(format!("there is no scene {scene}")),
        },
        ClientMessage::Hello { .. }
        | ClientMessage::Film { .. }
        | ClientMessage::Picture { .. }
        | ClientMessage::Rest { .. }
        | ClientMessage::Resize { .. }
        | ClientMessage::Files { .. }
        | ClientMessage::Open { .. }
        | ClientMessage::Shown { .. }
        | ClientMessage::Ping { .. } => return Err("this message is not for the viewer".to_owned()),
    }
    Ok(Vec::new())
}

fn points(measures: &Measures) -> usize {
    measures.all.iter().map(|measure| measure.points.len()).sum()
}

/// True if a point can be added, besides those that are requested.
fn has_room(viewer: &Viewer) -> bool {
    let requested = viewer.requests.iter().filter(|request| matches!(request, Request::Mark(_))).count();
    let measures = &viewer.measures;
    measures.all.len() + requested < MAX_MEASURES && points(measures) + requested < MAX_POINTS
}

/// Checks the number of frames a second of a film.
pub fn check_fps(fps: f64) -> Result<(), String> {
    (1.0..=240.0).contains(&fps).then_some(()).ok_or_else(|| "a film has 1 to 240 frames a second".to_owned())
}

fn check_name(name: &str) -> Result<(), String> {
    let is_short = name.chars().count() <= MAX_NAME;
    is_short.then_some(()).ok_or_else(|| format!("the name of a unit has {MAX_NAME} characters at most"))
}

fn too_many_keys() -> String {
    format!("a path has {MAX_KEYS} keys at most")
}

fn too_much() -> String {
    format!("there are {MAX_MEASURES} measures and {MAX_POINTS} points at most")
}

fn named(name: &str, among: &[Action]) -> Result<Action, String> {
    let found = ACTIONS.iter().find(|(action, known, ..)| *known == name && among.contains(action));
    found.map(|(action, ..)| *action).ok_or_else(|| format!("there is no action {name} here"))
}

fn preset(name: &str) -> Result<Options, String> {
    Options::preset(name).ok_or_else(|| format!("there is no preset {name}"))
}

/// A pixel of the picture.
fn inside(viewer: &Viewer, pixel: [u32; 2]) -> Result<[u32; 2], String> {
    let size = viewer.view.size;
    let is_inside = (0..2).all(|i| pixel[i] < size[i]);
    is_inside.then_some(pixel).ok_or_else(|| format!("the picture has no pixel {}, {}", pixel[0], pixel[1]))
}

fn look(viewer: &mut Viewer, name: &str, range: Option<[f32; 2]>) -> Result<(), String> {
    let mode = view_mode(name).ok_or_else(|| format!("there is no view mode {name}"))?;
    let settings = &mut viewer.inspector.settings;
    let before = std::mem::replace(&mut settings.mode, mode);
    if !settings.view_mode().suits(viewer.scenes.are_paged()) {
        settings.mode = before;
        return Err(format!("{name} does not suit this scene"));
    }
    if let Some([low, high]) = range {
        if !(low.is_finite() && high.is_finite() && low < high) {
            return Err("the low end of a scale is below the high end".to_owned());
        }
        settings.ranges[mode] = [low, high];
    }
    Ok(())
}

fn mode_of(mode: CompareBy) -> CompareMode {
    match mode {
        CompareBy::Split => CompareMode::Split,
        CompareBy::Flicker => CompareMode::Flicker,
        CompareBy::Difference => CompareMode::Difference,
    }
}

/// Begins to choose options.
fn choose(session: &mut Session, budget: BudgetEntry) -> Result<(), String> {
    let (wanted, range) = match budget {
        BudgetEntry::MaxError(error) => (error, MAX_ERRORS),
        BudgetEntry::MinPsnr(psnr) => (psnr, MIN_PSNRS),
    };
    if !range.contains(&wanted) {
        return Err(format!("this budget is from {} to {}", range.start(), range.end()));
    }
    let Some(first) = &session.pair.first else { return Err("there is no picture yet".to_owned()) };
    if first.measured().is_none() {
        return Err(needs_whole("choosing options"));
    }
    let own = &mut session.viewer.measuring.budget;
    match budget {
        BudgetEntry::MaxError(error) => (own.is_psnr, own.max_error) = (false, error),
        BudgetEntry::MinPsnr(psnr) => (own.is_psnr, own.min_psnr) = (true, psnr),
    }
    session.viewer.requests.push(Request::Choose);
    Ok(())
}

/// The keys that are held with others from an event on; `None` if they are those before.
fn held_keys(event: &InputEvent) -> Option<Modifiers> {
    match event {
        InputEvent::Button { held, .. } | InputEvent::Key { held, .. } => Some(modifiers(*held)),
        InputEvent::Blur => Some(Modifiers::NONE),
        _ => None,
    }
}

fn modifiers(Held { shift, ctrl, alt }: Held) -> Modifiers {
    Modifiers { alt, ctrl, shift, mac_cmd: false, command: ctrl }
}

/// The event of egui; `None` if it has none.
fn input(viewer: &Viewer, event: &InputEvent) -> Result<Option<Event>, String> {
    let place = |x: f32, y: f32| {
        let is_near = [x, y].iter().all(|side| side.abs() < 1e6);
        is_near.then_some(Pos2::new(x, y)).ok_or_else(|| "a position is far outside the picture".to_owned())
    };
    Ok(Some(match event {
        InputEvent::Move { x, y } => Event::PointerMoved(place(*x, *y)?),
        InputEvent::Button { x, y, button, is_pressed, held } => Event::PointerButton {
            pos: place(*x, *y)?,
            button: match button {
                Button::Left => PointerButton::Primary,
                Button::Middle => PointerButton::Middle,
                Button::Right => PointerButton::Secondary,
            },
            pressed: *is_pressed,
            modifiers: modifiers(*held),
        },
        InputEvent::Wheel { points } => Event::MouseWheel {
            unit: MouseWheelUnit::Point,
            delta: Vec2::new(0.0, if points.is_finite() { points.clamp(-2000.0, 2000.0) } else { 0.0 }),
            phase: TouchPhase::Move,
            modifiers: Modifiers::NONE,
        },
        InputEvent::Zoom { factor } => Event::Zoom(if factor.is_finite() { factor.clamp(0.1, 10.0) } else { 1.0 }),
        InputEvent::Key { action, is_pressed, held } => match viewer.setup.bindings.chord(named(action, &HELD)?) {
            Chord::Key(shortcut) => Event::Key {
                key: shortcut.logical_key,
                physical_key: None,
                pressed: *is_pressed,
                repeat: false,
                modifiers: modifiers(*held),
            },
            // The keys that are held with others have an event of their own.
            Chord::Held(_) => return Ok(None),
        },
        InputEvent::Gone => Event::PointerGone,
        InputEvent::Blur => Event::WindowFocused(false),
    }))
}
