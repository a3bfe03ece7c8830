//! The viewer as its users meet it: in a window, with keys, a mouse and files that are dropped.
#![cfg(target_os = "linux")]

use std::fs;
use std::time::{Duration, Instant};

use crate::common::desktop::{Desktop, ESCAPE, REPEAT_DELAY, SCREEN, Shot};
use crate::common::program::{ok, path, run};
use crate::common::window::{Viewer, apart, numbers, view};
use crate::common::{Turn, captured};

/// Wide enough for a picture beside the panels, where these are shown.
const SIZE: [u32; 2] = [480, 320];

pub(super) const SMALL: [&str; 4] = ["cactus:20000", "--size", "480x320", "--no-panels"];

/// The middle of such a window.
pub(super) const MIDDLE: [i16; 2] = [240, 160];

fn seen(file: &str) -> Shot {
    let picture = image::open(file).expect("it is a PNG").to_rgb8();
    Shot { size: picture.dimensions().into(), rgb: picture.pixels().map(|pixel| pixel.0).collect() }
}

/// Whether the window comes to show this picture, once notes have left.
fn comes_to_show(viewer: &Viewer, picture: &Shot) {
    let mut different = 0;
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(20) {
        different = viewer.shot().different(picture);
        if different == 0 {
            return;
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    panic!("{different} pixels of the window are not those of the picture");
}

/// The view in the window is the picture that `smalto render` writes, in every byte.
pub(super) fn equals_render(viewer: &mut Viewer, scene: &str, near: &str) {
    let folder = tempfile::tempdir().unwrap();
    let (cameras, out) = (path(&folder, "view.json"), path(&folder, "view.png"));
    fs::write(&cameras, format!("[{}]", viewer.view())).unwrap();
    let output = run(&["render", scene, "--cameras", &cameras, "--near", near, "-o", &out], |command| {
        if std::env::var_os("SMALTO_DEVICE").is_none() {
            command.env("SMALTO_DEVICE", "llvmpipe");
        }
    });
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let picture = seen(&out);
    assert!(picture.lit() > 1000, "there is something to see");
    comes_to_show(viewer, &picture);
}

#[test]
fn the_window_shows_a_scene_between_its_panels() {
    let _turn = Turn::take();
    let desktop = Desktop::open(true);
    let mut viewer = Viewer::open(&desktop, &["cactus:20000", "--size", "480x320", "--near", "0.2"], |_| {});
    let first = viewer.next("first-frame");
    assert!(first["is_whole"] == true && first["ms"].as_f64().unwrap() > 0.0, "{first}");
    assert_eq!(viewer.next("scene")["gaussians"], 20_000);
    viewer.settle();
    let with_panels = viewer.shot();
    assert_eq!(with_panels.size, SIZE);
    assert!(with_panels.lit() > with_panels.rgb.len() / 2, "the screen is not black");
    viewer.letter('h');
    let bare = viewer.shot();
    let covered = bare.different(&with_panels);
    assert!(covered > 10_000, "panels cover {covered} pixels");
    // A help window, and none.
    viewer.desktop.key(crate::common::desktop::SHIFT, true);
    viewer.press(u32::from('/'));
    viewer.desktop.key(crate::common::desktop::SHIFT, false);
    viewer.settle();
    assert!(viewer.shot().different(&bare) > 10_000, "there is a window of keys");
    viewer.press(ESCAPE);
    assert_eq!(viewer.shot().different(&bare), 0);
    // A key that is held long enough to repeat itself is one press.
    viewer.desktop.key(u32::from('h'), true);
    std::thread::sleep(3 * REPEAT_DELAY);
    viewer.desktop.key(u32::from('h'), false);
    viewer.settle();
    assert!(viewer.shot().different(&bare) > 10_000, "the panels are back");
    let closed = viewer.quit();
    assert!(closed["frames_shown"].as_u64() >= closed["frames_drawn"].as_u64(), "{closed}");
}

#[test]
fn the_window_equals_render_in_every_byte() {
    let _turn = Turn::take();
    let desktop = Desktop::open(true);
    let mut viewer = Viewer::open(&desktop, &[&SMALL[..], &["--near", "0.05"]].concat(), |_| {});
    viewer.next("first-frame");
    viewer.settle();
    equals_render(&mut viewer, "cactus:20000", "0.05");
    // From elsewhere, too.
    viewer.drag(1, MIDDLE, [300, 190]);
    equals_render(&mut viewer, "cactus:20000", "0.05");
    viewer.quit();
}

#[test]
#[ignore = "needs the captured scenes (SMALTO_TEST_SCENES)"]
fn captured_scenes_in_the_window_equal_render() {
    let _turn = Turn::take();
    let desktop = Desktop::open(true);
    for (scene, cameras, count) in
        [("biker.spz", "biker.orbit.cameras.json", 100), ("plush-215k.spz", "plush.cameras.json", 97)]
    {
        let file = |name| fs::canonicalize(captured(name)).unwrap().display().to_string();
        let [scene, cameras] = [scene, cameras].map(file);
        let arguments = [&scene, "--cameras", &cameras, "--size", "480x320", "--no-panels", "--near", "0.2"];
        let mut viewer = Viewer::open(&desktop, &arguments, |_| {});
        while viewer.next("first-frame")["is_whole"] != true {}
        assert_eq!(viewer.next("cameras")["count"], count);
        viewer.settle();
        equals_render(&mut viewer, &scene, "0.2");
        viewer.quit();
    }
}

#[test]
fn mouse_and_keys_move_the_view() {
    let _turn = Turn::take();
    let desktop = Desktop::open(true);
    let mut viewer = Viewer::open(&desktop, &SMALL, |_| {});
    viewer.next("first-frame");
    viewer.settle();
    let shown = viewer.shot();
    let first = viewer.view();
    let mut before = first.clone();
    let mut moved = |viewer: &mut Viewer, what: &str, moves: bool, turns: bool| {
        let now = viewer.view();
        let [moved, turned] = ["position", "rotation"].map(|member| apart(&before[member], &now[member]));
        assert_eq!((moved > 1e-3, turned > 1e-3), (moves, turns), "{what}: by {moved}, turned {turned}");
        before = now;
    };
    moved(&mut viewer, "nothing", false, false);
    viewer.drag(1, MIDDLE, [300, 190]);
    moved(&mut viewer, "orbit", true, true);
    viewer.drag(2, MIDDLE, [300, 190]);
    moved(&mut viewer, "pan", true, false);
    viewer.drag(3, MIDDLE, [300, 190]);
    moved(&mut viewer, "look around", false, true);
    viewer.point(MIDDLE);
    viewer.click(4);
    moved(&mut viewer, "dolly", true, false);
    let here = viewer.shot();
    viewer.desktop.key(u32::from('w'), true);
    viewer.desktop.until("the view flies", || viewer.shot().different(&here) > 10_000);
    viewer.desktop.key(u32::from('w'), false);
    viewer.settle();
    moved(&mut viewer, "fly", true, false);
    assert!(viewer.shot().different(&shown) > 10_000, "the picture has followed");
    viewer.letter('r');
    moved(&mut viewer, "the first view again", true, true);
    assert_eq!(viewer.view(), first);
    // What was copied can be gone back to.
    viewer.drag(1, MIDDLE, [200, 130]);
    viewer.with_control('c');
    let copied = viewer.next("copied")["view"].clone();
    viewer.letter('r');
    assert_eq!(viewer.view(), first);
    assert_ne!(copied, first);
    viewer.quit();
}

#[test]
#[ignore = "long: windows of many sizes"]
fn long_the_window_can_have_any_size() {
    let _turn = Turn::take();
    let desktop = Desktop::open(true);
    let mut viewer = Viewer::open(&desktop, &[&SMALL[..], &["--near", "0.05"]].concat(), |_| {});
    viewer.next("first-frame");
    viewer.settle();
    for size in [[1, 1], [333, 217], [17, 401], [640, 2], SIZE] {
        viewer.desktop.resize(viewer.window, size);
        viewer.resized(size);
        viewer.settle();
        assert_eq!(viewer.shot().size, size);
    }
    equals_render(&mut viewer, "cactus:20000", "0.05");
    viewer.letter('f');
    viewer.resized(SCREEN);
    viewer.settle();
    assert!(viewer.shot().lit() > 100_000, "the whole screen is in use");
    viewer.letter('f');
    viewer.resized(SIZE);
    equals_render(&mut viewer, "cactus:20000", "0.05");
    viewer.desktop.minimize(viewer.window);
    viewer.settle();
    let begun = viewer.cpu_seconds();
    std::thread::sleep(Duration::from_millis(500));
    let used = viewer.cpu_seconds() - begun;
    assert!(used < 0.05 * 0.5, "a window that nobody sees took {used} s of half a second");
    viewer.desktop.restore(viewer.window);
    equals_render(&mut viewer, "cactus:20000", "0.05");
    viewer.quit();
}

/// What the swapchain, the pictures and the drivers keep of each size would show after a thousand.
#[test]
#[ignore = "long: a thousand resizes"]
fn long_a_thousand_resizes_leave_nothing_behind() {
    const MOST_GROWTH: u64 = 16 << 20; // bytes, of the heap's fragments and the layer's own records
    let _turn = Turn::take();
    let desktop = Desktop::open(false);
    let arguments = ["cactus:500", "--size", "64x48", "--no-panels", "--vsync", "off"];
    let mut viewer = Viewer::open(&desktop, &arguments, |_| {});
    viewer.next("first-frame");
    viewer.settle();
    let mut resident = 0;
    for i in 0..1000 {
        let size = [40 + i % 41, 30 + i % 37];
        viewer.desktop.resize(viewer.window, size);
        // Some come faster than frames, as they do under a hand.
        if i % 5 == 4 {
            viewer.resized(size);
        }
        if i == 99 {
            viewer.settle();
            resident = viewer.resident_bytes();
        }
    }
    viewer.settle();
    let grown = viewer.resident_bytes().saturating_sub(resident);
    eprintln!("{} KiB more after a thousand resizes", grown >> 10);
    assert!(grown < MOST_GROWTH, "{grown} bytes more");
    assert!(viewer.count("resized") >= 1000);
    let closed = viewer.quit();
    // A scene of 500 and pictures this small take little more than a mebibyte.
    let on_gpu = closed["gpu_bytes"].as_u64().unwrap();
    eprintln!("{on_gpu} bytes on the GPU");
    assert!(on_gpu < 4 << 20, "{on_gpu} bytes on the GPU");
}

#[test]
fn dropped_scenes_join_and_a_broken_file_is_a_message() {
    let _turn = Turn::take();
    let desktop = Desktop::open(true);
    let folder = tempfile::tempdir().unwrap();
    let broken = path(&folder, "broken.ply");
    fs::write(&broken, "this is no scene\n").unwrap();
    let plush = fs::canonicalize("tests/fixtures/plush.ply").unwrap().display().to_string();
    let mut viewer = Viewer::open(&desktop, &SMALL, |_| {});
    viewer.next("first-frame");
    assert_eq!(viewer.next("scene")["scenes"], 1);
    viewer.settle();
    let alone = viewer.shot();
    viewer.desktop.drop_files(viewer.window, &[&plush]);
    let scene = viewer.next("scene");
    assert_eq!((scene["scenes"].as_u64(), scene["gaussians"].as_u64()), (Some(2), Some(20_061)));
    viewer.settle();
    let both = viewer.shot();
    assert!(both.different(&alone) > 10, "the second scene is seen");
    viewer.desktop.drop_files(viewer.window, &[&broken]);
    let message = viewer.message("broken.ply");
    assert_eq!(message["is_error"], true);
    viewer.settle();
    // The message lies over the lower left corner; both scenes are still there.
    let after = viewer.shot();
    let above = |shot: &Shot| shot.rgb[..(SIZE[0] * SIZE[1] / 2) as usize].to_vec();
    assert!(above(&after) == above(&both) && after != both, "the message is on the screen, and the scenes");
    // A picture is to be compared with, a camera file to be stepped through, both at once.
    let picture = path(&folder, "grey.png");
    image::RgbImage::from_pixel(SIZE[0], SIZE[1], image::Rgb([90; 3])).save(&picture).unwrap();
    let cameras = path(&folder, "cameras.json");
    fs::write(&cameras, format!("[{}]", viewer.view())).unwrap();
    viewer.desktop.drop_files(viewer.window, &[&picture, &cameras]);
    assert_eq!(viewer.next("cameras")["count"], 1);
    viewer.settle();
    let compared = viewer.shot();
    assert_eq!((compared.at([400, 100]), compared.at([20, 100])), ([90; 3], both.at([20, 100])));
    viewer.quit();
}

#[test]
fn keys_step_through_the_cameras() {
    let _turn = Turn::take();
    let desktop = Desktop::open(true);
    let folder = tempfile::tempdir().unwrap();
    let camera = |name: &str, z: f64| {
        format!(
            r#"{{"id": 0, "img_name": "{name}", "width": 480, "height": 320, "position": [0, -1.2, {z}],
            "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "fx": 400, "fy": 400}}"#
        )
    };
    let all = [camera("front", -5.0), camera("near", -2.5), camera("far", -8.0)];
    let file = path(&folder, "cameras.json");
    fs::write(&file, format!("[{}]", all.join(","))).unwrap();
    let mut viewer = Viewer::open(&desktop, &[&SMALL[..], &["--cameras", &file]].concat(), |_| {});
    viewer.next("first-frame");
    assert_eq!(viewer.next("cameras")["count"], 3);
    viewer.settle();
    while viewer.count("camera") > 0 && viewer.next("camera")["index"] != 0 {}
    let told = viewer.count("camera");
    for (key, name, z) in [('n', "near", -2.5), ('n', "far", -8.0), ('n', "front", -5.0), ('p', "far", -8.0)] {
        viewer.letter(key);
        while viewer.next("camera")["name"] != name {}
        let view = viewer.view();
        let [x, y, at] = numbers(&view["position"])[..] else { panic!("{view}") };
        assert!((x.abs() + (y + 1.2).abs() + (at - z).abs()) < 1e-9, "{name}: {view}");
    }
    assert_eq!(viewer.count("camera"), told + 4);
    viewer.quit();
}

#[test]
fn every_view_mode_is_shown_and_a_pixel_is_explained() {
    let _turn = Turn::take();
    let desktop = Desktop::open(true);
    let mut viewer = Viewer::open(&desktop, &SMALL, |_| {});
    viewer.next("first-frame");
    viewer.settle();
    let colours = viewer.shot();
    let mut shown: Vec<(String, Shot)> = vec![("colour".to_owned(), colours.clone())];
    loop {
        viewer.letter('l');
        let look = viewer.next("look")["look"].as_str().unwrap().to_owned();
        let shot = viewer.shot();
        if look == "colour" {
            assert_eq!(shot.different(&colours), 0, "colours are as they were");
            break;
        }
        for (name, other) in &shown {
            assert!(shot.different(other) > 300, "{look} looks like {name}");
        }
        shown.push((look, shot));
    }
    assert!(shown.len() >= 15, "{}", shown.len());
    // The brightest pixel of the middle, say.
    let around = (100..380).flat_map(|x| (80..240).map(move |y| [x, y]));
    let pixel = around.max_by_key(|at| colours.at(*at).iter().map(|c| u32::from(*c)).sum::<u32>()).unwrap();
    viewer.point(pixel.map(|place| place as i16));
    viewer.letter('x');
    let explained = viewer.next("explained");
    assert_eq!(explained["pixel"], serde_json::json!(pixel));
    assert!(explained["splats"].as_u64() > Some(0), "{explained}");
    let colour = numbers(&explained["colour"]);
    for (channel, shown) in colour.iter().zip(colours.at(pixel)) {
        let apart = (channel.clamp(0.0, 1.0) * 255.0 - f64::from(shown)).abs();
        assert!(apart <= 1.0, "{explained} is shown as {:?}", colours.at(pixel));
    }
    assert!(viewer.shot().different(&colours) > 1000, "the explanation is in a window");
    viewer.press(ESCAPE);
    assert_eq!(viewer.shot().different(&colours), 0);
    viewer.quit();
}

#[test]
fn an_idle_window_costs_nothing() {
    let _turn = Turn::take();
    let desktop = Desktop::open(true);
    let mut viewer = Viewer::open(&desktop, &["cactus:20000", "--size", "480x320"], |_| {});
    viewer.next("first-frame");
    viewer.settle();
    let begun = viewer.cpu_seconds();
    std::thread::sleep(Duration::from_secs(1));
    let used = viewer.cpu_seconds() - begun;
    assert!(used < 0.05, "{used} s in a second");
    viewer.quit();
}

#[test]
fn the_viewer_without_a_window_draws_what_render_draws() {
    let _turn = Turn::take();
    let folder = tempfile::tempdir().unwrap();
    let (screen, bare, out) = (path(&folder, "screen.png"), path(&folder, "bare.png"), path(&folder, "render.png"));
    let common = ["cactus:20000", "--size", "480x320"];
    let offscreen = |more: &[&str]| {
        let output = view(&[&common[..], &["--offscreen", "4"], more].concat()).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    offscreen(&["--screen", &screen]);
    offscreen(&["--screen", &bare, "--no-panels"]);
    let device = std::env::var("SMALTO_DEVICE").unwrap_or_else(|_| "llvmpipe".to_owned());
    ok(&[&["render"], &common[..], &["--device", &device, "-o", &out]].concat());
    let [screen, bare, picture] = [screen, bare, out].map(|file| seen(&file));
    assert_eq!(bare.different(&picture), 0, "without panels, every pixel");
    assert!(screen.different(&picture) > 10_000, "with panels, another picture beside them");
}
