//! The order of events: a slow frame does what fast ones do.

use egui::{Event, Key, Modifiers, PointerButton, Pos2, pos2};
use smalto::viewer::{Counts, Offscreen, Setup, Tab, Tool};

use super::frames::setup;
use super::interaction::{frame, key};
use crate::common::Gpu;

fn editing(gpu: &Gpu) -> Offscreen {
    let setup = Setup { hides_panels: false, ..setup(&["cactus:2000"]) };
    let mut offscreen = Offscreen::new(setup, &gpu.0, [700, 240]).unwrap();
    offscreen.viewer().panels.recent.tab = Tab::Edit;
    offscreen.settle().unwrap();
    offscreen
}

fn stroke(from: Pos2, to: Pos2) -> Vec<Event> {
    let button = |pos, pressed| Event::PointerButton {
        pos,
        button: PointerButton::Primary,
        pressed,
        modifiers: Modifiers::NONE,
    };
    vec![Event::PointerMoved(from), button(from, true), Event::PointerMoved(to), button(to, false)]
}

/// Strokes and keys, all in one frame, have the effect of a frame each, and as many undo steps.
#[test]
fn a_slow_frame_does_what_fast_ones_do() {
    let gpu = Gpu::new();
    let presses = |which: Key, modifiers: Modifiers| {
        let release = Event::Key { key: which, physical_key: None, pressed: false, repeat: false, modifiers };
        vec![key(which, modifiers), release]
    };
    let undo = || presses(Key::Z, Modifiers::COMMAND);
    let (left, right) = (stroke(pos2(60.0, 30.0), pos2(170.0, 200.0)), stroke(pos2(190.0, 20.0), pos2(280.0, 220.0)));
    let steps = [
        presses(Key::Num2, Modifiers::NONE),
        left.clone(),
        presses(Key::Delete, Modifiers::NONE),
        presses(Key::Num6, Modifiers::NONE),
        stroke(pos2(185.0, 130.0), pos2(200.0, 140.0)),
        presses(Key::Delete, Modifiers::NONE),
        presses(Key::Num2, Modifiers::NONE),
        right,
        presses(Key::B, Modifiers::NONE),
        presses(Key::A, Modifiers::COMMAND),
        presses(Key::Delete, Modifiers::NONE),
        undo(),
        undo(),
        stroke(pos2(60.0, 30.0), pos2(280.0, 220.0)),
    ];
    let counts = |in_one_frame: bool| {
        let mut offscreen = editing(&gpu);
        if in_one_frame {
            frame(&mut offscreen, steps.concat());
        } else {
            for step in &steps {
                frame(&mut offscreen, step.clone());
                offscreen.settle().unwrap();
            }
        }
        offscreen.settle().unwrap();
        assert_eq!(offscreen.viewer().editing.tool, Tool::Rectangle);
        let mut counts = vec![offscreen.viewer().scenes.edit_counts()];
        for _ in 0..7 {
            frame(&mut offscreen, undo());
            offscreen.settle().unwrap();
            counts.push(offscreen.viewer().scenes.edit_counts());
        }
        counts
    };
    let [fast, slow] = [false, true].map(counts);
    assert_eq!(slow, fast);
    let [now, before, .., last] = fast[..] else { unreachable!("there are eight") };
    assert!(now.selected > 0 && now.deleted > 0 && now.hidden > 0, "{now:?}");
    assert!(before.selected == 0 && before.hidden == now.hidden && last == Counts::default(), "{fast:?}");
}

/// A key explains the pixel that was under the cursor when it was pressed.
#[test]
fn a_key_is_of_the_pixel_under_the_cursor_at_its_time() {
    let gpu = Gpu::new();
    let mut offscreen = editing(&gpu);
    let [there, then] = [pos2(180.5, 120.5), pos2(30.5, 20.5)].map(Event::PointerMoved);
    frame(&mut offscreen, vec![there, key(Key::X, Modifiers::NONE), then]);
    let explained = offscreen.viewer().inspector.explanation.as_ref().map(|explained| explained.pixel);
    assert_eq!(explained, Some([180, 120]));
}
