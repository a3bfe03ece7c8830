//! Selection of the cameras that a command draws from: found beside the scene, chosen from a file, or given on the
//! command line.

use std::fs;
use std::path::Path;

use crate::common::program::{fails, ok, path, run, smalto};
use glam::{DMat3, DVec3};
use smalto::camera::{self, Camera, NamedCamera, Split, Timeline};

use super::cameras::{FRAME, read, refused, written};

const SIZE: [u32; 2] = [32, 24];

/// Twelve cameras whose images are numbered from 100 on, in a file.
fn numbered(folder: &tempfile::TempDir) -> (String, Vec<NamedCamera>) {
    let one = |i: usize| {
        NamedCamera::new(
            format!("{}.jpg", 100 + i),
            Camera::looking_at(DVec3::new(i as f64 / 4.0 - 1.5, -1.5, -4.0), DVec3::new(0.0, -1.2, 0.0), SIZE, 1.0),
        )
    };
    let cameras: Vec<_> = (0..12).map(one).collect();
    let file = path(folder, "views.json");
    camera::write(Path::new(&file), &cameras).unwrap();
    (file, cameras)
}

/// The names of the files in a folder, without hidden ones.
pub(super) fn pictures(folder: &str) -> Vec<String> {
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<_> = files.filter(|name| !name.starts_with('.')).collect();
    names.sort();
    names
}

/// The names of the pictures that are drawn into a folder.
fn drawn(folder: &tempfile::TempDir, arguments: &[&str]) -> Vec<String> {
    let out = path(folder, "drawn");
    _ = fs::remove_dir_all(&out);
    ok(&[&["render", "cactus:300", "-o", &format!("{out}/")], arguments].concat());
    pictures(&out)
}

#[test]
fn cameras_are_chosen_from_the_end_by_open_ranges_and_without_an_ending() {
    let folder = tempfile::tempdir().unwrap();
    let (file, _) = numbered(&folder);
    let choose = |camera: &str| drawn(&folder, &["--cameras", &file, "--camera", camera]);
    for (camera, expected) in [
        ("-1", &[11][..]),
        ("-12", &[0]),
        ("103", &[3]),
        ("103.jpg", &[3]),
        ("10..", &[10, 11]),
        ("..1", &[0, 1]),
        ("-2..", &[10, 11]),
        ("-3..-2", &[9, 10]),
        ("0,-1,104", &[0, 4, 11]),
    ] {
        let expected: Vec<_> = expected.iter().map(|index| format!("{index:05}.png")).collect();
        assert_eq!(choose(camera), expected, "{camera}");
    }
    for (camera, expected) in [
        ("-13", "there is no camera -13: they are 0 to 11"),
        ("12", "there is no camera 12: they are 0 to 11"),
        ("..12", "there is no camera ..12: they are 0 to 11, from '100.jpg' to '111.jpg'"),
        ("-1..3", "--camera -1..3 is empty: 11 is greater than 3"),
        ("99.png", "there is no camera 99.png"),
    ] {
        let error = fails(2, &["render", "cactus:300", "--cameras", &file, "--camera", camera]);
        assert!(error.contains(expected), "{error}");
    }
    let (file, mut cameras) = numbered(&folder);
    cameras[5].name = "103.png".to_owned();
    camera::write(Path::new(&file), &cameras).unwrap();
    let error = fails(2, &["render", "cactus:300", "--cameras", &file, "--camera", "103"]);
    assert!(error.contains("--camera 103 may be '103.jpg' or '103.png': write one of these names"), "{error}");
}

#[test]
fn cameras_of_a_split_keep_their_positions_in_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let (file, _) = numbered(&folder);
    let of = |split: &str, more: &[&str]| drawn(&folder, &[&["--cameras", &file, "--split", split], more].concat());
    assert_eq!(of("test", &["--camera", "all"]), ["00000.png", "00008.png"]);
    assert_eq!(of("test", &["--camera", "8"]), ["00008.png"]);
    assert_eq!(of("test", &["--camera", "-1"]), ["00008.png"]);
    assert_eq!(of("train", &[]), ["00001.png"], "the first of the split");
    assert_eq!(of("train", &["--camera", "7..9"]), ["00007.png", "00009.png"]);
    assert_eq!(of("train", &["--camera", "all"]).len(), 10);
    let error = fails(2, &["render", "cactus:300", "--cameras", &file, "--split", "train", "--camera", "8"]);
    assert!(error.contains("there is no camera 8 in this split: they are 1 to 11"), "{error}");
}

/// A scene with cameras that see it, in a folder.
fn with_scene(folder: &tempfile::TempDir) -> String {
    let scene = path(folder, "scene.ply");
    ok(&["convert", "cactus:300", &scene]);
    scene
}

#[test]
fn the_files_of_a_blender_set_are_found_and_named_in_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let scene = with_scene(&folder);
    let root = folder.path().canonicalize().unwrap();
    for (name, frames) in [("train", 3), ("val", 1), ("test", 2)] {
        let text = format!(r#"{{"camera_angle_x": 0.7, "frames": [{}]}}"#, vec![FRAME; frames].join(","));
        fs::write(root.join(format!("transforms_{name}.json")), text).unwrap();
        assert_eq!(camera::find(&root.join("scene.ply")), Some(root.clone()), "{name}");
    }
    let arguments = ["render", &scene, "--size", "32x24", "-o", &path(&folder, "out/"), "--camera", "all"];
    let output = smalto(&arguments);
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{error}");
    assert_eq!(error.matches("note: cameras of ").count(), 1, "{error}");
    assert!(error.contains(&format!("note: cameras of {}\n", folder.path().display())), "{error}");
    assert_eq!(pictures(&path(&folder, "out")).len(), 6);
    // A file that the user names needs no note.
    let output = smalto(&[&arguments[..], &["--cameras", folder.path().to_str().unwrap()]].concat());
    assert!(output.status.success() && !String::from_utf8(output.stderr).unwrap().contains("note: cameras"));
}

#[test]
fn an_angle_of_view_needs_a_size_but_no_photograph() {
    let angle = format!(r#"{{"camera_angle_x": 1.5707963267948966, "frames": [{FRAME}]}}"#);
    let (_folder, file) = written("transforms_test.json", angle);
    assert!(refused(&file).contains("it has no size (w and h), and its photograph "));
    let read = camera::read_at(&file, Some([40, 30])).unwrap();
    let camera = &read.cameras[0].camera;
    assert!(camera.size_px == [40, 30] && (camera.focal_px.x - 20.0).abs() < 1e-12);
    assert_eq!(read.of(Split::Test).len(), 1);
    // A focal length in pixels means nothing without the size of its picture.
    let (_folder, file) = written("transforms.json", format!(r#"{{"fl_x": 20, "frames": [{FRAME}]}}"#));
    assert!(camera::read_at(&file, Some([40, 30])).is_err());
}

#[test]
fn marks_whole_floats_and_rounded_rotations_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let (file, cameras) = numbered(&folder);
    let text = fs::read_to_string(&file).unwrap().replace("\"width\":32,", "\"width\":32.0,");
    assert!(text.contains("32.0"));
    fs::write(&file, format!("\u{feff}{text}")).unwrap();
    assert_eq!(read(&file).cameras, cameras);
    assert_eq!(Timeline::read(Path::new(&file)).unwrap().keys().len(), 12);
    let (_folder, transforms) =
        written("transforms.json", format!("\u{feff}{{\"w\": 8, \"h\": 8, \"fl_x\": 9, \"frames\": [{FRAME}]}}"));
    assert_eq!(read(&transforms).cameras.len(), 1);
    for (digits, is_read) in [(1e3, true), (1e2, false)] {
        let tilted = DMat3::from_euler(glam::EulerRot::XYZ, 0.4, 0.7, -1.1);
        let rounded = tilted.to_cols_array_2d().map(|column| column.map(|v| (v * digits).round() / digits));
        let entry = format!(
            r#"[{{"id": 0, "img_name": "a", "width": 32, "height": 24, "position": [0, 0, 0],
            "rotation": {rounded:?}, "fx": 30, "fy": 30}}]"#
        );
        fs::write(&file, entry).unwrap();
        if is_read {
            let rotation = read(&file).cameras[0].camera.rotation;
            assert!((rotation * rotation.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-14), "{rotation}");
            assert!(rotation.abs_diff_eq(tilted, 1e-3));
        } else {
            let problem = refused(&file);
            let expected = "its rotation is not a rotation matrix: R R^T differs from the identity by ";
            assert!(problem.contains(expected) && problem.ends_with(", over 0.005"), "{problem}");
        }
    }
}

#[test]
#[cfg(unix)]
fn a_fifo_in_the_place_of_the_dataparser_is_refused() {
    let (folder, file) = written("transforms.json", format!(r#"{{"w": 8, "h": 8, "fl_x": 9, "frames": [{FRAME}]}}"#));
    let made = std::process::Command::new("mkfifo").arg(folder.path().join("dataparser_transforms.json")).status();
    assert!(made.unwrap().success());
    assert_eq!(refused(&file), "dataparser_transforms.json: is not a file");
}

#[test]
fn a_camera_by_its_place_is_that_of_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let pictures =
        [("eye.png", &["--eye", "-1,-2.5,-3", "--target", "0,-1.2,0", "--fov", "40"][..]), ("file.png", &[])];
    let [position, target] = [DVec3::new(-1.0, -2.5, -3.0), DVec3::new(0.0, -1.2, 0.0)];
    let camera = Camera::looking_at(position, target, SIZE, 40_f64.to_radians());
    let file = path(&folder, "one.json");
    camera::write(Path::new(&file), &[NamedCamera::new(String::new(), camera)]).unwrap();
    for (name, by) in pictures {
        let by = if by.is_empty() { &["--cameras", &file][..] } else { by };
        let out = path(&folder, name);
        ok(&[&["render", "cactus:300", "--size", "32x24", "--near", "0.01", "-o", &out], by].concat());
    }
    let bytes = |name: &str| fs::read(path(&folder, name)).unwrap();
    assert_eq!(bytes("eye.png"), bytes("file.png"));
    // Upside down, the picture is turned by half a turn.
    let out = path(&folder, "down.png");
    ok(&[
        &["render", "cactus:300", "--size", "32x24", "--near", "0.01", "-o", &out],
        pictures[0].1,
        &["--camera-up", "0,1,0"],
    ]
    .concat());
    let [upright, turned] = ["eye.png", "down.png"].map(|name| image::open(path(&folder, name)).unwrap().to_rgb8());
    let turned = image::imageops::rotate180(&turned);
    let largest = upright.iter().zip(turned.iter()).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(largest <= Some(2), "{largest:?}");
    ok(&["bench", "cactus:300", "--size", "32x24", "--eye", "-1,-2,-3", "--frames", "2", "--warmup", "0"]);
    for wrong in [
        &["--target", "0,0,0"][..],
        &["--fov", "40"],
        &["--camera-up", "0,1,0"],
        &["--eye", "1,2"],
        &["--eye", "1,2,nan"],
        &["--eye", "1,2,3", "--fov", "180"],
        &["--eye", "1,2,3", "--target", "1,2,3"],
        &["--eye", "1,2,3", "--camera-up", "0,0,0"],
        &["--eye", "1,2,3", "--cameras", "a.json"],
        &["--eye", "1,2,3", "--camera", "0"],
        &["--eye", "1,2,3", "--split", "test"],
        &["--eye", "1,2,3", "--path", "a.json"],
        &["--eye", "1,2,3", "--orbit", "3"],
        &["--eye", "1,2,3", "--names", "image"],
        &["--orbit", "3", "--camera", "0"],
        &["--orbit", "3", "--split", "test"],
        &["--orbit", "3", "--path", "a.json"],
        &["--orbit", "3", "--dump", "d"],
        &["--orbit", "3", "--names", "image"],
        &["--orbit", "0"],
    ] {
        fails(2, &[&["render", "cactus:300", "--size", "32x24"], wrong].concat());
    }
    fails(2, &["bench", "cactus:300", "--eye", "1,2,3", "--path", "orbit"]);
}

#[test]
fn an_orbit_is_drawn_in_equal_steps_around_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let names = drawn(&folder, &["--orbit", "4", "--size", "32x24"]);
    assert_eq!(names, ["00000.png", "00001.png", "00002.png", "00003.png"]);
    let pictures: Vec<_> =
        names.iter().map(|name| fs::read(path(&folder, &format!("drawn/{name}"))).unwrap()).collect();
    assert!(pictures.windows(2).all(|pair| pair[0] != pair[1]));
    let output = run(
        &["render", "cactus:300", "--orbit", "2", "--size", "32x24", "--video", "--fps", "4", "-o", "turn"],
        |command| _ = command.current_dir(folder.path()),
    );
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && text.contains("ffmpeg -framerate 4 -i "), "{text}");
}
