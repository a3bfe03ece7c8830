//! The viewer without a window: what is compared, measured, chosen, placed and written, in frames that a program asks
//! for.

use std::path::PathBuf;

use crate::common::Gpu;
use egui::{Key, Modifiers};
use smalto::camera::{self, NamedCamera};
use smalto::measure::metrics::max_error;
use smalto::options::Options;
use smalto::pagefile::write::{Job, Settings, write_whole};
use smalto::pixels::Pixels;
use smalto::procedural::{Procedural, cactus};
use smalto::rules::Rules;
use smalto::viewer::{CompareMode, CompareTarget, CompareWith, Offscreen, Request, Setup, Tab, Viewer};

pub(super) const SIZE: [u32; 2] = [160, 96];

pub(super) fn setup(scenes: &[&str]) -> Setup {
    Setup { scenes: scenes.iter().map(PathBuf::from).collect(), hides_panels: true, ..Setup::default() }
}

pub(super) fn open(gpu: &Gpu, setup: Setup) -> Offscreen {
    let mut offscreen = Offscreen::new(setup, &gpu.0, SIZE).unwrap();
    offscreen.settle().unwrap();
    offscreen
}

/// What is on the screen, as floats.
pub(super) fn shown(offscreen: &mut Offscreen) -> Pixels {
    let screen = offscreen.screen().unwrap();
    let pixel = |p: &[u8; 4]| p.map(|v| f32::from(v) / 255.0);
    Pixels { size: SIZE, rgba: screen.iter().map(pixel).collect() }
}

/// What `render` makes of the same, in 8 bits.
pub(super) fn rendered(gpu: &Gpu, offscreen: &mut Offscreen, options: &Options) -> Pixels {
    let gaussians = offscreen.session.pair.first.as_ref().unwrap().gaussians.clone().unwrap();
    let pixels = gpu.render(&gaussians, &offscreen.viewer().view.camera(), options);
    let byte = |v: u8| f32::from(v) / 255.0;
    let rgba = pixels.to_rgb8().chunks(3).map(|p| [byte(p[0]), byte(p[1]), byte(p[2]), 1.0]).collect();
    Pixels { size: SIZE, rgba }
}

#[test]
fn the_screen_equals_render_bit_for_bit() {
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["cactus:3000"]));
    for preset in [Options::BALANCED, Options::EXACT, Options::PREVIEW] {
        let near = offscreen.viewer().options.rules.near;
        let options = Options { rules: Rules { near, ..preset.rules }, ..preset };
        offscreen.viewer().options = options;
        offscreen.settle().unwrap();
        assert!(shown(&mut offscreen) == rendered(&gpu, &mut offscreen, &options));
    }
}

#[test]
fn split_and_difference_views_compare_two_pictures() {
    let gpu = Gpu::new();
    let preview = Options { scale: 0.5, ..Options::PREVIEW };
    let compares_with = Some(CompareWith::Options(preview));
    let mut offscreen = open(&gpu, Setup { compares_with, ..setup(&["cactus:3000"]) });
    let first = offscreen.viewer().options;
    let second = Options { rules: Rules { near: first.rules.near, ..preview.rules }, ..preview };
    let [first, second] = [first, second].map(|options| rendered(&gpu, &mut offscreen, &options));
    assert!(max_error(&first, &second) > 0.05, "the two are not the same");
    let split = shown(&mut offscreen);
    for (i, pixel) in split.rgba.iter().enumerate() {
        let side = if (i as u32 % SIZE[0]) < SIZE[0] / 2 { &first } else { &second };
        assert_eq!(*pixel, side.rgba[i], "pixel {i}");
    }
    offscreen.viewer().comparison.mode = CompareMode::Difference;
    offscreen.viewer().comparison.gain = 1.0;
    offscreen.settle().unwrap();
    for (i, pixel) in shown(&mut offscreen).rgba.iter().enumerate() {
        let expected = (first.rgba[i][0] - second.rgba[i][0]).abs();
        // Both were rounded to 8 bits, the difference was not.
        assert!((pixel[0] - expected).abs() <= 2.0 / 255.0, "pixel {i}: {} for {expected}", pixel[0]);
    }
    offscreen.viewer().comparison.target = CompareTarget::Nothing;
    offscreen.settle().unwrap();
    assert!(shown(&mut offscreen) == first);
}

#[test]
fn the_reference_is_shown_for_its_own_view_only() {
    let gpu = Gpu::new();
    let compares_with = Some(CompareWith::Reference);
    let mut offscreen = open(&gpu, Setup { compares_with, ..setup(&["cactus:3000"]) });
    offscreen.viewer().comparison.split = 0.0;
    offscreen.settle().unwrap();
    let own = offscreen.viewer().options;
    let picture = rendered(&gpu, &mut offscreen, &own);
    let error = max_error(&shown(&mut offscreen), &picture);
    assert!(error > 0.0 && error <= 3.0 / 255.0, "balanced is a step or so from the reference: {error}");
    // From elsewhere it is not shown.
    let view = offscreen.viewer().view.camera();
    offscreen.viewer().view.navigator.orbit(glam::DVec2::new(30.0, 0.0), SIZE);
    offscreen.viewer().pictures.are_stale = true;
    offscreen.settle().unwrap();
    assert!(offscreen.viewer().view.camera() != view);
    assert_eq!(offscreen.session.viewer.mismatch(&offscreen.session.pair), Some("another view"));
    assert!(shown(&mut offscreen) == rendered(&gpu, &mut offscreen, &own));
}

#[test]
fn several_scenes_are_drawn_together_and_can_be_placed() {
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["cactus:2000", "few-large:50"]));
    let both = offscreen.session.pair.first.as_ref().unwrap().gaussians.clone().unwrap();
    let [cactus, balls] =
        ["cactus:2000", "few-large:50"].map(|name| Procedural::parse(name).unwrap().unwrap().make().unwrap().gaussians);
    assert_eq!(both.len(), cactus.len() + balls.len());
    offscreen.viewer().scenes.layers[1].placement.translation = [1.0, 0.0, 0.0];
    offscreen.settle().unwrap();
    let moved = offscreen.session.pair.first.as_ref().unwrap().gaussians.clone().unwrap();
    assert_eq!(moved.means()[..cactus.len()], *cactus.means());
    for (moved, mean) in moved.means()[cactus.len()..].iter().zip(balls.means()) {
        assert!((moved[0] - mean[0] - 1.0).abs() < 1e-5 && moved[1] == mean[1], "{moved:?} from {mean:?}");
    }
    offscreen.viewer().scenes.layers[0].is_shown[0] = false;
    offscreen.settle().unwrap();
    assert_eq!(offscreen.session.pair.first.as_ref().unwrap().statistics.count, balls.len());
    let numbers: Vec<u64> = offscreen.viewer().scenes.layers.iter().map(|layer| layer.number).collect();
    numbers.iter().for_each(|number| offscreen.viewer().close(*number));
    offscreen.settle().unwrap();
    assert!(shown(&mut offscreen).rgba.iter().all(|p| p[..3] == [0.0; 3]), "nothing is left");
}

#[test]
#[ignore = "long: every knob is measured, and a budget searched"]
fn long_knobs_are_measured_and_chosen_by_a_budget() {
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["cactus:300"]));
    offscreen.viewer().options.key_bits = 16;
    offscreen.viewer().requests.push(Request::Measure);
    offscreen.settle().unwrap();
    let (costs, of) = offscreen.viewer().measuring.costs.clone().unwrap();
    assert_eq!(costs.options.key_bits, 16);
    let is_of_this = |viewer: &Viewer| of.as_ref().unwrap().difference(&viewer.picture_content().unwrap());
    assert_eq!(is_of_this(offscreen.viewer()), None);
    let knobs: Vec<&str> = costs.knobs.iter().map(|cost| cost.knob).collect();
    assert_eq!(knobs, ["stop", "key-bits", "sh-storage", "shape-storage", "all together"]);
    assert!(costs.exact_ms > 0.0 && costs.knobs.iter().all(|cost| cost.ms > 0.0 && cost.psnr > 30.0));
    offscreen.viewer().options = Options { rules: offscreen.viewer().options.rules, ..Options::EXACT };
    offscreen.viewer().measuring.budget.max_error = 0.05;
    offscreen.viewer().requests.push(Request::Choose);
    let exact = offscreen.viewer().options;
    offscreen.settle().unwrap();
    // Nothing may be faster on a device that is busy elsewhere; what is chosen keeps the budget either way.
    let chosen = offscreen.viewer().options;
    let [exact, chosen] = [exact, chosen].map(|options| rendered(&gpu, &mut offscreen, &options));
    assert!(max_error(&exact, &chosen) <= 0.05 + 1.0 / 255.0);
}

#[test]
fn films_and_pictures_are_written_as_by_render() {
    let gpu = Gpu::new();
    let folder = tempfile::tempdir().unwrap();
    let mut offscreen = open(&gpu, setup(&["cactus:2000"]));
    let viewer = offscreen.viewer();
    viewer.add_key();
    viewer.view.navigator.orbit(glam::DVec2::new(40.0, 10.0), SIZE);
    viewer.add_key();
    viewer.film.fps = 1.0;
    viewer.export.film = folder.path().join("film").display().to_string();
    viewer.export.picture = folder.path().join("one.png").display().to_string();
    viewer.export.size = Some([64, 48]);
    viewer.requests.extend([Request::WriteFilm(None)]);
    offscreen.settle().unwrap();
    offscreen.viewer().requests.push(Request::WritePicture(None));
    offscreen.settle().unwrap();
    let frames: Vec<PathBuf> = (0..3).map(|i| folder.path().join(format!("film/{i:05}.png"))).collect();
    assert!(frames.iter().all(|frame| frame.is_file()) && !folder.path().join("film/00003.png").exists());
    // The last frame is the last key, which is the view.
    let [last, one] = [&frames[2], &folder.path().join("one.png")].map(|file| Pixels::read(file).unwrap());
    assert_eq!((last.size, &last), ([64, 48], &one));
    let options = offscreen.viewer().options;
    let view = offscreen.viewer().view.camera().resized([64, 48]);
    let gaussians = offscreen.session.pair.first.as_ref().unwrap().gaussians.clone().unwrap();
    assert_eq!(gpu.render(&gaussians, &view, &options).to_rgb8(), one.to_rgb8());
}

#[test]
fn a_copied_view_is_restored_bit_for_bit() {
    let gpu = Gpu::new();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("cameras.json");
    let mut offscreen = open(&gpu, setup(&["cactus:500"]));
    offscreen.viewer().view.navigator.orbit(glam::DVec2::new(17.0, 5.0), SIZE);
    let view = offscreen.viewer().view.camera();
    let copied = camera::to_json(&view);
    offscreen.viewer().view.navigator.orbit(glam::DVec2::new(50.0, 0.0), SIZE);
    offscreen.viewer().paste_view(&copied);
    assert_eq!(offscreen.viewer().view.camera(), view);
    camera::write(&file, &[NamedCamera::new("view".to_owned(), view.clone())]).unwrap();
    offscreen.viewer().drop_file(&file);
    offscreen.settle().unwrap();
    assert_eq!(offscreen.viewer().view.camera(), view);
}

/// A page file with levels of detail of a small scene.
pub(super) fn levels(folder: &std::path::Path) -> PathBuf {
    let output = folder.join("levels.smalto");
    let settings = Settings { has_levels: true, ..Settings::default() };
    let job = Job::new(&output, settings, "test");
    write_whole(&job, &cactus(60_000).unwrap()).unwrap();
    output
}

/// The levels of a picture at rest are corrected until their measured error is the one that is asked for.
#[test]
fn a_wanted_psnr_is_kept_at_rest() {
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let file = levels(folder.path());
    for wanted in [30.0, 42.0] {
        let options = Options { lod_psnr: wanted, ..Options::default() };
        let mut offscreen = open(&gpu, Setup { options, ..setup(&[file.to_str().unwrap()]) });
        let (camera, background) = (offscreen.viewer().view.camera(), offscreen.viewer().view.background);
        let renderer = &mut offscreen.session.pair.first.as_mut().unwrap().renderer;
        let sampled = renderer.sample_psnr(&camera, background, 1000).unwrap();
        // Cuts change by pages, of which so small a scene has few.
        assert!((0.0..3.0).contains(&sampled.surplus(wanted.into())), "{sampled:?} in place of {wanted} dB");
        assert!(offscreen.session.title().contains(&format!("({:.1} dB", sampled.psnr())));
    }
}

#[test]
fn a_scene_with_levels_is_read_page_by_page() {
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let file = levels(folder.path());
    let options = Options { splats: 20_000, ..Options::default() };
    let mut offscreen = open(&gpu, Setup { options, ..setup(&[file.to_str().unwrap()]) });
    let residency = offscreen.session.residency().unwrap();
    assert!(residency.missing == 0 && residency.resident > 20 && residency.is_settled(), "{residency:?}");
    assert!(offscreen.session.title().starts_with("levels.smalto ("), "{}", offscreen.session.title());
    // At rest the error of the levels is measured: all patches of so small a picture are drawn.
    let (camera, background) = (offscreen.viewer().view.camera(), offscreen.viewer().view.background);
    let renderer = &mut offscreen.session.pair.first.as_mut().unwrap().renderer;
    let sampled = renderer.sample_psnr(&camera, background, 1000).unwrap();
    assert!(sampled.patches[0] == sampled.patches[1] && sampled.psnr() > 20.0, "{sampled:?}");
    let said = format!("({:.1} dB +- 0.0 to all Gaussians)", sampled.psnr());
    assert!(offscreen.session.title().contains(&said), "{}, {said}", offscreen.session.title());
    // The picture that is written waits for all pages, and the one on the screen shows the same.
    let (screen, picture) = (shown(&mut offscreen), folder.path().join("view.png"));
    offscreen.viewer().export.picture = picture.to_str().unwrap().to_owned();
    offscreen.viewer().requests.push(Request::WritePicture(None));
    offscreen.settle().unwrap();
    let written = Pixels::read(&picture).unwrap();
    assert_eq!(max_error(&screen, &written), 0.0);
    // What needs all Gaussians says so, and the window goes on.
    offscreen.viewer().requests.push(Request::Pick([80, 48]));
    let refusal = offscreen.settle().unwrap_err().to_string();
    assert!(refusal.contains("needs a scene that is in memory as a whole"), "{refusal}");
    offscreen.viewer().messages = Default::default();
    offscreen.viewer().inspector.settings.mode = smalto::viewer::view_mode("evaluations").unwrap();
    let refusal = offscreen.settle().unwrap_err().to_string();
    assert!(refusal.contains("this look needs"), "{refusal}");
    offscreen.viewer().messages = Default::default();
    offscreen.settle().unwrap();
    assert_eq!(offscreen.viewer().inspector.settings.mode, 0);
    // What pages show of themselves is shown, and a double click finds what lies under it.
    for name in ["depth", "normals", "level", "predicted-error-log2", "missing-levels"] {
        offscreen.viewer().inspector.settings.mode = smalto::viewer::view_mode(name).unwrap();
        offscreen.settle().unwrap();
        assert!(max_error(&shown(&mut offscreen), &screen) > 0.1, "{name}");
    }
    offscreen.viewer().inspector.settings.mode = 0;
    offscreen.settle().unwrap();
    let before = offscreen.viewer().view.camera();
    offscreen.viewer().requests.push(Request::Focus([80, 48]));
    offscreen.settle().unwrap();
    let pivot = offscreen.viewer().view.navigator.pivot();
    let along = before.view(pivot);
    assert!(along.z > 0.0 && along.truncate().length() < 0.02 * along.z, "it lies in the direction of the pixel");
    assert_eq!(gpu.0.validation_messages(), Vec::<String>::new());
}

#[test]
fn a_rate_of_frames_is_kept_by_the_number_of_nodes() {
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let file = levels(folder.path());
    let options = Options { lod_fade: 0.5, ..Options::default() };
    let plain = Setup { options, ..setup(&[file.to_str().unwrap()]) };
    let whole = open(&gpu, plain.clone()).session.pair.first.as_ref().unwrap().frame.totals.visible;
    let mut offscreen = open(&gpu, Setup { fps: Some(10_000.0), ..plain });
    for _ in 0..40 {
        offscreen.viewer().pictures.are_stale = true;
        offscreen.frame(Vec::new()).unwrap();
    }
    offscreen.session.retire_frames(true).unwrap();
    let visible = offscreen.session.pair.first.as_ref().unwrap().frame.totals.visible;
    assert!(visible < whole / 2 && visible > 1_000, "{visible} of {whole}");
}

/// A black picture says why it is black.
#[test]
fn no_picture_is_black_without_a_sentence() {
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, Setup { hides_panels: false, ..setup(&["cactus:500"]) });
    let says = |offscreen: &mut Offscreen| {
        offscreen.viewer().pictures.are_stale = true;
        offscreen.settle().unwrap();
        offscreen.session.viewer.why_nothing_is_seen(&offscreen.session.pair)
    };
    assert_eq!(says(&mut offscreen), None);
    let view = offscreen.viewer().view.navigator.clone();
    let camera = offscreen.viewer().view.camera();
    let behind =
        smalto::camera::Camera::looking_at(100.0 * camera.position, 200.0 * camera.position, camera.size_px, 0.5);
    offscreen.viewer().view.snap(&behind);
    let sentence = says(&mut offscreen).expect("nothing is in view");
    assert!(sentence.starts_with("no Gaussian is in view") && sentence.contains("(C shows all scenes)"), "{sentence}");
    offscreen.viewer().view.navigator = view;
    let near = std::mem::replace(&mut offscreen.viewer().options.rules.near, 500.0);
    assert!(says(&mut offscreen).unwrap().contains("near plane at 500"));
    offscreen.viewer().options.rules.near = near;
    assert_eq!(says(&mut offscreen), None);
    offscreen.viewer().panels.recent.tab = Tab::Edit;
    for (which, modifiers) in [(Key::A, Modifiers::COMMAND), (Key::Delete, Modifiers::NONE)] {
        super::interaction::frame(&mut offscreen, vec![super::interaction::key(which, modifiers)]);
        offscreen.settle().unwrap();
    }
    let sentence = says(&mut offscreen).expect("all are deleted");
    assert!(sentence.starts_with("no Gaussian is left") && sentence.contains("(Ctrl+Z undoes)"), "{sentence}");
    super::interaction::frame(&mut offscreen, vec![super::interaction::key(Key::Z, Modifiers::COMMAND)]);
    assert_eq!(says(&mut offscreen), None);
    offscreen.viewer().scenes.layers[0].is_shown[0] = false;
    assert!(says(&mut offscreen).unwrap().contains("no scene is shown"));
}
