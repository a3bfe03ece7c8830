//! Pictures in motion that keep a rate, and drags at 60 and at 2 frames a second.

use egui::{Event, Key, Modifiers, PointerButton, pos2};
use smalto::options::Options;
use smalto::viewer::{CompareWith, Request, Setup, view_mode};

use super::frames::{SIZE, open, setup};
use super::interaction::{frame, key};
use crate::common::Gpu;

/// Slow pictures have a lower scale as long as the view moves, but not what is written, and at rest they are whole.
#[test]
fn slow_pictures_in_motion_have_a_lower_scale() {
    let gpu = Gpu::new();
    let folder = tempfile::tempdir().unwrap();
    // No device draws so fast.
    let setup = Setup { fps: Some(1e4), ..setup(&["cactus:3000"]) };
    let mut offscreen = open(&gpu, setup);
    assert_eq!(offscreen.viewer().options.scale, 1.0);
    let press = |at: f32, pressed| {
        let (pos, button, modifiers) = (pos2(at, 40.0), PointerButton::Primary, Modifiers::NONE);
        vec![Event::PointerMoved(pos), Event::PointerButton { pos, button, pressed, modifiers }]
    };
    frame(&mut offscreen, press(30.0, true));
    let mut at = 30.0;
    while offscreen.session.pair.first.as_ref().unwrap().plan.options.scale > 0.3 {
        at += 0.1;
        frame(&mut offscreen, vec![Event::PointerMoved(pos2(at, 40.0))]);
    }
    let viewer = offscreen.viewer();
    assert_eq!((viewer.options.scale, viewer.timing.motion_scale()), (1.0, 0.25));
    assert!(offscreen.session.title().ends_with("(moving, at scale 0.25) - smalto"), "{}", offscreen.session.title());
    // What is written has the scale that the options ask for; what is on the screen is not written.
    let file = folder.path().join("moving.png");
    offscreen.viewer().export.picture = file.display().to_string();
    frame(&mut offscreen, vec![key(Key::F12, Modifiers::NONE)]);
    let moving = offscreen.viewer().view.camera();
    offscreen.viewer().inspector.settings.mode = view_mode("depth").unwrap();
    offscreen.viewer().requests.extend([Request::WritePicture(None), Request::Mark([80, 48])]);
    frame(&mut offscreen, Vec::new());
    let said: Vec<_> = offscreen.viewer().messages.shown().iter().map(|message| message.text.clone()).collect();
    assert!(said.iter().any(|text| text.contains("ask again when it rests")), "{said:?}");
    assert!(offscreen.viewer().measures.all.is_empty());
    offscreen.viewer().messages.close_errors();
    offscreen.viewer().inspector.settings.mode = 0;
    frame(&mut offscreen, press(at, false));
    offscreen.settle().unwrap();
    assert_eq!(offscreen.viewer().timing.motion_scale(), 1.0);
    assert!(!offscreen.session.title().contains("scale"));
    let gaussians = offscreen.session.pair.first.as_ref().unwrap().gaussians.clone().unwrap();
    let options = offscreen.viewer().options;
    let bytes = |pixels: smalto::pixels::Pixels| pixels.to_rgb8();
    let written = bytes(smalto::pixels::Pixels::read(&file).unwrap());
    assert!(written == bytes(gpu.render(&gaussians, &moving, &options)));
    let whole = bytes(gpu.render(&gaussians, &offscreen.viewer().view.camera(), &options));
    // Messages lie over what is on the screen.
    let first = offscreen.session.pair.first.as_ref().unwrap();
    assert!(bytes(first.renderer.pixels().unwrap()) == whole, "at rest the picture is whole");
}

/// Without a rate, and for pictures that are fast enough, a motion has the whole scale.
#[test]
fn without_a_rate_nothing_is_left_out_in_motion() {
    let gpu = Gpu::new();
    for fps in [None, Some(1.0)] {
        let compares_with = Some(CompareWith::Options(Options::PREVIEW));
        let mut offscreen = open(&gpu, Setup { fps, compares_with, ..setup(&["cactus:500"]) });
        for _ in 0..5 {
            offscreen.viewer().view.navigator.orbit(glam::DVec2::new(2.0, 0.0), SIZE);
            offscreen.viewer().view.is_flying = true;
            frame(&mut offscreen, vec![key(Key::W, Modifiers::NONE)]);
            assert!(offscreen.viewer().timing.motion_scale() == 1.0);
        }
    }
}

/// A view that moves while the panels come is undone, too: these change the size of the picture.
#[test]
fn a_motion_is_undone_whose_picture_changed_its_size() {
    let gpu = Gpu::new();
    let mut offscreen = smalto::viewer::Offscreen::new(setup(&["cactus:300"]), &gpu.0, [700, 240]).unwrap();
    offscreen.settle().unwrap();
    frame(&mut offscreen, Vec::new());
    let viewer = offscreen.viewer();
    let first = viewer.view.camera();
    let mut other = viewer.view.navigator.clone();
    other.orbit(glam::DVec2::new(90.0, 0.0), first.size_px);
    viewer.view.navigator.glide_to(&other.camera(first.size_px), 0.3);
    frame(&mut offscreen, vec![key(Key::H, Modifiers::NONE)]);
    offscreen.settle().unwrap();
    let viewer = offscreen.viewer();
    assert!(
        viewer.view.camera().size_px != first.size_px && viewer.view.camera().position.distance(first.position) > 0.1
    );
    viewer.undo(false);
    viewer.panels.are_hidden = true;
    frame(&mut offscreen, Vec::new());
    assert_eq!(offscreen.viewer().view.camera(), first);
}

/// A drag turns by what it is long at any rate of frames: all of its events between two frames are handled by one.
#[test]
fn drags_turn_as_far_at_2_frames_a_second_as_at_60() {
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["cactus:500"]));
    let first = offscreen.viewer().view.camera();
    let event = |at: f32, button, pressed: Option<bool>| {
        let (pos, modifiers) = (pos2(20.0 + at, 40.0), Modifiers::NONE);
        match pressed {
            Some(pressed) => Event::PointerButton { pos, button, pressed, modifiers },
            None => Event::PointerMoved(pos),
        }
    };
    println!("button, drag, frames a second: degrees, due");
    for button in [PointerButton::Primary, PointerButton::Secondary] {
        // Pixels, and seconds from the press to the release: a slow drag, and a flick.
        for (way, seconds) in [(100.0, 1.0), (60.0, 0.05)] {
            offscreen.viewer().view.navigator.snap(&first);
            let mut due = offscreen.viewer().view.navigator.clone();
            let whole = glam::DVec2::new(f64::from(way), 0.0);
            match button {
                PointerButton::Primary => due.orbit(whole, SIZE),
                _ => due.look(whole, SIZE),
            }
            let turned = |view: &smalto::camera::Camera| first.forward().angle_between(view.forward()).to_degrees();
            let due = turned(&due.camera(SIZE));
            for rate in [60.0, 2.0] {
                offscreen.viewer().view.navigator.snap(&first);
                // A mouse reports 120 times a second.
                let count = (seconds * 120.0_f32).ceil() as usize;
                let moves = (1..=count).map(|i| event(way * i as f32 / count as f32, button, None));
                let ends = [event(0.0, button, None), event(0.0, button, Some(true))];
                let events: Vec<Event> =
                    ends.into_iter().chain(moves).chain([event(way, button, Some(false))]).collect();
                let in_a_frame = (120.0 / rate) as usize;
                for part in events.chunks(in_a_frame) {
                    std::thread::sleep(std::time::Duration::from_secs_f64(1.0 / rate));
                    frame(&mut offscreen, part.to_vec());
                }
                let found = turned(&offscreen.viewer().view.camera());
                println!("{button:?}, {way} px in {seconds} s, {rate}: {found:.3}, {due:.3}");
                assert!(due > 1.0 && (found / due - 1.0).abs() < 0.02, "{button:?} {way}: {found} of {due}");
            }
        }
    }
}
