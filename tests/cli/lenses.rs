//! Cameras with lenses: of files and of the command line, what is refused, and commands that draw pinholes.

use std::fs;

use serde_json::{Value, json};

use super::shards::{cameras, pictures};
use crate::common::program::{fails, notes, ok, path};

/// A `transforms.json` with one camera before the cactus, and these members.
fn transforms(folder: &tempfile::TempDir, name: &str, members: &Value) -> String {
    let pose = [[1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, -1.2], [0.0, 0.0, -1.0, -4.0], [0.0, 0.0, 0.0, 1.0]];
    let mut file = json!({"w": 40, "h": 30, "fl_x": 24, "frames": [{"file_path": "a", "transform_matrix": pose}]});
    file.as_object_mut().unwrap().extend(members.as_object().unwrap().clone());
    let written = path(folder, name);
    fs::write(&written, file.to_string()).unwrap();
    written
}

#[test]
fn wrong_lenses_are_one_sentence() {
    for (line, sentence) in [
        ("--lens PAINT", "--lens PAINT: its camera model PAINT is not known"),
        ("--lens OPENCV:0.1", "OPENCV has 4 lens parameters (k1, k2, p1, p2), it has 1"),
        ("--lens FISHEYE:0.1", "FISHEYE has 0 lens parameters, it has 1"),
        ("--lens FOV:nan", "--lens FOV:nan: its parameters are not all numbers"),
        ("--lens FOV:inf", "its parameters are not all numbers"),
        ("--lens FOV:wide", "\"wide\" is not a number"),
        ("--lens FOV:4", "its omega 4.0 is not over 0 and under pi"),
        ("--lens SIMPLE_RADIAL:-1e8", "fold at the centre of the picture"),
        ("--lens", "a value is expected"),
        ("--lens FISHEYE --undistort", "cannot be combined"),
        ("--fov 200", "--fov 200: a pinhole sees at most 179 degrees: see --lens"),
        ("--fov 200 --lens PINHOLE", "--fov 200: a pinhole sees at most 179 degrees: see --lens"),
        (
            "--fov 200 --lens OPENCV_FISHEYE:-0.2,0,0,0",
            "--fov 200: the lens OPENCV_FISHEYE sees less than 147.9 degrees",
        ),
        ("--fov 180 --lens OPENCV:0.1,0,0,0", "--fov 180: the lens OPENCV sees less than 180.0 degrees"),
        ("--fov 361 --lens FISHEYE", "--fov 361: expected degrees from 0.01 to 360"),
    ] {
        let line = format!("render cactus:10 --size 8x8 --eye 0,-1,-5 {line}");
        let error = fails(2, &line.split(' ').collect::<Vec<_>>());
        assert!(error.starts_with("smalto: ") && error.contains(sentence), "{line}: {error}");
        assert_eq!(error.lines().count(), 1, "{line}: {error}");
    }
}

#[test]
fn what_no_lens_draws_is_refused_in_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let [pages, place, out] = ["a.smalto", "list.json", "a.exr"].map(|name| path(&folder, name));
    ok(&["lod", "cactus:9000", "-o", &pages]);
    fs::write(&place, json!({"places": [{"position": [0, 0, 0]}]}).to_string()).unwrap();
    for (scene, more, sentence) in [
        ("cactus:50", &["--place", &place][..], "sees no scenes at places"),
        (&pages, &[], "sees only scenes that are in GPU memory as a whole, without levels of detail"),
    ] {
        let render = ["render", scene, "--size", "8x8", "--lens", "FISHEYE", "-o", &out];
        let error = fails(2, &[&render[..], more].concat());
        let expected = format!("smalto: a camera with a lens (FISHEYE) {sentence}; --undistort draws a pinhole");
        assert_eq!(error.lines().last(), Some(expected.as_str()), "{more:?}: {error}");
        assert!(!fs::exists(&out).unwrap(), "{more:?}: nothing is written");
        let along_rays = ["render", scene, "--size", "8x8", "--response", "ray", "-o", &out];
        let error = fails(2, &[&along_rays[..], more].concat());
        let expected = format!("smalto: a camera along rays {sentence}; --response screen draws projections");
        assert_eq!(error.lines().last(), Some(expected.as_str()), "{more:?}: {error}");
        ok(&[&["render", scene, "--size", "8x8", "--undistort", "-o", &out], more].concat());
        fs::remove_file(&out).unwrap();
    }
}

#[test]
fn layers_of_depths_and_counts_are_drawn_through_a_lens() {
    let folder = tempfile::tempdir().unwrap();
    let read = |more: &[&str]| {
        let out = path(&folder, "a.npy");
        let eye = ["render", "cactus:300", "--size", "40x30", "--eye", "0,-1,-4", "--lens", "FISHEYE", "--fov", "200"];
        ok(&[&eye[..], &["-o", &out, "--layers", "depth,counts", "--preset", "exact"], more].concat());
        ["depth", "counts"].map(|layer| fs::read(path(&folder, &format!("a.{layer}.npy"))).unwrap())
    };
    let [depth, counts] = read(&[]);
    let [reference_depth, reference_counts] = read(&["--reference"]);
    assert!(counts == reference_counts);
    // 1200 numbers of 4 bytes follow the header.
    let numbers = |bytes: Vec<u8>| {
        let data = bytes[bytes.len() - 4 * 1200..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap()));
        data.collect::<Vec<_>>()
    };
    let (depth, reference) = (numbers(depth), numbers(reference_depth));
    let is_equal = |(a, b): (&f32, &f32)| a.is_nan() && b.is_nan() || (a - b).abs() <= 1e-4 * b;
    assert!(depth.iter().zip(&reference).all(is_equal));
    assert!(reference.iter().filter(|depth| !depth.is_nan()).count() > 100);
}

#[test]
fn undistorted_cameras_draw_the_bytes_of_pinholes() {
    let folder = tempfile::tempdir().unwrap();
    let plain = transforms(&folder, "plain.json", &json!({}));
    let lens = transforms(&folder, "lens.json", &json!({"camera_model": "OPENCV", "k1": -0.1, "k2": 0.01}));
    let out = path(&folder, "a.png");
    let draw = |cameras: &str, more: &[&str]| {
        let said =
            notes(&[&["render", "cactus:300", "--camera", "0", "-o", &out, "--cameras", cameras], more].concat());
        (fs::read(&out).unwrap(), said)
    };
    let (pinhole, said) = draw(&plain, &[]);
    assert!(!said.contains("lens"), "{said}");
    let (undistorted, said) = draw(&lens, &["--undistort"]);
    assert!(said.contains("1 of 1 cameras have lenses that distort (OPENCV), and are drawn as pinholes"), "{said}");
    assert!(undistorted == pinhole);
    assert!(draw(&lens, &["--lens", "PINHOLE"]).0 == pinhole);
    let (seen, said) = draw(&lens, &[]);
    let through = "1 of 1 cameras have lenses (OPENCV), which are drawn along the rays of their pixels";
    assert!(said.contains(through) && said.contains("--undistort draws pinholes"), "{said}");
    assert!(seen != pinhole);
    assert!(draw(&plain, &["--lens", "OPENCV:-0.1,0.01,0,0"]).0 == seen, "a lens of the command line");
    let [exact, reference] = [&["--preset", "exact"][..], &["--reference"]].map(|more| draw(&lens, more).0);
    let [exact, reference] = [exact, reference].map(|png| image::load_from_memory(&png).unwrap().to_rgba8().into_raw());
    assert!(exact.iter().zip(&reference).all(|(a, b)| a.abs_diff(*b) <= 1), "the reference has the lens, too");
}

#[test]
fn bench_and_trade_draw_lenses_and_other_commands_pinholes() {
    let folder = tempfile::tempdir().unwrap();
    let lens = transforms(&folder, "lens.json", &json!({"camera_model": "OPENCV_FISHEYE", "k1": -0.01}));
    let quick = ["--warmup", "0", "--frames", "1"];
    let bench = [&["bench", "cactus:50", "--cameras", &lens], &quick[..]].concat();
    assert!(notes(&bench).contains("which are drawn along the rays of their pixels"));
    assert!(notes(&[&bench[..], &["--undistort"]].concat()).contains("are drawn as pinholes"));
    let scene = path(&folder, "a.ply");
    ok(&["convert", "cactus:50", &scene]);
    let pruned = ["prune", &scene, "--cameras", &lens, "--min-psnr", "30", "-o", &path(&folder, "b.ply")];
    assert!(notes(&pruned).contains("are drawn as pinholes"));
    let trade = ["trade", "cactus:50", "--cameras", &lens, "--views", "1", "--size", "40x30", "--oracle-size", "40x30"];
    let trade = [&trade[..], &quick].concat();
    let promises = notes(&[&trade[..], &["--parts", "promises"]].concat());
    assert!(promises.contains("which are drawn along the rays of their pixels"), "{promises}");
    let certificate = [&trade[..], &["--parts", "certificate"]].concat();
    assert!(ok(&certificate).contains("0 violations"));
    assert!(notes(&[&certificate[..], &["--undistort"]].concat()).contains("are drawn as pinholes"));
    #[cfg(feature = "viewer")]
    {
        let said = ok(&["view", "cactus:50", "--cameras", &lens, "--offscreen", "4", "--size", "32x24"]);
        assert!(said.contains("rays"), "{said}");
    }
}

#[test]
fn a_lens_of_the_command_line_is_that_of_all_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let (file, all, eye) = (cameras(&folder, 2), path(&folder, "all"), path(&folder, "eye.png"));
    ok(&["render", "cactus:100", "--cameras", &file, "--camera", "all", "--lens", "equirectangular", "-o", &all]);
    assert_eq!(pictures(&all).len(), 2);
    for (lens, fov) in [("FISHEYE", "220"), ("EQUIRECTANGULAR", "50"), ("ORTHOGRAPHIC", "50")] {
        let said = ok(&[
            "render",
            "cactus:100",
            "--eye",
            "0,-1,-5",
            "--size",
            "16x12",
            "--lens",
            lens,
            "--fov",
            fov,
            "-o",
            &eye,
        ]);
        assert!(said.contains("rays path"), "{lens}: {said}");
    }
}
