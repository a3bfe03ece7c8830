//! Numbers and marks over the picture, the place of the panels, copied commands, and the recent files.

use std::path::PathBuf;

use egui::{Event, Key, Modifiers, PointerButton, pos2};
use glam::DVec2;
use smalto::camera::{Camera, NamedCamera};
use smalto::formats::Reading;
use smalto::measure::metrics::Difference;
use smalto::options::Options;
use smalto::pixels::Pixels;
use smalto::rules::Rules;
use smalto::viewer::{
    CompareTarget, CompareWith, Offscreen, Program, RecentState, Request, Setup, Start, Tab, WindowRequest, view_mode,
};

use super::frames::{SIZE, open, setup, shown};
use super::interaction::{drag, frame, key};
use crate::common::Gpu;
use crate::common::program::run;

/// The picture of the window's view with these options, in floats.
fn drawn(gpu: &Gpu, offscreen: &mut Offscreen, options: &Options) -> Pixels {
    let gaussians = offscreen.session.pair.first.as_ref().unwrap().gaussians.clone().unwrap();
    gpu.render(&gaussians, &offscreen.viewer().view.camera(), options)
}

/// What these events ask of the owner of the window.
fn requests(offscreen: &mut Offscreen, events: Vec<Event>) -> Vec<WindowRequest> {
    let mut output = offscreen.frame(events).unwrap();
    // The layout before may be so recent that there is none yet.
    while output.platform.is_none() {
        std::thread::sleep(std::time::Duration::from_millis(3));
        output = offscreen.frame(Vec::new()).unwrap();
    }
    output.requests
}

#[test]
fn a_comparison_says_how_far_the_pictures_are_apart() {
    let gpu = Gpu::new();
    let compares_with = Some(CompareWith::Options(Options::PREVIEW));
    let mut offscreen = open(&gpu, Setup { compares_with, ..setup(&["cactus:3000"]) });
    let near = offscreen.viewer().options.rules.near;
    let pictures = |offscreen: &mut Offscreen| {
        let own = offscreen.viewer().options;
        let other = Options { rules: Rules { near, ..Options::PREVIEW.rules }, ..Options::PREVIEW };
        [own, other].map(|options| drawn(&gpu, offscreen, &options))
    };
    let apart = |offscreen: &mut Offscreen| {
        let viewer = offscreen.viewer();
        let apart = viewer.comparison.pair_difference.clone().expect("the pictures were compared");
        assert_eq!(apart.number, viewer.inspector.snapshot.as_ref().expect("they stand still").number);
        apart
    };
    let [first, second] = pictures(&mut offscreen);
    let expected = Difference::between(&first, &second);
    assert!(expected.max_error > 0.0);
    assert_eq!(apart(&mut offscreen).difference, expected);
    // Numbers follow the view.
    drag(&mut offscreen, PointerButton::Primary, [40.0, 5.0], 5, 2);
    offscreen.settle().unwrap();
    let [first, second] = pictures(&mut offscreen);
    assert_eq!(apart(&mut offscreen).difference, Difference::between(&first, &second));
    // Ctrl and a drag compare a part, from its first to its last pixel.
    let press = |pos, pressed| Event::PointerButton {
        pos,
        button: PointerButton::Primary,
        pressed,
        modifiers: Modifiers::COMMAND,
    };
    let (from, to) = (pos2(30.5, 20.5), pos2(69.5, 49.5));
    let view = offscreen.viewer().view.camera();
    frame(&mut offscreen, vec![Event::PointerMoved(from), press(from, true)]);
    frame(&mut offscreen, vec![Event::PointerMoved(to), press(to, false)]);
    offscreen.settle().unwrap();
    assert_eq!(offscreen.viewer().view.camera(), view, "it moves nothing");
    let part = |pixels: &Pixels| {
        let rgba = (20..50).flat_map(|y| (30..70).map(move |x| pixels.at(x, y))).collect();
        Pixels { size: [40, 30], rgba }
    };
    let found = apart(&mut offscreen);
    assert_eq!(found.area, Some([30, 20, 70, 50]));
    assert_eq!(found.difference, Difference::between(&part(&first), &part(&second)));
    // The pixel under the cursor has the values of both.
    assert_eq!(offscreen.viewer().pointer.pixel, Some([69, 49]));
    let still = offscreen.viewer().inspector.snapshot.as_ref().unwrap();
    assert!(*still.first == first && **still.second.as_ref().unwrap() == second);
    frame(&mut offscreen, vec![key(Key::Escape, Modifiers::NONE)]);
    offscreen.settle().unwrap();
    assert_eq!(apart(&mut offscreen).area, None);
    // Nobody asks any more: nothing is read back.
    offscreen.viewer().comparison.target = CompareTarget::Nothing;
    offscreen.viewer().pictures.are_stale = true;
    offscreen.settle().unwrap();
    assert!(offscreen.viewer().inspector.snapshot.is_none());
}

#[test]
fn a_scale_fits_and_marks_tell_their_distance() {
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["few-large:200"]));
    offscreen.viewer().inspector.settings.mode = view_mode("depth").unwrap();
    offscreen.settle().unwrap();
    offscreen.viewer().requests.push(Request::FitRange);
    offscreen.settle().unwrap();
    let viewer = offscreen.viewer();
    let [low, high] = viewer.inspector.settings.ranges[viewer.inspector.settings.mode];
    let still = viewer.inspector.snapshot.as_ref().unwrap().first.clone();
    let mut depths: Vec<f32> = still.rgba.iter().filter(|p| p[3] > 0.0).map(|p| p[0] / p[3]).collect();
    depths.sort_unstable_by(f32::total_cmp);
    let inside = depths.iter().filter(|depth| (low..=high).contains(depth)).count();
    let part = inside as f64 / depths.len() as f64;
    assert!((0.97..0.995).contains(&part) && low > 0.0, "{part} of the depths are between {low} and {high}");
    // Two marks: their places are those that the depths say.
    let view = offscreen.viewer().view.camera();
    let place = |offscreen: &mut Offscreen, [x, y]: [u32; 2]| {
        let depth = offscreen.session.pair.first.as_mut().unwrap().renderer.depth_at([x, y]).unwrap().unwrap();
        view.unprojected(DVec2::new(x.into(), y.into()) + 0.5, f64::from(depth))
    };
    let covered: Vec<u32> = (10..150).filter(|x| still.at(*x, 48)[3] > 0.9).collect();
    let pixels = [[covered[0], 48], [covered[covered.len() - 1], 48]];
    for [x, y] in pixels {
        let moved = Event::PointerMoved(pos2(x as f32 + 0.5, y as f32 + 0.5));
        let release =
            Event::Key { key: Key::M, physical_key: None, pressed: false, repeat: false, modifiers: Modifiers::NONE };
        let copied = requests(&mut offscreen, vec![moved, key(Key::M, Modifiers::NONE), release]);
        let [WindowRequest::Copy(text)] = &copied[..] else { panic!("{copied:?}") };
        let numbers: Vec<f64> = text.split(", ").map(|number| number.parse().unwrap()).collect();
        let apart = place(&mut offscreen, [x, y]).distance(glam::DVec3::from_slice(&numbers));
        assert!(apart < 1e-3, "{text} is {apart} from the place");
    }
    let expected = place(&mut offscreen, pixels[0]).distance(place(&mut offscreen, pixels[1]));
    let measured = offscreen.viewer().measures.all[0].length();
    assert!(expected > 0.05 && (measured - expected).abs() < 1e-3 * expected);
}

/// The clipboard gets what is seen; an .exr gets coverage and depth, too.
#[test]
fn pictures_are_copied_and_have_layers() {
    let gpu = Gpu::new();
    let folder = tempfile::tempdir().unwrap();
    let mut offscreen = open(&gpu, setup(&["cactus:2000"]));
    let own = offscreen.viewer().options;
    let picture = drawn(&gpu, &mut offscreen, &own);
    let copied = requests(&mut offscreen, vec![key(Key::F12, Modifiers::SHIFT)]);
    let [WindowRequest::CopyPicture(image)] = &copied[..] else { panic!("{copied:?}") };
    assert_eq!(image.size, SIZE.map(|side| side as usize));
    let bytes: Vec<u8> = image.pixels.iter().flat_map(|pixel| [pixel.r(), pixel.g(), pixel.b()]).collect();
    assert!(bytes == picture.to_rgb8());
    let file = folder.path().join("layers.exr");
    let viewer = offscreen.viewer();
    (viewer.export.picture, viewer.export.has_layers) = (file.display().to_string(), true);
    viewer.requests.push(Request::WritePicture(None));
    offscreen.settle().unwrap();
    assert!(Pixels::read(&file).unwrap().rgba == picture.rgba);
    let layers = exr::prelude::read_first_flat_layer_from_file(&file).unwrap();
    let channels = &layers.layer_data.channel_data.list;
    let names: Vec<String> = channels.iter().map(|channel| channel.name.to_string()).collect();
    assert_eq!(names, ["A", "B", "G", "R", "Z"]);
    let depths: Vec<f32> = channels[4].sample_data.values_as_f32().collect();
    let seen = (0..depths.len()).filter(|i| picture.rgba[*i][3] > 0.5).step_by(331);
    let seen: Vec<usize> = seen.collect();
    assert!(seen.len() >= 5, "{}", seen.len());
    for i in seen {
        let pixel = [i as u32 % SIZE[0], i as u32 / SIZE[0]];
        // The mean, of what the pixel is made of.
        let splats = offscreen.session.pair.first.as_mut().unwrap().renderer.explain(pixel).unwrap().splats;
        let shares: f32 = splats.iter().map(|splat| splat.share).sum();
        let depth = splats.iter().map(|splat| splat.share * splat.depth).sum::<f32>() / shares;
        assert!((depths[i] - depth).abs() < 1e-4 * depth, "{pixel:?}: {} and {depth}", depths[i]);
    }
}

/// The picture has the part of the window that the panels leave, as if it were all, and keeps it.
#[test]
fn the_picture_lies_beside_the_panels() {
    const WINDOW: [u32; 2] = [700, 240];
    let gpu = Gpu::new();
    let setup = Setup { hides_panels: false, ..setup(&["cactus:300"]) };
    let mut offscreen = Offscreen::new(setup, &gpu.0, WINDOW).unwrap();
    offscreen.settle().unwrap();
    let size = offscreen.viewer().view.size;
    assert!(size[0] < WINDOW[0] - 200 && size[1] == WINDOW[1], "{size:?}");
    let own = offscreen.viewer().options;
    let picture = drawn(&gpu, &mut offscreen, &own);
    assert_eq!(picture.size, size);
    let screen = offscreen.screen().unwrap();
    let bytes = picture.to_rgb8();
    for (i, pixel) in bytes.chunks(3).enumerate() {
        let (x, y) = (i as u32 % size[0], i as u32 / size[0]);
        assert_eq!(screen[(y * WINDOW[0] + x) as usize][..3], *pixel, "pixel {x}, {y}");
    }
    // The whole window is the picture's without them, and the scene is in its middle both times.
    let middle = |camera: Camera| camera.centre_px * 2.0 / DVec2::from(camera.size_px.map(f64::from));
    assert_eq!(middle(offscreen.viewer().view.camera()), DVec2::ONE);
    frame(&mut offscreen, vec![key(Key::H, Modifiers::NONE)]);
    offscreen.settle().unwrap();
    assert_eq!(offscreen.viewer().view.camera().size_px, WINDOW);
    let release =
        Event::Key { key: Key::H, physical_key: None, pressed: false, repeat: false, modifiers: Modifiers::NONE };
    frame(&mut offscreen, vec![release, key(Key::H, Modifiers::NONE)]);
    // Wide contents scroll.
    for (tab, _) in Tab::ALL {
        offscreen.viewer().panels.recent.tab = tab;
        offscreen.settle().unwrap();
        // The timeline takes some rows.
        let [width, height] = offscreen.viewer().view.size;
        assert!(width == size[0] && (height == size[1]) == (tab != Tab::Path), "{tab:?}");
    }
    offscreen.viewer().panels.recent.tab = Tab::Quality;
    offscreen.viewer().requests.push(Request::Measure);
    frame(&mut offscreen, Vec::new());
    offscreen.settle().unwrap();
    frame(&mut offscreen, Vec::new());
    assert!(
        offscreen.viewer().measuring.costs.is_some() && offscreen.viewer().view.size == size,
        "what was measured is beside knobs"
    );
}

/// Steps of 255 between the pixels that a command writes into a file and those of the screen.
fn steps_apart(words: &[&str], file: &str, screen: &Pixels) -> Vec<f32> {
    let output = run(words, |command| {
        command.env("SMALTO_DEVICE", std::env::var("SMALTO_DEVICE").unwrap_or_else(|_| "llvmpipe".to_owned()));
    });
    assert!(output.status.success(), "{words:?}: {}", String::from_utf8_lossy(&output.stderr));
    let written = Pixels::read(&PathBuf::from(file)).unwrap();
    let steps = |(a, b): (&[f32; 4], &[f32; 4])| (0..3).map(|c| (a[c] - b[c]).abs() * 255.0).fold(0.0, f32::max);
    written.rgba.iter().zip(&screen.rgba).map(steps).collect()
}

/// The direction of a copied view is computed again, so that a value next to a rounding may differ.
fn is_rounding(steps: &[f32]) -> bool {
    steps.iter().filter(|steps| **steps > 0.5).count() < steps.len() / 100
}

/// The command line that is copied draws what is seen.
#[test]
fn the_copied_command_draws_the_picture() {
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let mut offscreen = open(&gpu, setup(&["cactus:3000"]));
    offscreen.viewer().options = offscreen.viewer().preset(&Options::FAST);
    offscreen.viewer().options.sh_degree = 1;
    offscreen.viewer().view.background = smalto::rules::Background::Colour([0.1, 0.2, 0.3]);
    offscreen.viewer().view.navigator.orbit(DVec2::new(25.0, -8.0), SIZE);
    offscreen.viewer().view.navigator.dolly(1.5);
    let drawn_by = |offscreen: &mut Offscreen, name: &str| {
        offscreen.viewer().pictures.are_stale = true;
        offscreen.viewer().messages = Default::default();
        offscreen.settle().unwrap();
        let screen = shown(offscreen);
        let (line, left_out) = offscreen.viewer().command_line(Program::Render);
        assert!(left_out.is_empty(), "{left_out:?}");
        let file = folder.path().join(name).display().to_string();
        let words: Vec<String> = shlex::split(&line).unwrap();
        let words: Vec<&str> =
            words.iter().map(|word| if word == "view.png" { &file } else { word.as_str() }).collect();
        assert_eq!(words[..2], ["smalto", "render"]);
        let steps = steps_apart(&words[1..], &file, &screen);
        assert!(steps.iter().all(|steps| *steps < 1.5) && is_rounding(&steps), "{line}");
    };
    drawn_by(&mut offscreen, "seen.png");
    // At a camera of a file, it names the file.
    let file = folder.path().join("my cameras.json");
    let camera = offscreen.viewer().view.camera();
    smalto::camera::write(&file, &[smalto::camera::NamedCamera::new("a".to_owned(), camera)]).unwrap();
    offscreen.viewer().drop_file(&file);
    offscreen.settle().unwrap();
    assert!(offscreen.viewer().command_line(Program::Bench).0.contains("my cameras.json"));
    drawn_by(&mut offscreen, "camera.png");
    // What no option says is said.
    offscreen.viewer().scenes.layers[0].placement.scale = 2.0;
    assert_eq!(offscreen.viewer().command_line(Program::Render).1, ["the placement of scenes"]);
    offscreen.viewer().scenes.layers[0].placement.scale = 1.0;
    // The keys copy it.
    let copied = requests(&mut offscreen, vec![key(Key::R, Modifiers::COMMAND)]);
    assert!(matches!(&copied[..], [WindowRequest::Copy(text)] if text.starts_with("smalto render cactus:3000 ")));
}

/// An empty window asks for files, and what was opened is kept for the next one.
#[test]
fn a_window_keeps_what_was_opened() {
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let [state, scene] = ["state/viewer.json", "small.ply"].map(|name| folder.path().join(name));
    crate::common::program::ok(&["convert", "few-large:20", scene.to_str().unwrap()]);
    let setup = Setup { recent_file: Some(state.clone()), hides_panels: false, ..setup(&[]) };
    let mut offscreen = Offscreen::new(setup, &gpu.0, [640, 400]).unwrap();
    frame(&mut offscreen, vec![key(Key::O, Modifiers::COMMAND)]);
    assert!(offscreen.viewer().panels.dialog.is_open());
    frame(&mut offscreen, vec![key(Key::Escape, Modifiers::NONE)]);
    assert!(!offscreen.viewer().panels.dialog.is_open());
    offscreen.viewer().drop_file(&scene);
    offscreen.settle().unwrap();
    assert_eq!(RecentState::read(&state).files, std::slice::from_ref(&scene));
    // A click on its title closes the first section, also in the next window.
    let pos = pos2(330.0, 56.0);
    for pressed in [true, false] {
        let button = PointerButton::Primary;
        let click = Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE };
        frame(&mut offscreen, vec![Event::PointerMoved(pos), click]);
    }
    offscreen.settle().unwrap();
    offscreen.viewer().save_recent_state();
    let setup = Setup { scenes: vec![scene], ..offscreen.viewer().setup.clone() };
    let mut next = Offscreen::new(setup, &gpu.0, [640, 400]).unwrap();
    next.settle().unwrap();
    let closed: Vec<&str> = next.viewer().panels.recent.closed.iter().map(String::as_str).collect();
    assert_eq!(closed, ["Scenes"]);
}

/// A first view that there is not is said.
#[test]
fn a_camera_that_there_is_not_is_said() {
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let file = folder.path().join("cameras.json");
    let camera = Camera::looking_at(glam::DVec3::new(0.0, 0.0, -4.0), glam::DVec3::ZERO, SIZE, 0.7);
    smalto::camera::write(&file, &[NamedCamera::new("one.png".to_owned(), camera.clone())]).unwrap();
    let start = |name: &str| Some(Start::Camera(name.to_owned()));
    for (cameras, start, expected) in [
        (Some(file.clone()), start("7"), Some("--camera 7: the file has no such camera")),
        (None, start("0"), Some("--camera 0: there is no camera file")),
        (Some(file.clone()), start("-1"), None),
        (Some(file.clone()), start("one"), None),
    ] {
        let setup = Setup { cameras, start, ..setup(&["cactus:300"]) };
        let mut offscreen = Offscreen::new(setup, &gpu.0, SIZE).unwrap();
        let found = offscreen.settle().err().map(|problem| problem.to_string());
        assert_eq!(found.as_deref(), expected);
        if expected.is_none() {
            assert_eq!(offscreen.viewer().view.camera().position, camera.position);
        }
    }
}

/// The copied `smalto view` opens a window that shows the same.
#[test]
fn the_copied_window_shows_the_same() {
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let reading = Reading { flip: [false, true, false], ..Reading::default() };
    let reading_options = vec!["--flip".to_owned(), "y".to_owned()];
    let mut offscreen = open(&gpu, Setup { reading, reading_options, ..setup(&["cactus:2000", "few-large:200"]) });
    let shows_the_same = |offscreen: &mut Offscreen, name: &str| {
        offscreen.viewer().pictures.are_stale = true;
        offscreen.settle().unwrap();
        let screen = shown(offscreen);
        let (line, left_out) = offscreen.viewer().command_line(Program::View);
        assert!(left_out.is_empty(), "{name}: {left_out:?}");
        let words: Vec<String> = shlex::split(&line).unwrap();
        let file = folder.path().join("screen.png").display().to_string();
        let words: Vec<&str> =
            words[1..].iter().map(String::as_str).chain(["--offscreen", "4", "--screen", &file]).collect();
        assert!(is_rounding(&steps_apart(&words, &file, &screen)), "{name}: {line}");
        line
    };
    offscreen.viewer().view.navigator.orbit(DVec2::new(25.0, -8.0), SIZE);
    offscreen.viewer().view.background = smalto::rules::Background::Colour([0.1, 0.2, 0.3]);
    let line = shows_the_same(&mut offscreen, "two scenes");
    assert!(line.contains(" --flip y ") && line.contains(" --eye "), "{line}");
    offscreen.viewer().comparison.target = CompareTarget::Options(Some(Options::FAST));
    let line = shows_the_same(&mut offscreen, "split");
    assert!(line.contains(" --compare fast --compare-by split"), "{line}");
    let file = folder.path().join("picture.png");
    shown(&mut offscreen).write(&file, smalto::pixels::Alpha::Opaque).unwrap();
    offscreen.viewer().drop_file(&file);
    offscreen.settle().unwrap();
    shows_the_same(&mut offscreen, "picture");
    offscreen.viewer().comparison.target = CompareTarget::Nothing;
    offscreen.viewer().set_lens("FISHEYE");
    let line = shows_the_same(&mut offscreen, "lens");
    assert!(line.contains(" --lens FISHEYE"), "{line}");
    // At a camera of a file.
    let file = folder.path().join("cameras.json");
    let camera = offscreen.viewer().view.camera();
    let camera = Camera { lens: None, ..camera };
    let other = Camera { position: camera.position * 1.5, ..camera.clone() };
    let named = |name: &str, camera: &Camera| NamedCamera::new(name.to_owned(), camera.clone());
    smalto::camera::write(&file, &[named("a", &camera), named("b", &other)]).unwrap();
    offscreen.viewer().drop_file(&file);
    offscreen.settle().unwrap();
    offscreen.viewer().go_to_camera(1, true);
    let line = shows_the_same(&mut offscreen, "camera");
    assert!(line.contains(" --camera 1 "), "{line}");
    // What no option says is said.
    offscreen.viewer().comparison.target = CompareTarget::Options(None);
    assert_eq!(offscreen.viewer().command_line(Program::View).1, ["the comparison"]);
    offscreen.viewer().comparison.target = CompareTarget::Options(Some(Options::FAST));
    offscreen.viewer().comparison.split = 0.25;
    assert_eq!(offscreen.viewer().command_line(Program::View).1, ["the place of the split"]);
    assert_eq!(offscreen.viewer().command_line(Program::Bench).1, ["all scenes but the first of 2", "the background"]);
}
