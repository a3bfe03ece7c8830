//! Cameras with their photographs, and paths.

use std::path::{Path, PathBuf};

use egui::{Event, Key, Modifiers, PointerButton, pos2};
use glam::{DVec2, DVec3};
use smalto::camera::{self, Camera, NamedCamera};
use smalto::measure::metrics::psnr;
use smalto::pixels::{Alpha, Pixels};
use smalto::rules::Background;
use smalto::viewer::{CompareTarget, Offscreen, Request, Setup};

use super::frames::{SIZE, open, setup};
use super::interaction::{frame, key};
use crate::common::Gpu;
use crate::common::lens::through;

/// A scene with cameras around it, and the photographs of all but the last, which are renders; that of the camera "b"
/// is darker. Pixels without a ray are white.
fn with_photographs(folder: &Path, lens: &Camera) -> (Gpu, Offscreen, Vec<NamedCamera>) {
    let gpu = Gpu::new();
    let setup = Setup { hides_panels: false, ..setup(&["cactus:3000"]) };
    let mut offscreen = Offscreen::new(setup, &gpu.0, [700, 240]).unwrap();
    offscreen.settle().unwrap();
    let viewer = offscreen.viewer();
    let (home, pivot) = (viewer.view.camera(), viewer.view.navigator.pivot());
    let pose = |(i, name): (usize, &str)| {
        let turn = glam::DQuat::from_axis_angle(DVec3::Y, 0.3 * (i as f64 + 1.0));
        let position = pivot + turn * (home.position - pivot) * 0.7;
        let Camera { position, rotation, .. } = Camera::looking_at(position, pivot, [96, 64], 1.0);
        NamedCamera::new(format!("{name}.jpg"), Camera { position, rotation, ..lens.clone() })
    };
    let cameras: Vec<NamedCamera> = ["a", "b", "c", "d"].into_iter().enumerate().map(pose).collect();
    camera::write(&folder.join("cameras.json"), &cameras).unwrap();
    let options = viewer.options;
    let gaussians = offscreen.session.pair.first.as_ref().unwrap().gaussians.clone().unwrap();
    std::fs::create_dir(folder.join("images")).unwrap();
    for NamedCamera { name, camera, .. } in &cameras[..3] {
        let mut photograph = gpu.render(&gaussians, camera, &options);
        if name == "b.jpg" {
            photograph.rgba.iter_mut().flatten().for_each(|value| *value *= 0.8);
        }
        let blind = camera.seen().into_iter().flatten().enumerate().filter(|(_, sees)| !sees);
        blind.for_each(|(i, _)| photograph.rgba[i] = [1.0; 4]);
        photograph.write(folder.join("images").join(name).with_extension("png"), Alpha::Opaque).unwrap();
    }
    offscreen.viewer().drop_file(&folder.join("cameras.json"));
    offscreen.settle().unwrap();
    (gpu, offscreen, cameras)
}

fn pinhole() -> Camera {
    Camera::looking_at(DVec3::ZERO, DVec3::Z, [96, 64], 1.0)
}

fn press(offscreen: &mut Offscreen, which: Key) {
    let release =
        Event::Key { key: which, physical_key: None, pressed: false, repeat: false, modifiers: Modifiers::NONE };
    frame(offscreen, vec![key(which, Modifiers::NONE), release]);
    offscreen.settle().unwrap();
}

/// True if most of the scene with this number lies in the picture.
fn sees(offscreen: &mut Offscreen, number: usize) -> bool {
    let viewer = offscreen.viewer();
    let (view, focus) = (viewer.view.camera(), viewer.scenes.layers[number].placed_focus().unwrap());
    // Six points of its sphere.
    let mut ways = DVec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
    ways.all(|way| view.sees(DVec3::from(focus.centre) + way * focus.radius))
}

/// Scenes that are opened beside others come into sight, and nothing moves for those that are seen.
#[test]
fn scenes_that_are_opened_beside_others_come_into_sight() {
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["few-large:50"]));
    offscreen.viewer().scenes.layers[0].placement.translation = [0.0, 0.0, 40.0];
    press(&mut offscreen, Key::C);
    assert!(sees(&mut offscreen, 0), "the view of all follows the placement");
    let alone = offscreen.viewer().view.camera();
    offscreen.viewer().drop_file(Path::new("cactus:500"));
    offscreen.settle().unwrap();
    assert!(sees(&mut offscreen, 0) && sees(&mut offscreen, 1));
    let said = offscreen.viewer().messages.shown().iter().any(|note| note.text.contains("lay out of sight"));
    assert!(said, "it says why the view moved");
    // The next one lies where the cactus is.
    let both = offscreen.viewer().view.camera();
    offscreen.viewer().drop_file(Path::new("few-large:20"));
    offscreen.settle().unwrap();
    assert_eq!(offscreen.viewer().view.camera(), both);
    offscreen.viewer().undo(false);
    assert_eq!(offscreen.viewer().view.camera(), alone);
    // One alone.
    let number = offscreen.viewer().scenes.layers[1].number;
    offscreen.viewer().frame_layer(number);
    offscreen.settle().unwrap();
    assert!(sees(&mut offscreen, 1) && !sees(&mut offscreen, 0));
    assert!(offscreen.viewer().view.navigator.pivot().length() < 5.0, "the view turns around it");
}

/// Scenes that the window starts with are seen together, whichever is read first.
#[test]
fn scenes_that_the_window_starts_with_are_seen_together() {
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let far = folder.path().join("far.ply");
    crate::common::program::ok(&["convert", "few-large:50", far.to_str().unwrap(), "--transform", "translate=0,0,-40"]);
    let mut offscreen = open(&gpu, setup(&["few-large:50", far.to_str().unwrap()]));
    assert!(sees(&mut offscreen, 0) && sees(&mut offscreen, 1));
    let first = offscreen.viewer().view.camera();
    offscreen.viewer().view.navigator.orbit(DVec2::new(30.0, 4.0), SIZE);
    offscreen.viewer().reset_view();
    assert_eq!(offscreen.viewer().view.camera(), first);
}

#[test]
fn pixels_that_a_lens_does_not_see_are_not_scored() {
    let folder = tempfile::tempdir().unwrap();
    let (_, mut offscreen, cameras) = with_photographs(folder.path(), &through("FISHEYE", &[], [96, 64], 8.0));
    let blind = cameras[0].camera.seen().unwrap().into_iter().filter(|sees| !sees).count();
    assert!(blind > 1000, "{blind}");
    offscreen.viewer().requests.push(Request::Evaluate);
    frame(&mut offscreen, Vec::new());
    offscreen.settle().unwrap();
    for row in &offscreen.viewer().cameras.evaluation.as_ref().unwrap().rows {
        // The blind pixels are white in the photograph and black in the picture: less than 10 dB.
        assert!(row.psnr_db.unwrap() > if row.name == "b.jpg" { 15.0 } else { 45.0 }, "{row:?}");
    }
    offscreen.viewer().go_to_camera(0, true);
    offscreen.viewer().compare_with_photographs();
    offscreen.settle().unwrap();
    let measured = offscreen.viewer().comparison.pair_difference.as_ref().unwrap();
    // The photograph is enlarged.
    assert!(measured.difference.psnr_db.unwrap() > 20.0, "{measured:?}");
}

#[test]
fn cameras_are_clicked_and_compared_with_their_photographs() {
    let folder = tempfile::tempdir().unwrap();
    let (gpu, mut offscreen, cameras) = with_photographs(folder.path(), &pinhole());
    let viewer = offscreen.viewer();
    assert_eq!(
        viewer.cameras.photographs.as_ref().expect("they lie beside the cameras").count_of(&viewer.cameras.list),
        3
    );
    // A camera that is seen is clicked.
    viewer.frame_scene();
    viewer.view.navigator.advance(10.0);
    viewer.view.navigator.dolly(-6.0);
    press(&mut offscreen, Key::V);
    let viewer = offscreen.viewer();
    assert!(viewer.panels.recent.shows_cameras && viewer.view.camera_index.is_none());
    let (view, wanted) = (viewer.view.camera(), &cameras[1].camera);
    let seen = view.view(wanted.position);
    let at = seen.truncate() / seen.z * view.focal_px + view.centre_px;
    let is_inside = at.cmpge(DVec2::ZERO).all() && at.cmplt(DVec2::from(view.size_px.map(f64::from))).all();
    assert!(seen.z > 0.0 && is_inside, "the camera is in the picture: {at}");
    let pos = pos2(at.x as f32, at.y as f32);
    // What lies under the pointer is known one layout later.
    frame(&mut offscreen, vec![Event::PointerMoved(pos)]);
    frame(&mut offscreen, Vec::new());
    assert_eq!(offscreen.viewer().pointer.camera, Some(1));
    for pressed in [true, false] {
        let (button, modifiers) = (PointerButton::Primary, Modifiers::NONE);
        frame(&mut offscreen, vec![Event::PointerButton { pos, button, pressed, modifiers }]);
    }
    offscreen.settle().unwrap();
    // The picture does not wait for the thumbnail.
    offscreen.viewer().jobs.wait();
    frame(&mut offscreen, Vec::new());
    let viewer = offscreen.viewer();
    viewer.view.navigator.advance(10.0);
    assert_eq!((viewer.view.camera_index, viewer.view.camera().position), (Some(1), wanted.position));
    assert!(matches!(viewer.cameras.thumbnails.get(&1), Some(Some(small)) if small.size == [440, 293]));
    // Its photograph is compared, and then that of the next camera.
    viewer.compare_with_photographs();
    offscreen.settle().unwrap();
    let comparison = &offscreen.viewer().comparison;
    assert_eq!((comparison.target == CompareTarget::Picture, comparison.photograph_camera()), (true, Some(1)));
    press(&mut offscreen, Key::N);
    let viewer = offscreen.viewer();
    assert_eq!((viewer.view.camera_index, viewer.comparison.photograph_camera()), (Some(2), Some(2)));
    assert_eq!(viewer.comparison.picture.as_ref().unwrap().name, "c.png");
    // The camera without one leaves the photograph before, under its name.
    press(&mut offscreen, Key::N);
    assert_eq!(
        (offscreen.viewer().view.camera_index, offscreen.viewer().comparison.photograph_camera()),
        (Some(3), Some(2))
    );
    // Photographs stay where their cameras are read again after them.
    offscreen.viewer().open_photographs(&folder.path().join("images"));
    offscreen.settle().unwrap();
    let file = folder.path().join("elsewhere/cameras.json");
    std::fs::create_dir(folder.path().join("elsewhere")).unwrap();
    std::fs::copy(folder.path().join("cameras.json"), &file).unwrap();
    offscreen.viewer().drop_file(&file);
    offscreen.settle().unwrap();
    assert!(offscreen.viewer().cameras.photographs.is_some());
    // A photograph that is dropped finds its camera.
    offscreen.viewer().drop_file(&folder.path().join("images/a.png"));
    offscreen.settle().unwrap();
    assert_eq!(
        (offscreen.viewer().view.camera_index, offscreen.viewer().comparison.photograph_camera()),
        (Some(0), Some(0))
    );
    // All are measured, as the pictures and the files say.
    offscreen.viewer().requests.push(Request::Evaluate);
    frame(&mut offscreen, Vec::new());
    offscreen.settle().unwrap();
    let options = offscreen.viewer().options;
    let gaussians = offscreen.session.pair.first.as_ref().unwrap().gaussians.clone().unwrap();
    let evaluation = offscreen.viewer().cameras.evaluation.as_ref().unwrap();
    assert_eq!(evaluation.rows.iter().map(|row| row.name.as_str()).collect::<Vec<_>>(), ["a.jpg", "b.jpg", "c.jpg"]);
    for row in &evaluation.rows {
        let mut picture = gpu.render(&gaussians, &cameras[row.camera].camera, &options);
        picture.rgba.iter_mut().flatten().for_each(|value| *value = value.clamp(0.0, 1.0));
        let name = folder.path().join("images").join(&row.name).with_extension("png");
        let expected = psnr(&picture, &Pixels::read(&name).unwrap());
        assert!((row.psnr_db.unwrap() - expected).abs() < 1e-9, "{row:?}, not {expected}");
        assert_eq!(row.psnr_db.unwrap() > 45.0, row.name != "b.jpg", "{row:?}");
    }
    let [mean, ssim] = evaluation.means().map(Option::unwrap);
    assert!(mean > 30.0 && ssim > 0.9 && evaluation.to_csv().lines().count() == 4);
    // The numbers are of a picture: closing the scene forgets them.
    let number = offscreen.viewer().scenes.layers[0].number;
    offscreen.viewer().close(number);
    assert!(offscreen.viewer().cameras.evaluation.is_none() && offscreen.viewer().cameras.photographs.is_none());
}

#[test]
fn photographs_with_alpha_lie_over_the_background() {
    let folder = tempfile::tempdir().unwrap();
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["cactus:500"]));
    let file = folder.path().join("half.exr");
    Pixels { size: SIZE, rgba: vec![[0.25, 0.0, 0.0, 0.5]; 160 * 96] }.write(&file, Alpha::Transparent).unwrap();
    let viewer = offscreen.viewer();
    viewer.view.background = Background::Colour([0.0, 1.0, 0.5]);
    viewer.drop_file(&file);
    offscreen.settle().unwrap();
    let fitted = offscreen.viewer().comparison.fitted.clone().unwrap();
    assert_eq!(fitted.at(3, 3), [0.25, 0.5, 0.25, 0.5]);
}

#[test]
fn a_path_is_made_of_keys_turns_and_loops() {
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["cactus:500"]));
    let viewer = offscreen.viewer();
    let first = viewer.view.camera();
    viewer.add_key();
    viewer.view.navigator.orbit(DVec2::new(30.0, 0.0), SIZE);
    viewer.add_key();
    // Half way, the view of the path is a key like any other; the same time again replaces it.
    viewer.show_time(1.0);
    viewer.insert_key(1.0);
    let half = viewer.view.camera();
    viewer.view.navigator.orbit(DVec2::new(0.0, 20.0), SIZE);
    viewer.insert_key(1.0);
    let times =
        |viewer: &smalto::viewer::Viewer| viewer.film.timeline.keys().iter().map(|key| key.seconds).collect::<Vec<_>>();
    assert_eq!(times(viewer), [0.0, 1.0, 2.0]);
    assert!(viewer.film.timeline.keys()[1].camera == viewer.view.camera() && viewer.view.camera() != half);
    viewer.close_path().unwrap();
    assert_eq!((times(viewer), viewer.film.repeats), (vec![0.0, 1.0, 2.0, 4.0], true));
    assert!(viewer.film.timeline.is_closed() && viewer.film.timeline.keys()[3].camera == first);
    viewer.record_undo_step();
    // A turn leads around the pivot at its distance, looks at it all the time, and comes back.
    viewer.view.navigator.snap(&first);
    viewer.turn_path();
    let film = &viewer.film;
    let (pivot, radius) = (viewer.view.navigator.pivot(), first.position.distance(viewer.view.navigator.pivot()));
    assert!(film.timeline.is_closed() && film.timeline.keys()[0].camera == first);
    let mut least: f64 = 1.0;
    for camera in film.timeline.frames(8.0) {
        let off = (camera.position.distance(pivot) / radius - 1.0).abs();
        assert!(off < 5e-4, "{off} of the radius from the circle");
        least = least.min(camera.forward().dot((pivot - camera.position).normalize()));
        assert!((camera.position - first.position).dot(DVec3::Y).abs() < 1e-9 * radius + 1e-3, "it stays level");
    }
    let middle = first.forward().dot((pivot - first.position).normalize());
    assert!(least > middle - 2e-3, "{least} against {middle}");
    // Playing goes on at the end, and undo brings the path before back.
    viewer.film.now = viewer.film.end() - 0.1;
    viewer.film.is_playing = true;
    viewer.play(0.3);
    assert!(viewer.film.is_playing && (viewer.film.now - 0.2).abs() < 1e-9);
    viewer.film.is_playing = false;
    viewer.undo(false);
    assert_eq!(times(offscreen.viewer()).len(), 4);
}

#[test]
fn films_go_where_nothing_is_and_can_be_cancelled() {
    let folder = tempfile::tempdir().unwrap();
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["cactus:500"]));
    let viewer = offscreen.viewer();
    viewer.turn_path();
    viewer.export.film = folder.path().join("film").display().to_string();
    viewer.export.size = Some([48, 32]);
    viewer.film.fps = 1.0;
    for name in ["film", "film-2"] {
        offscreen.viewer().requests.push(Request::WriteFilm(None));
        offscreen.settle().unwrap();
        assert_eq!(folder.path().join(name).read_dir().unwrap().count(), 33, "{name}");
    }
    // What is cancelled ends soon, and what is written stays.
    offscreen.viewer().film.fps = 240.0;
    offscreen.viewer().requests.push(Request::WriteFilm(None));
    let written = || folder.path().join("film-3").read_dir().map_or(0, Iterator::count);
    while written() == 0 {
        frame(&mut offscreen, Vec::new());
    }
    offscreen.viewer().export.cancel.cancel();
    offscreen.settle().unwrap();
    let said = offscreen.viewer().messages.shown().last().unwrap().text.clone();
    assert!((1..7681).contains(&written()) && said.contains("of 7681 pictures"), "{said}");
    // A video needs ffmpeg, and nothing is left where it fails.
    let video: PathBuf = folder.path().join("film.mp4");
    offscreen.viewer().export.film = video.display().to_string();
    offscreen.viewer().film.fps = 1.0;
    offscreen.viewer().requests.push(Request::WriteFilm(None));
    let settled = offscreen.settle();
    let has_ffmpeg = std::process::Command::new("ffmpeg").arg("-version").output().is_ok();
    assert_eq!((video.is_file(), settled.is_ok()), (has_ffmpeg, has_ffmpeg));
    let said = offscreen.viewer().messages.shown().last().unwrap().text.clone();
    assert!(said.contains(if has_ffmpeg { "33 frames" } else { "needs ffmpeg" }), "{said}");
}
