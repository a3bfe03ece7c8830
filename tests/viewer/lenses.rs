//! Views through lenses, without a window: what is drawn, copied, and refused.

use std::fs;

use glam::DVec2;
use smalto::camera::{LensChoice, NamedCamera, write};
use smalto::options::Options;
use smalto::pixels::Pixels;
use smalto::render::Path;
use smalto::rules::Response;
use smalto::viewer::{Offscreen, Program, Request, Setup, view_mode};

use super::frames::{SIZE, levels, open, rendered, setup, shown};
use crate::common::Gpu;
use crate::common::lens::{all, sphere};
use crate::common::program::{ok, path};

fn is_along_rays(offscreen: &Offscreen) -> bool {
    matches!(offscreen.session.pair.first.as_ref().unwrap().path, Path::Rays | Path::FastRays)
}

fn lens(offscreen: &mut Offscreen) -> Option<String> {
    offscreen.viewer().view.camera().lens.map(|lens| lens.text())
}

#[test]
fn a_lens_is_drawn_as_render_draws_it_and_its_command_draws_the_same() {
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let mut offscreen = open(&gpu, setup(&["cactus:3000"]));
    let pinhole = shown(&mut offscreen);
    for text in ["FISHEYE", "OPENCV:-0.05,0.01,0.001,-0.001", "ORTHOGRAPHIC", "EQUIRECTANGULAR"] {
        offscreen.viewer().set_lens(text);
        if text == "FISHEYE" {
            offscreen.viewer().view.navigator.set_field_of_view(140.0);
        }
        offscreen.settle().unwrap();
        assert_eq!(lens(&mut offscreen).as_deref(), Some(text));
        assert!(is_along_rays(&offscreen), "{text}");
        let options = offscreen.viewer().options;
        let picture = shown(&mut offscreen);
        assert!(picture != pinhole && picture == rendered(&gpu, &mut offscreen, &options), "{text}");
        let (line, left_out) = offscreen.viewer().command_line(Program::Render);
        let out = path(&folder, "view.png");
        let mut words = shlex::split(&line).unwrap();
        let is_named = words.windows(2).any(|pair| pair == ["--lens", text]);
        assert!(is_named && left_out.is_empty(), "{line}, without {left_out:?}");
        *words.last_mut().unwrap() = out.clone();
        ok(&words[1..].iter().map(String::as_str).collect::<Vec<_>>());
        assert!(Pixels::read(out.as_ref()).unwrap() == picture, "{line}");
    }
    offscreen.viewer().set_lens("PINHOLE");
    offscreen.settle().unwrap();
    assert_eq!(lens(&mut offscreen), None);
    offscreen.viewer().set_lens("OPENCV:0.1");
    let refusal = offscreen.settle().unwrap_err().to_string();
    assert!(refusal.contains("OPENCV has 4 lens parameters"), "{refusal}");
    assert_eq!(lens(&mut offscreen), None);
}

#[test]
fn cameras_of_a_file_are_drawn_through_their_lenses_or_as_pinholes() {
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let file = folder.path().join("cameras.json");
    let (_, camera) = all(SIZE).swap_remove(1);
    write(&file, &[NamedCamera::new("one".to_owned(), camera)]).unwrap();
    for (lenses, expected) in
        [(LensChoice::Own, Some("OPENCV_FISHEYE:-0.02,0.004,-0.001,0.0001")), (LensChoice::Undistorted, None)]
    {
        let cameras = Some(file.clone());
        let mut offscreen = open(&gpu, Setup { cameras, lenses: lenses.clone(), ..setup(&["cactus:3000"]) });
        assert_eq!(lens(&mut offscreen).as_deref(), expected);
        assert_eq!(is_along_rays(&offscreen), expected.is_some());
        let (line, _) = offscreen.viewer().command_line(Program::Render);
        assert_eq!(line.contains("--undistort"), lenses == LensChoice::Undistorted, "{line}");
    }
}

#[test]
fn points_under_the_cursor_lie_on_the_ray_of_the_pixel() {
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["cactus:3000"]));
    for text in ["FISHEYE", "ORTHOGRAPHIC"] {
        offscreen.viewer().set_lens(text);
        offscreen.settle().unwrap();
        let before = offscreen.viewer().view.camera();
        offscreen.viewer().requests.push(Request::Focus([80, 48]));
        offscreen.settle().unwrap();
        let (at, depth) = before.projected(offscreen.viewer().view.navigator.pivot()).unwrap();
        assert!(at.distance(DVec2::new(80.5, 48.5)) < 1e-6 && depth > 0.0, "{text}: {at}");
    }
}

#[test]
fn what_rays_do_not_show_is_left_with_a_sentence() {
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let mut offscreen = open(&gpu, setup(&["cactus:3000"]));
    offscreen.viewer().set_lens("FISHEYE");
    offscreen.settle().unwrap();
    for name in ["depth", "evaluations"] {
        offscreen.viewer().inspector.settings.mode = view_mode(name).unwrap();
        offscreen.settle().unwrap();
        assert_eq!(offscreen.viewer().inspector.settings.mode, view_mode(name).unwrap(), "{name} is shown");
    }
    offscreen.viewer().inspector.settings.mode = view_mode("ellipse-outlines").unwrap();
    let refusal = offscreen.settle().unwrap_err().to_string();
    assert!(refusal.contains("a camera with a lens (FISHEYE) has pictures without centres"), "{refusal}");
    offscreen.viewer().messages = Default::default();
    offscreen.settle().unwrap();
    assert_eq!((offscreen.viewer().inspector.settings.mode, lens(&mut offscreen).is_some()), (0, true));

    let file = levels(folder.path());
    let options = Options { splats: 20_000, ..Options::default() };
    let cameras = Some(folder.path().join("cameras.json"));
    write(cameras.as_ref().unwrap(), &[NamedCamera::new("one".to_owned(), all(SIZE).swap_remove(1).1)]).unwrap();
    let mut offscreen = Offscreen::new(Setup { cameras, options, ..setup(&[file.to_str().unwrap()]) }, &gpu.0, SIZE);
    let offscreen = offscreen.as_mut().unwrap();
    let refusal = offscreen.settle().unwrap_err().to_string();
    assert!(refusal.contains("without levels of detail; the view is a pinhole"), "{refusal}");
    offscreen.viewer().messages = Default::default();
    offscreen.settle().unwrap();
    assert_eq!(lens(offscreen), None);
    offscreen.viewer().options.rules.response = Response::Ray;
    let refusal = offscreen.settle().unwrap_err().to_string();
    assert!(refusal.contains("a camera along rays sees only scenes that are in GPU memory"), "{refusal}");
    offscreen.viewer().messages = Default::default();
    offscreen.viewer().options.rules.response = Response::Screen;
    offscreen.settle().unwrap();
    assert_eq!(gpu.0.validation_messages(), Vec::<String>::new());
    fs::remove_file(file).unwrap();
}

#[test]
fn a_panorama_fills_a_window_of_any_shape() {
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, setup(&["cactus:3000"]));
    offscreen.viewer().set_lens("EQUIRECTANGULAR");
    offscreen.settle().unwrap();
    let camera = offscreen.viewer().view.camera();
    assert_eq!((camera.focal_px, camera.centre_px), (sphere(SIZE).focal_px, sphere(SIZE).centre_px));
}
