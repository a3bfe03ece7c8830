//! The timeline under the picture.

use egui::{Event, Modifiers, PointerButton, Pos2, pos2};
use smalto::viewer::{Offscreen, Setup, Tab};

use super::frames::setup;
use super::interaction::frame;
use crate::common::Gpu;

const WINDOW: [u32; 2] = [1040, 300];

fn button(pos: Pos2, pressed: bool) -> Event {
    Event::PointerButton { pos, button: PointerButton::Primary, pressed, modifiers: Modifiers::NONE }
}

fn click(offscreen: &mut Offscreen, at: Pos2) {
    frame(offscreen, vec![Event::PointerMoved(at)]);
    frame(offscreen, vec![button(at, true)]);
    frame(offscreen, vec![button(at, false)]);
    offscreen.settle().unwrap();
}

/// Keys are added by the first button, shown by a click, moved in time by a drag; a drag elsewhere scrubs; all is
/// undone.
#[test]
fn keys_are_added_moved_and_shown_in_the_timeline() {
    let gpu = Gpu::new();
    let setup = Setup { hides_panels: false, ..setup(&["cactus:500"]) };
    let mut offscreen = Offscreen::new(setup, &gpu.0, WINDOW).unwrap();
    offscreen.settle().unwrap();
    let whole = offscreen.viewer().view.size;
    offscreen.viewer().panels.recent.tab = Tab::Path;
    frame(&mut offscreen, Vec::new());
    offscreen.settle().unwrap();
    let [width, height] = offscreen.viewer().view.size;
    assert!(width == whole[0] && height < whole[1] - 50, "the strip takes {} rows", whole[1] - height);
    let add = pos2(20.0, height as f32 + 14.0);
    let first = offscreen.viewer().view.camera();
    click(&mut offscreen, add);
    offscreen.viewer().view.navigator.orbit(glam::DVec2::new(40.0, 10.0), [width, height]);
    offscreen.settle().unwrap();
    let second = offscreen.viewer().view.camera();
    click(&mut offscreen, add);
    let seconds =
        |offscreen: &mut Offscreen| offscreen.viewer().film.timeline.keys().iter().map(|key| key.seconds).collect();
    let keys: Vec<f64> = seconds(&mut offscreen);
    assert_eq!(keys, [0.0, 2.0]);
    // The track begins a margin right of the edge and shows a tenth more than the path has.
    let track = (20.0, width as f32 - 40.0);
    let x = |seconds: f64| track.0 + track.1 * (seconds / 2.2) as f32;
    let of_keys = height as f32 + 35.0;
    click(&mut offscreen, pos2(x(0.0), of_keys));
    assert!(offscreen.viewer().view.camera() == first && offscreen.viewer().film.now == 0.0);
    click(&mut offscreen, pos2(x(2.0), of_keys));
    let apart = offscreen.viewer().view.camera().position.distance(second.position);
    assert!(apart < 1e-9 && offscreen.viewer().film.now == 2.0, "{apart} at {}", offscreen.viewer().film.now);
    // The last key is dragged back.
    let (from, to) = (pos2(x(2.0), of_keys), pos2(x(1.0), of_keys));
    frame(&mut offscreen, vec![Event::PointerMoved(from)]);
    frame(&mut offscreen, vec![button(from, true)]);
    frame(&mut offscreen, vec![Event::PointerMoved(from.lerp(to, 0.5))]);
    frame(&mut offscreen, vec![Event::PointerMoved(to)]);
    frame(&mut offscreen, vec![button(to, false)]);
    offscreen.settle().unwrap();
    let keys: Vec<f64> = seconds(&mut offscreen);
    assert!(keys[0] == 0.0 && (keys[1] - 1.0).abs() < 0.03, "{keys:?}");
    // Between the keys is a view between theirs.
    let x = |seconds: f64| track.0 + track.1 * (seconds / (1.1 * keys[1])) as f32;
    click(&mut offscreen, pos2(x(0.5), height as f32 + 55.0));
    let viewer = offscreen.viewer();
    let due = viewer.film.timeline.at(viewer.film.now).unwrap();
    assert!((viewer.film.now - 0.5).abs() < 0.03 && viewer.view.camera() == due, "{}", viewer.film.now);
    for expected in [vec![0.0, keys[1]], vec![0.0, 2.0]] {
        while seconds(&mut offscreen) != expected {
            offscreen.viewer().undo(false);
        }
    }
}
