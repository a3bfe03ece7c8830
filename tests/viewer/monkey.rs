//! The viewer under random input.

use egui::{Event, Key, Modifiers, PointerButton, pos2};

use super::frames::{open, setup, shown};
use super::interaction::{drag, frame, key};
use crate::common::Gpu;
use crate::common::random::Random;

/// Random drags, scrolls and keys: no crash, no message of the validation layer, and undo leads back to the first
/// picture.
#[test]
fn a_monkey_breaks_nothing() {
    act_at_random(200);
}

#[test]
#[ignore = "long: a thousand actions"]
fn long_a_monkey_breaks_nothing() {
    act_at_random(1000);
}

fn act_at_random(actions: u32) {
    const KEYS: [Key; 17] = [
        Key::V,
        Key::B,
        Key::Delete,
        Key::U,
        Key::C,
        Key::R,
        Key::H,
        Key::K,
        Key::L,
        Key::J,
        Key::I,
        Key::O,
        Key::X,
        Key::N,
        Key::G,
        Key::Escape,
        Key::Questionmark,
    ];
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["cactus:300"]));
    let (view, first) = (offscreen.viewer().view.camera(), shown(&mut offscreen));
    let mut random = Random(7);
    for _ in 0..actions {
        match random.below(6) {
            0 | 1 => {
                let which = [PointerButton::Primary, PointerButton::Secondary, PointerButton::Middle];
                let way = [0; 2].map(|_| random.between(-60.0, 60.0) as f32);
                drag(&mut offscreen, which[random.below(3) as usize], way, 4, 1 + random.below(7) as usize);
            }
            2 => {
                let delta = egui::vec2(0.0, random.between(-80.0, 80.0) as f32);
                let (unit, phase) = (egui::MouseWheelUnit::Point, egui::TouchPhase::Move);
                let wheel = Event::MouseWheel { unit, delta, phase, modifiers: Modifiers::NONE };
                frame(&mut offscreen, vec![Event::PointerMoved(pos2(70.0, 40.0)), wheel]);
            }
            3 => frame(&mut offscreen, vec![key([Key::Z, Key::Y][random.below(2) as usize], Modifiers::COMMAND)]),
            _ => {
                let press = key(KEYS[random.below(17) as usize], Modifiers::NONE);
                frame(&mut offscreen, vec![Event::PointerMoved(pos2(70.0, 40.0)), press]);
            }
        }
    }
    // What is seen depends on more than what can be undone.
    let viewer = offscreen.viewer();
    viewer.film.is_playing = false;
    viewer.panels.are_hidden = true;
    viewer.panels.shows_help = false;
    (viewer.inspector.explanation, viewer.inspector.settings.mode, viewer.inspector.settings.culled_from) =
        (None, 0, None);
    while offscreen.viewer().view.navigator.is_gliding()
        || offscreen.session.context().input(|input| input.is_scrolling())
    {
        frame(&mut offscreen, Vec::new());
    }
    for _ in 0..2 * actions {
        offscreen.viewer().undo(false);
    }
    offscreen.viewer().messages = Default::default();
    frame(&mut offscreen, Vec::new());
    offscreen.settle().unwrap();
    assert!(offscreen.viewer().view.camera() == view && offscreen.viewer().film.timeline.keys().is_empty());
    assert!(shown(&mut offscreen) == first, "every bit of the first picture");
    assert_eq!(gpu.0.validation_messages(), Vec::<String>::new());
}
