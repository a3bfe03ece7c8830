//! Cameras that nobody named, camera paths of other programs, near planes, and directions without an up.

use std::fs;
use std::path::Path;

use glam::DVec3;
use serde_json::json;
use smalto::camera::{self, Camera, NamedCamera};

use crate::common::program::{fails, notes, ok, path, run};

#[test]
fn a_found_camera_file_that_cannot_be_used_is_a_note_and_the_default_view() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir_all(folder.path().join("a/b")).unwrap();
    let (scene, out) = (path(&folder, "a/b/scene.ply"), path(&folder, "a.png"));
    ok(&["convert", "cactus:50", &scene]);
    let render = ["render", &scene, "--size", "16x12", "-o", &out];
    ok(&render);
    let expected = fs::read(&out).unwrap();
    let frame = r#"{"camera_model": "ORTHOPHOTO", "w": 8, "h": 8, "fl_x": 5, "frames": [{"file_path": "a",
        "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}"#;
    for (name, text) in [
        ("cameras.json", r#"{"cameras":[{"name":"front"}]}"#),
        ("cameras.json", "[]"),
        ("cameras.json", "no JSON"),
        ("transforms.json", frame),
    ] {
        let file = path(&folder, name);
        fs::write(&file, text).unwrap();
        fs::remove_file(&out).unwrap();
        let said = notes(&render);
        assert!(said.contains(&format!("note: {file} was found, but it is not used: ")), "{said}");
        assert!(said.contains("(--cameras names another file)"), "{said}");
        assert!(fs::read(&out).unwrap() == expected, "{text}");
        assert!(fails(4, &[&render[..], &["--cameras", &file]].concat()).contains(name), "a named file is an error");
        let error = fails(2, &[&render[..], &["--camera", "3"]].concat());
        assert!(error.contains("--camera 3 needs a camera file"), "{error}");
        let error = fails(2, &["prune", &scene, "--min-psnr", "40", "-o", &path(&folder, "less.ply")]);
        assert!(error.contains("is not used") && error.contains("prune needs views"), "{error}");
        #[cfg(feature = "viewer")]
        assert!(notes(&["view", &scene, "--offscreen", "4", "--size", "64x48"]).contains("is not used"));
        fs::remove_file(file).unwrap();
    }
}

#[test]
fn a_near_plane_that_cuts_the_view_is_named_in_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, cameras, out) = (path(&folder, "small.ply"), path(&folder, "cameras.json"), path(&folder, "a.png"));
    // 1.5 cm high, seen from 8 cm away.
    ok(&["convert", "cactus:200", "--transform", "translate=0,1.2,0", "--transform", "scale=0.005", &scene]);
    let camera = Camera::looking_at(DVec3::new(0.0, 0.0, -0.08), DVec3::ZERO, [32, 24], 1.6);
    camera::write(Path::new(&cameras), &[NamedCamera::new("0".to_owned(), camera)]).unwrap();
    let render = |more: &[&str]| notes(&[&["render", &scene, "--camera", "0", "-o", &out], more].concat());
    let said = render(&[]);
    let lies = "Gaussians in view lie between the camera and the near plane of 0.2; --near sets it";
    assert!(said.contains(lies) && !said.contains("no Gaussian is in view"), "{said}");
    assert!(render(&["--reference"]).contains(lies));
    let counts = |said: &str| -> [usize; 2] {
        let (before, _) = said.split_once(" Gaussians in view lie").expect("the note has counts");
        let words: Vec<_> = before.split(' ').rev().take(3).collect();
        [words[2], words[0]].map(|word| word.parse().unwrap())
    };
    let [cut, all] = counts(&said);
    assert!(cut == all && all > 150, "{said}");
    let [part, same] = counts(&render(&["--near", "0.08"]));
    assert!(same == all && (all / 4..all).contains(&part), "{part} of {same}");
    assert!(!render(&["--near", "0.01"]).contains("near plane"));
    assert!(!notes(&["render", "cactus:200", "--size", "16x12", "-o", &out]).contains("near plane"));
}

/// A camera path of nerfstudio with cameras at these x, of OpenGL's axes.
fn nerfstudio_path(xs: &[f64]) -> serde_json::Value {
    let pose = |x: &f64| json!([1, 0, 0, x, 0, -1, 0, -1.2, 0, 0, -1, -5, 0, 0, 0, 1]);
    let camera = |x: &f64| json!({"camera_to_world": pose(x), "fov": 40, "aspect": 1.78});
    let cameras: Vec<_> = xs.iter().map(camera).collect();
    json!({"camera_type": "perspective", "render_width": 32, "render_height": 18, "fps": 5, "seconds": 1,
           "keyframes": [], "camera_path": cameras})
}

#[test]
fn a_camera_path_of_nerfstudio_is_drawn_frame_by_frame() {
    let folder = tempfile::tempdir().unwrap();
    let (file, film) = (path(&folder, "camera_path.json"), path(&folder, "film"));
    let xs = [-1.0, -0.5, 0.0, 0.5, 2.0];
    fs::write(&file, nerfstudio_path(&xs).to_string()).unwrap();
    let common = ["render", "cactus:100", "--path", &file, "-o", &film];
    let said = ok(&[&common[..], &["--video"]].concat());
    assert!(said.contains("ffmpeg -framerate 5 "), "{said}");
    assert_eq!(count(&film), 5);
    let focal = 9.0 / 20f64.to_radians().tan();
    for (number, x) in xs.iter().enumerate() {
        let view = |eye: DVec3| Camera::looking_at(eye, eye + DVec3::Z, [32, 18], 2.0 * (16.0 / focal).atan());
        let camera = NamedCamera::new(String::new(), view(DVec3::new(*x, -1.2, -5.0)));
        let (cameras, one) = (path(&folder, "one.json"), path(&folder, "one.png"));
        camera::write(Path::new(&cameras), &[camera]).unwrap();
        ok(&["render", "cactus:100", "--cameras", &cameras, "-o", &one]);
        let [found, expected] =
            [format!("{film}/{number:05}.png"), one].map(|file| image::open(file).unwrap().to_rgb8());
        let worst = found.as_raw().iter().zip(expected.as_raw()).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(
            worst <= Some(1),
            "frame {number}: rounding of focal lengths changes a value by a step at most: {worst:?}"
        );
    }
    // At another rate, along the motion through the cameras.
    let slow = path(&folder, "slow");
    ok(&["render", "cactus:100", "--path", &file, "--fps", "10", "-o", &slow]);
    assert_eq!(count(&slow), 9);
}

/// The number of pictures in a folder.
fn count(folder: &str) -> usize {
    let names = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name());
    names.filter(|name| !name.to_string_lossy().starts_with('.')).count()
}

#[test]
fn other_files_than_camera_paths_are_refused_with_what_is_expected() {
    let folder = tempfile::tempdir().unwrap();
    let file = path(&folder, "path.json");
    let refused = |text: &str| {
        fs::write(&file, text).unwrap();
        fails(4, &["render", "cactus:10", "--path", &file])
    };
    for text in [r#"{"a": 1}"#, "", "x"] {
        let error = refused(text);
        assert!(error.contains("path.json: is no camera path: expected a cameras.json"), "{error}");
        assert!(error.contains("or a camera_path.json of nerfstudio"), "{error}");
    }
    let with = |member: &str, value: serde_json::Value| {
        let mut file = nerfstudio_path(&[0.0]);
        file[member] = value;
        file.to_string()
    };
    for (member, value, expected) in [
        ("camera_type", json!("equirectangular"), "its camera_type equirectangular is not supported, only perspective"),
        ("camera_path", json!([]), "holds no camera"),
        ("render_width", json!(1.5), "its size 1.5x18.0 is not of whole numbers"),
        ("seconds", json!(0), "its length of 0.0 s is no time for 1 frames"),
        ("camera_path", json!([{"camera_to_world": [0], "fov": 1}]), "is not a camera path of nerfstudio"),
    ] {
        let error = refused(&with(member, value));
        assert!(error.contains(expected), "{error}");
    }
    let error = fails(2, &["render", "cactus:10", "--path", "orbit"]);
    assert!(error.contains("--orbit N draws a turn"), "{error}");
}

#[test]
fn an_up_direction_along_the_view_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let view = ["--eye", "0,-5,0", "--target", "0,0,0", "--size", "8x8", "-o", &path(&folder, "a.png")];
    let error = fails(2, &[&["render", "cactus:10", "--camera-up", "0,2,0"], &view[..]].concat());
    assert!(error.contains("--camera-up 0,2,0 is parallel to the view direction"), "{error}");
    ok(&[&["render", "cactus:10", "--camera-up", "0,0,1"], &view[..]].concat());
    // Without --camera-up, some direction across the view is up.
    ok(&[&["render", "cactus:10"], &view[..]].concat());
}

#[test]
fn former_spellings_are_understood_with_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "a.smalto");
    let said = notes(&["convert", "cactus:100", &out, "--memory", "64"]);
    assert!(said.contains("note: --memory 64 is now spelled --host-memory 64MiB"), "{said}");
    for (line, expected) in [
        ("convert cactus:10 a.smalto --host-memory 2048", "2048 bytes are too few: write a unit, like 4GB or 700MiB"),
        ("render --memory 2048", "--memory 2048: 2048 bytes are too few"),
        ("render --memory many", "--memory many: expected a size like 4GB, 1.5GB or 700MiB"),
        ("render --max-error x", "--max-error x: expected a number from 0 to 1000000, or steps of 8 bits like 2/255"),
        ("compare a b --max-error 1/x", "or steps of 8 bits like 2/255"),
        ("render --orbit many", "--orbit many: expected a whole number from 1 to 100000, like 500 or 60K"),
        ("lod cactus:10 -o a.ply --splats -1", "--splats -1: expected a whole number from 1 to "),
        ("info cactus:10 --sog-level x", "--sog-level x: expected a whole number from 0 to 1000"),
        ("convert a b --min-opacity x", "--min-opacity x: expected a number from 0 to 1"),
    ] {
        let output = run(&line.split(' ').collect::<Vec<_>>(), |command| _ = command.current_dir(folder.path()));
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && error.contains(expected), "{line}: {error}");
    }
    assert!(ok(&["info", "cactus:2K"]).contains("2000 Gaussians"));
}
