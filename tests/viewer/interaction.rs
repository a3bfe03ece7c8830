//! Interaction: drags, undo, references, explained pixels, and written files keep what users set and see.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use egui::{Event, Key, Modifiers, PointerButton, Pos2, pos2, vec2};
use glam::DVec2;
use smalto::camera::{Camera, Navigator};
use smalto::pixels::{Alpha, Pixels};
use smalto::render::SelectionMode;
use smalto::rules::Background;
use smalto::viewer::{
    CompareMode, CompareTarget, CompareWith, Offscreen, Property, Request, Selection, Setup, view_mode,
};

use super::frames::{SIZE, open, setup, shown};
use crate::common::Gpu;

fn button(pos: Pos2, button: PointerButton, pressed: bool) -> Event {
    Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE }
}

pub(super) fn key(key: Key, modifiers: Modifiers) -> Event {
    Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers }
}

/// A frame whose layout handles these events: the one before may be so recent that there is none.
pub(super) fn frame(offscreen: &mut Offscreen, events: Vec<Event>) {
    let mut events = Some(events);
    while offscreen.frame(events.take().unwrap_or_default()).unwrap().platform.is_none() {
        std::thread::sleep(Duration::from_millis(3));
    }
}

/// A drag, with so many of its events in each frame.
pub(super) fn drag(offscreen: &mut Offscreen, which: PointerButton, way: [f32; 2], points: usize, in_a_frame: usize) {
    let at = |i: usize| pos2(20.0 + way[0] * i as f32 / points as f32, 20.0 + way[1] * i as f32 / points as f32);
    let moves = (1..=points).map(|i| Event::PointerMoved(at(i)));
    let begin = [Event::PointerMoved(at(0)), button(at(0), which, true)];
    let events: Vec<Event> = begin.into_iter().chain(moves).chain([button(at(points), which, false)]).collect();
    events.chunks(in_a_frame).for_each(|events| frame(offscreen, events.to_vec()));
}

/// Degrees between the directions of two views.
fn turned(a: &Camera, b: &Camera) -> f64 {
    a.forward().angle_between(b.forward()).to_degrees()
}

/// A drag turns by what it is long, to the last point, however few frames there are.
#[test]
fn nothing_of_a_drag_is_lost() {
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["cactus:500"]));
    let first = offscreen.viewer().view.camera();
    let due = |navigator: &mut Navigator, which, way| match which {
        PointerButton::Primary => navigator.orbit(way, SIZE),
        PointerButton::Secondary => navigator.look(way, SIZE),
        _ => navigator.pan(way, SIZE),
    };
    for which in [PointerButton::Primary, PointerButton::Secondary, PointerButton::Middle] {
        // A nudge, a slow drag with frames between, a flick within a frame.
        for (way, points, in_a_frame) in [([2.0, 0.0], 1, 1), ([100.0, 0.0], 20, 1), ([100.0, 0.0], 20, 100)] {
            offscreen.viewer().view.navigator.snap(&first);
            let mut expected = offscreen.viewer().view.navigator.clone();
            drag(&mut offscreen, which, way, points, in_a_frame);
            due(&mut expected, which, DVec2::new(way[0].into(), way[1].into()));
            let (found, expected) = (offscreen.viewer().view.camera(), expected.camera(SIZE));
            let (angle, angle_due) = (turned(&first, &found), turned(&first, &expected));
            let moved = [&found, &expected].map(|view| view.position.distance(first.position));
            assert!((angle - angle_due).abs() <= 0.02 * angle_due, "{which:?} {way:?}: {angle} of {angle_due} degrees");
            assert!((moved[0] - moved[1]).abs() <= 0.02 * moved[1] + 1e-9, "{which:?} {way:?}: {moved:?}");
            assert!(angle_due + moved[1] > 0.0, "there is a motion");
        }
    }
}

/// The path takes the time that it says, and so does flying, at any rate of frames.
#[test]
fn slow_frames_lose_no_time() {
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["cactus:500"]));
    let viewer = offscreen.viewer();
    viewer.add_key();
    viewer.view.navigator.orbit(DVec2::new(40.0, 10.0), SIZE);
    viewer.film.step = 30.0;
    viewer.add_key();
    viewer.show_time(0.0);
    viewer.film.toggle();
    let timed = |offscreen: &mut Offscreen, events: Vec<Event>| {
        let begun = Instant::now();
        frame(offscreen, events);
        (begun, Instant::now())
    };
    let first = timed(&mut offscreen, Vec::new());
    let from = offscreen.viewer().film.now;
    let mut last = first;
    for _ in 0..3 {
        std::thread::sleep(Duration::from_millis(400));
        last = timed(&mut offscreen, Vec::new());
    }
    // Each of the two frames reads the clock between its begin and its end.
    let between = |first: (Instant, Instant), last: (Instant, Instant)| {
        (last.0 - first.1).as_secs_f64()..=(last.1 - first.0).as_secs_f64()
    };
    let shown = offscreen.viewer().film.now - from;
    assert!(between(first, last).contains(&shown), "{shown} s of {:?}", between(first, last));
    offscreen.viewer().film.toggle();
    // A key that is held from one frame to the next flies all of the time between them.
    let speed = offscreen.viewer().view.navigator.speed();
    let first = timed(&mut offscreen, vec![key(Key::W, Modifiers::NONE)]);
    let from = offscreen.viewer().view.camera().position;
    std::thread::sleep(Duration::from_millis(700));
    let last = timed(&mut offscreen, Vec::new());
    let flown = offscreen.viewer().view.camera().position.distance(from) / speed;
    assert!(between(first, last).contains(&flown), "{flown} s of {:?}", between(first, last));
}

#[test]
fn changes_are_undone_and_made_again() {
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["cactus:2000"]));
    let press = |offscreen: &mut Offscreen, which| {
        frame(offscreen, vec![key(which, Modifiers::COMMAND)]);
        offscreen.viewer().messages = Default::default();
        offscreen.settle().unwrap();
    };
    let mut seen = vec![shown(&mut offscreen)];
    let changes: [fn(&mut Offscreen); 4] = [
        |offscreen| drag(offscreen, PointerButton::Primary, [50.0, 20.0], 5, 2),
        |offscreen| offscreen.viewer().options.scale = 0.5,
        |offscreen| offscreen.viewer().scenes.layers[0].placement.rotation = [40.0, 0.0, 0.0],
        |offscreen| offscreen.viewer().view.background = Background::Colour([0.2, 0.4, 0.6]),
    ];
    for change in changes {
        change(&mut offscreen);
        offscreen.viewer().pictures.are_stale = true;
        frame(&mut offscreen, Vec::new());
        offscreen.settle().unwrap();
        seen.push(shown(&mut offscreen));
    }
    for i in (0..4).rev() {
        assert!(seen[i] != seen[i + 1], "change {i} is seen");
        press(&mut offscreen, Key::Z);
        assert!(shown(&mut offscreen) == seen[i], "change {i} is undone");
    }
    press(&mut offscreen, Key::Z);
    assert!(shown(&mut offscreen) == seen[0], "what the scene brought is no change");
    for (i, after) in seen.iter().enumerate().skip(1) {
        press(&mut offscreen, Key::Y);
        assert!(shown(&mut offscreen) == *after, "change {i} is made again");
    }
    // A new change after an undo leaves nothing to redo.
    press(&mut offscreen, Key::Z);
    offscreen.viewer().add_key();
    press(&mut offscreen, Key::Y);
    assert!(shown(&mut offscreen) == seen[3]);
    press(&mut offscreen, Key::Z);
    assert!(offscreen.viewer().film.timeline.keys().is_empty(), "a key is a change");
}

fn hide_some(offscreen: &mut Offscreen) {
    let faint = Selection::Values(Property::Opacity, 0.0..=0.7);
    offscreen.viewer().select(&faint, SelectionMode::Replace);
    offscreen.settle().unwrap();
    // A selection alone changes nothing that is compared.
    assert_eq!(offscreen.session.viewer.mismatch(&offscreen.session.pair), None);
    offscreen.viewer().change(smalto::viewer::Change::Hide);
    // The note lies over the picture.
    offscreen.viewer().messages = Default::default();
}

/// What is shown, named, measured and read under the cursor of a second picture asks what it was drawn of.
#[test]
fn a_second_picture_of_something_else_is_not_shown_named_or_measured() {
    let gpu = Gpu::new();
    let compares_with = Some(CompareWith::Reference);
    let mut offscreen = open(&gpu, Setup { compares_with, ..setup(&["cactus:1000", "few-large:20"]) });
    offscreen.viewer().comparison.mode = CompareMode::Difference;
    let hover = |offscreen: &mut Offscreen| {
        offscreen.settle().unwrap();
        frame(offscreen, vec![Event::PointerMoved(pos2(60.0, 50.0))]);
        offscreen.settle().unwrap();
    };
    hover(&mut offscreen);
    let first_numbers = offscreen.viewer().comparison.pair_difference.clone().expect("both pictures are measured");
    let amplified = shown(&mut offscreen);
    let pose = offscreen.viewer().view.navigator.clone();
    let [near, stop] = [offscreen.viewer().options.rules.near, offscreen.viewer().options.stop];
    type Change = (&'static str, fn(&mut Offscreen), Option<&'static str>);
    let changes: [Change; 7] = [
        ("turn", |of| of.viewer().view.navigator.orbit(DVec2::new(30.0, 0.0), SIZE), Some("another view")),
        (
            "place",
            |of| of.viewer().scenes.layers[0].placement.translation = [0.5, 0.0, 0.0],
            Some("other scenes or places"),
        ),
        ("near", |of| of.viewer().options.rules.near = 6.0, Some("other rules")),
        ("hide", |of| of.viewer().scenes.layers[1].is_shown[0] = false, Some("other scenes or places")),
        ("background", |of| of.viewer().view.background = Background::Colour([1.0; 3]), Some("another background")),
        ("edit", hide_some, Some("another edit")),
        // What trades accuracy is what one compares.
        ("knob", |of| of.viewer().options.stop = 0.01, None),
    ];
    for (name, change, expected) in changes {
        change(&mut offscreen);
        offscreen.viewer().pictures.are_stale = true;
        hover(&mut offscreen);
        assert_eq!(offscreen.session.viewer.mismatch(&offscreen.session.pair), expected, "{name}");
        let plain = {
            let viewer = offscreen.viewer();
            let target = std::mem::replace(&mut viewer.comparison.target, CompareTarget::Nothing);
            offscreen.settle().unwrap();
            let plain = shown(&mut offscreen);
            offscreen.viewer().comparison.target = target;
            hover(&mut offscreen);
            plain
        };
        assert_eq!(shown(&mut offscreen) == plain, expected.is_some(), "{name}: the picture");
        let snapshot = offscreen.viewer().inspector.snapshot.as_ref().expect("the picture is at rest");
        assert_eq!(snapshot.second.is_none(), expected.is_some(), "{name}: the values under the cursor");
        let number = snapshot.number;
        let measured = offscreen.viewer().comparison.pair_difference.as_ref().unwrap().number == number;
        assert_eq!(measured, expected.is_none(), "{name}: the numbers");
        let viewer = offscreen.viewer();
        viewer.view.navigator = pose.clone();
        viewer.scenes.layers[0].placement.translation = [0.0; 3];
        viewer.scenes.layers[1].is_shown[0] = true;
        viewer.change(smalto::viewer::Change::ShowHidden);
        viewer.view.background = Background::BLACK;
        (viewer.options.rules.near, viewer.options.stop) = (near, stop);
        // Until the scenes are on the GPU again, the picture is still the one of the change.
        if name == "place" {
            assert_eq!(offscreen.session.viewer.mismatch(&offscreen.session.pair), expected, "undone, not drawn");
        }
        offscreen.viewer().pictures.are_stale = true;
        hover(&mut offscreen);
        assert_eq!(offscreen.session.viewer.mismatch(&offscreen.session.pair), None, "{name} is undone");
        assert!(shown(&mut offscreen) == amplified, "{name} is undone");
        let numbers = offscreen.viewer().comparison.pair_difference.clone().unwrap();
        assert_eq!(numbers.difference, first_numbers.difference, "{name} is undone");
    }
    let number = offscreen.viewer().scenes.layers[1].number;
    offscreen.viewer().close(number);
    offscreen.settle().unwrap();
    let mismatch = offscreen.session.viewer.mismatch(&offscreen.session.pair);
    assert_eq!(mismatch, Some("other scenes or places"));
}

/// The pixel under the cursor is explained: of the second picture right of the split.
#[test]
fn the_picture_under_the_cursor_is_explained() {
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["cactus:2000", "few-large:300"]));
    offscreen.viewer().comparison.target = CompareTarget::Options(None);
    offscreen.viewer().scenes.layers[0].is_shown = [true, false];
    offscreen.viewer().scenes.layers[1].is_shown = [false, true];
    offscreen.settle().unwrap();
    let screen = shown(&mut offscreen);
    let brightest = |from: u32, to: u32| {
        let all = (from..to).flat_map(|x| (10..86).map(move |y| [x, y]));
        let light = |[x, y]: &[u32; 2]| (1e6 * screen.at(*x, *y)[..3].iter().sum::<f32>()) as u64;
        all.max_by_key(light).unwrap()
    };
    for pixel in [brightest(20, 78), brightest(84, 140)] {
        offscreen.viewer().requests.push(Request::Pick(pixel));
        frame(&mut offscreen, Vec::new());
        let background = offscreen.viewer().view.background;
        let explained = offscreen.viewer().inspector.explanation.take().unwrap();
        let colour = explained.explanation.colour(background);
        let seen = screen.at(pixel[0], pixel[1]);
        let apart = (0..3).map(|i| (colour[i].clamp(0.0, 1.0) - seen[i]).abs()).fold(0.0, f32::max);
        assert!(apart < 1.5 / 255.0 && seen[..3] != [0.0; 3], "{pixel:?}: {colour:?} is shown as {seen:?}");
    }
    // A picture that the GPU did not draw has nothing to explain.
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("photo.png");
    Pixels { size: SIZE, rgba: vec![[0.5; 4]; 160 * 96] }.write(&file, Alpha::Opaque).unwrap();
    offscreen.viewer().drop_file(&file);
    offscreen.settle().unwrap();
    offscreen.viewer().requests.push(Request::Pick([120, 48]));
    frame(&mut offscreen, Vec::new());
    assert!(offscreen.viewer().inspector.explanation.is_none());
    let said = offscreen.viewer().messages.shown().iter().any(|message| message.text.contains("has no Gaussians"));
    assert!(said, "it says why");
}

/// What is written is what is seen, and no picture replaces another.
#[test]
fn what_is_seen_is_written() {
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let mut offscreen = open(&gpu, setup(&["cactus:2000"]));
    let file = |name: &str| folder.path().join(name);
    offscreen.viewer().export.picture = file("view.png").display().to_string();
    let write = |offscreen: &mut Offscreen, name: &str| {
        offscreen.viewer().messages = Default::default();
        offscreen.viewer().pictures.are_stale = true;
        offscreen.settle().unwrap();
        let mut screen = shown(offscreen);
        offscreen.viewer().requests.push(Request::WritePicture(None));
        offscreen.settle().unwrap();
        let told = offscreen.viewer().messages.shown().last().unwrap().text.clone();
        assert!(told.contains(&file(name).display().to_string()), "{told}");
        let written = Pixels::read(&file(name)).unwrap();
        screen.rgba.iter_mut().for_each(|pixel| pixel[3] = 1.0);
        assert!(written == screen, "{name}");
        written
    };
    let colours = write(&mut offscreen, "view.png");
    offscreen.viewer().inspector.settings.mode = view_mode("normals").unwrap();
    offscreen.settle().unwrap();
    let normals = write(&mut offscreen, "view-2.png");
    offscreen.viewer().inspector.settings.mode = 0;
    offscreen.viewer().comparison.target = CompareTarget::Options(Some(smalto::options::Options::PREVIEW));
    offscreen.viewer().comparison.mode = CompareMode::Difference;
    offscreen.settle().unwrap();
    let difference = write(&mut offscreen, "view-3.png");
    assert!(colours != normals && colours != difference && normals != difference);
    assert!(Pixels::read(&file("view.png")).unwrap() == colours, "the first is as it was");
}

/// However many frames a turn of the wheel takes, it is one step.
#[test]
fn a_turn_of_the_wheel_is_undone_at_once() {
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["cactus:500"]));
    frame(&mut offscreen, Vec::new());
    let first = offscreen.viewer().view.camera();
    for turned in [120.0, -300.0] {
        let (unit, phase) = (egui::MouseWheelUnit::Point, egui::TouchPhase::Move);
        let wheel = Event::MouseWheel { unit, delta: vec2(0.0, turned), phase, modifiers: Modifiers::NONE };
        frame(&mut offscreen, vec![Event::PointerMoved(pos2(80.0, 40.0)), wheel]);
        let begun = offscreen.viewer().view.camera();
        while offscreen.session.context().input(|input| input.is_scrolling()) {
            std::thread::sleep(Duration::from_millis(10));
            frame(&mut offscreen, Vec::new());
        }
        assert!(begun != first && offscreen.viewer().view.camera() != begun, "it goes on");
        offscreen.viewer().undo(false);
        assert_eq!(offscreen.viewer().view.camera(), first);
    }
}

/// A message is in its place in the first frame that shows it: on a slow device the next one comes much later.
#[test]
fn a_message_is_laid_out_at_once() {
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["cactus:500"]));
    offscreen.session.context().global_style_mut(|style| style.animation_time = 1000.0);
    let before = shown(&mut offscreen);
    offscreen.viewer().messages.error("what is wrong");
    frame(&mut offscreen, Vec::new());
    let at_once = shown(&mut offscreen);
    frame(&mut offscreen, Vec::new());
    assert!(at_once != before && shown(&mut offscreen) == at_once);
}

/// After the last scene is closed, the next one is the first.
#[test]
fn a_scene_after_the_last_one_is_framed() {
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let mut offscreen = open(&gpu, setup(&["few-large:50"]));
    let alone = offscreen.viewer().view.camera();
    let cameras = folder.path().join("cameras.json");
    smalto::camera::write(&cameras, &[smalto::camera::NamedCamera::new("a".to_owned(), alone.clone())]).unwrap();
    offscreen.viewer().drop_file(&cameras);
    offscreen.settle().unwrap();
    offscreen.viewer().view.navigator.orbit(DVec2::new(300.0, 40.0), SIZE);
    let number = offscreen.viewer().scenes.layers[0].number;
    offscreen.viewer().close(number);
    offscreen.settle().unwrap();
    offscreen.viewer().toggle_frozen_culling();
    assert!(offscreen.viewer().inspector.settings.culled_from.is_none(), "there is nothing to cull");
    offscreen.viewer().drop_file(&PathBuf::from("  'few-large:50' "));
    offscreen.settle().unwrap();
    assert!(offscreen.viewer().cameras.list.is_empty() && offscreen.viewer().view.camera() == alone);
}

/// After the view has left a camera, the next one is the one behind it.
#[test]
fn the_next_camera_follows_the_last_one() {
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let mut offscreen = open(&gpu, setup(&["cactus:500"]));
    let cameras: Vec<_> = (0..5)
        .map(|i| {
            offscreen.viewer().view.navigator.orbit(DVec2::new(10.0, 0.0), SIZE);
            smalto::camera::NamedCamera::new(format!("{i}"), offscreen.viewer().view.camera())
        })
        .collect();
    let file = folder.path().join("cameras.json");
    smalto::camera::write(&file, &cameras).unwrap();
    offscreen.viewer().drop_file(&file);
    offscreen.settle().unwrap();
    offscreen.viewer().go_to_camera(3, true);
    drag(&mut offscreen, PointerButton::Primary, [3.0, 0.0], 1, 5);
    assert_eq!(offscreen.viewer().view.camera_index, None, "the view has left it");
    offscreen.viewer().step_camera(true);
    assert_eq!(offscreen.viewer().view.camera_index, Some(4));
    offscreen.viewer().frame_scene();
    assert_eq!(offscreen.viewer().view.camera_index, None);
    // The speed of flying and the near plane stay where the view is reset.
    offscreen.viewer().view.navigator.set_speed(9.0);
    offscreen.viewer().options.rules.near = 0.3;
    offscreen.viewer().reset_view();
    assert_eq!((offscreen.viewer().view.navigator.speed(), offscreen.viewer().options.rules.near), (9.0, 0.3));
}

/// What is in a file and not drawn is said, in the window and on the terminal.
#[test]
fn dropped_gaussians_are_said() {
    use std::sync::Mutex;
    static SAID: Mutex<Vec<String>> = Mutex::new(Vec::new());
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let file = folder.path().join("half.ply");
    let mut text = "ply\nformat ascii 1.0\nelement vertex 20\n".to_owned();
    let names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    names.split(' ').for_each(|name| text += &format!("property float {name}\n"));
    text += "end_header\n";
    for i in 0..20 {
        let x = if i % 2 == 0 { "nan".to_owned() } else { format!("{i}") };
        text += &format!("{x} 0 0 1 1 1 2 0 0 0 1 0 0 0\n");
    }
    std::fs::write(&file, text).unwrap();
    let remark = |text: &str| SAID.lock().unwrap().push(text.to_owned());
    let mut offscreen = open(&gpu, Setup { remark, ..setup(&[file.to_str().unwrap()]) });
    let expected = "warning: half.ply: of 20 Gaussians 10 dropped as not finite";
    assert!(offscreen.viewer().messages.shown().iter().any(|message| message.text.starts_with(expected)));
    assert!(SAID.lock().unwrap().iter().any(|text| text.starts_with(expected)));
}

/// A preset is what it says, whichever was chosen before it.
#[test]
fn presets_do_not_depend_on_those_before() {
    use smalto::options::Options;
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["few-large:50"]));
    let first = offscreen.viewer().options;
    assert_eq!(offscreen.viewer().preset(&Options::BALANCED), first, "the one that it begins with");
    for (_, preset) in &Options::PRESETS {
        offscreen.viewer().options = offscreen.viewer().preset(preset);
    }
    offscreen.viewer().options.splats = 7;
    let again = offscreen.viewer().preset(&Options::BALANCED);
    assert_eq!(again, Options { splats: 7, ..first }, "how much of levels is drawn stays");
}

/// A measurement that is cancelled ends, says so, and leaves the figures that were there.
#[test]
fn a_measurement_can_be_cancelled() {
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["cactus:2000"]));
    for request in [Request::Measure, Request::Choose] {
        offscreen.viewer().requests.push(request);
        frame(&mut offscreen, Vec::new());
        offscreen.viewer().measuring.running.as_ref().unwrap().cancel.cancel();
        offscreen.settle().unwrap();
        assert!(offscreen.viewer().measuring.costs.is_none() && offscreen.viewer().measuring.budget.chosen.is_none());
        let said = offscreen.viewer().messages.shown().iter().any(|message| message.text.ends_with("was cancelled"));
        assert!(said && offscreen.viewer().measuring.running.is_none());
        offscreen.viewer().messages = Default::default();
    }
}
