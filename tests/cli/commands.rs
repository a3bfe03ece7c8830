//! The program as its users meet it: output, exit codes, sentences.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::program::{fails, fails_within, ok, path, run, smalto};
use smalto::pixels::Pixels;

fn png(path: impl AsRef<Path>) -> image::DynamicImage {
    image::open(path).expect("it is a PNG")
}

#[test]
fn render_without_a_scene_draws_the_cactus() {
    let folder = tempfile::tempdir().unwrap();
    let output = run(&["render", "--size", "160x120"], |c| {
        c.current_dir(folder.path());
    });
    assert!(output.status.success());
    let picture = png(folder.path().join("cactus.png")).to_rgb8();
    assert_eq!(picture.dimensions(), (160, 120));
    // Green in the middle, a warm backdrop in the corner.
    let (middle, corner) = (picture.get_pixel(80, 52).0, picture.get_pixel(3, 3).0);
    assert!(middle[1] > middle[2] && corner[0] > 150, "{middle:?} {corner:?}");
}

#[test]
fn render_twice_writes_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.png", "b.png"] {
        ok(&["render", "cactus:3000", "--size", "100x80", "-o", &path(&folder, name)]);
    }
    assert_eq!(fs::read(path(&folder, "a.png")).unwrap(), fs::read(path(&folder, "b.png")).unwrap());
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "nothing else is left behind");
}

#[test]
fn render_on_the_gpu_and_as_reference_look_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let common = ["render", "cactus:3000", "--size", "100x80", "-o"];
    ok(&[&common[..], &[&path(&folder, "gpu.png")]].concat());
    ok(&[&common[..], &[&path(&folder, "portable.png"), "--portable"]].concat());
    ok(&[&common[..], &[&path(&folder, "cpu.png"), "--reference"]].concat());
    let pixels = |name| png(path(&folder, name)).to_rgb8().into_raw();
    for name in ["gpu.png", "portable.png"] {
        let steps = pixels(name).iter().zip(pixels("cpu.png")).map(|(a, b)| a.abs_diff(b)).max().unwrap();
        assert!(steps <= 1, "{name}: {steps} steps of 255");
    }
}

#[test]
fn render_takes_backgrounds() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "a.png");
    // Nothing is that far away.
    let empty = ["render", "cactus:100", "--size", "8x8", "--near", "1e6", "-o", &out, "--background"];
    ok(&[&empty[..], &["1,0.5,0"]].concat());
    assert!(png(&out).to_rgb8().pixels().all(|p| p.0 == [255, 128, 0]));
    ok(&[&empty[..], &["transparent"]].concat());
    assert!(png(&out).to_rgba8().pixels().all(|p| p.0[3] == 0));
}

#[test]
fn render_writes_the_floats_to_exr_and_npy() {
    let folder = tempfile::tempdir().unwrap();
    let read = |name: &str, background: &str| {
        let out = path(&folder, name);
        ok(&["render", "cactus:3000", "--size", "100x80", "-o", &out, "--background", background]);
        Pixels::read(Path::new(&out)).unwrap()
    };
    for background in ["0,0,0", "transparent"] {
        let [png, exr, npy] = ["a.png", "a.exr", "a.npy"].map(|name| read(name, background));
        assert_eq!(exr, npy);
        assert_ne!(exr, png, "8 bits cannot hold the picture");
        let steps = exr.to_rgba8().iter().zip(png.to_rgba8()).map(|(a, b)| a.abs_diff(b)).max();
        assert!(background == "transparent" || steps == Some(0), "{steps:?}");
        assert_eq!(exr.rgba.iter().any(|p| p[3] < 1.0), background == "transparent");
    }
}

/// A scene of any size is framed, and drawn: the near plane goes with it.
#[test]
fn render_frames_a_small_scene() {
    let folder = tempfile::tempdir().unwrap();
    let mut ply = fs::read("tests/fixtures/plush.ply").unwrap();
    // x y z come first, the scales' logarithms at properties 55 to 57 of 62.
    let data = ply.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let names: Vec<String> = String::from_utf8_lossy(&ply[..data])
        .lines()
        .filter_map(|l| Some(l.strip_prefix("property float ")?.to_owned()))
        .collect();
    for vertex in ply[data..].chunks_exact_mut(4 * names.len()) {
        for (name, bytes) in names.iter().zip(vertex.chunks_exact_mut(4)) {
            let value = f32::from_le_bytes(bytes.try_into().unwrap());
            let smaller = match name.as_str() {
                "x" | "y" | "z" => value / 1000.0,
                name if name.starts_with("scale") => value - 1000f32.ln(),
                _ => value,
            };
            bytes.copy_from_slice(&smaller.to_le_bytes());
        }
    }
    let (scene, out) = (path(&folder, "small.ply"), path(&folder, "a.png"));
    fs::write(&scene, ply).unwrap();
    let common = ["render", &scene, "--size", "64x64", "-o", &out];
    ok(&common);
    let small = png(&out).to_rgb8();
    ok(&["render", "tests/fixtures/plush.ply", "--size", "64x64", "-o", &out]);
    let steps = small.iter().zip(png(&out).to_rgb8().iter()).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
    assert!(steps <= 1 && small.iter().any(|v| *v > 50), "{steps} steps of 255");
    let output = smalto(&[&common[..], &["--near", "0.2"]].concat());
    let note = String::from_utf8_lossy(&output.stderr);
    assert!(note.contains("between the camera and the near plane of 0.2; --near sets it"), "{note}");
}

/// A scene in which every Gaussian is fully transparent is the background, not an error.
#[test]
fn a_transparent_scene_shows_the_background() {
    let folder = tempfile::tempdir().unwrap();
    let mut ply = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n".to_vec();
    let names = "x y z f_dc_0 f_dc_1 f_dc_2 scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 opacity";
    for name in names.split(' ') {
        ply.extend(format!("property float {name}\n").bytes());
    }
    ply.extend(b"end_header\n");
    for value in [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, f32::NEG_INFINITY] {
        ply.extend(value.to_le_bytes());
    }
    let (scene, out) = (path(&folder, "clear.ply"), path(&folder, "a.png"));
    fs::write(&scene, ply).unwrap();
    ok(&["render", &scene, "--size", "20x20", "--background", "0,0,1", "-o", &out]);
    assert!(png(&out).to_rgb8().pixels().all(|p| p.0 == [0, 0, 255]));
    assert!(ok(&["info", &scene]).contains("0 Gaussians"));
}

/// Two cameras, one named.
fn cameras(folder: &tempfile::TempDir, name: &str) -> String {
    let camera = |name: &str, z: f64| {
        format!(
            r#"{{"id": 0, "img_name": "{name}", "width": 64, "height": 48, "position": [0, -1.2, {z}],
            "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "fx": 60, "fy": 60}}"#
        )
    };
    fs::write(folder.path().join(name), format!("[{}, {}]", camera("front", -5.0), camera("near", -2.5))).unwrap();
    path(folder, name)
}

#[test]
fn render_takes_cameras_by_number_name_and_all() {
    let folder = tempfile::tempdir().unwrap();
    let file = cameras(&folder, "cams.json");
    let by = |camera: &str, out: &str| {
        ok(&["render", "cactus:500", "--cameras", &file, "--camera", camera, "-o", &path(&folder, out)]);
        fs::read(path(&folder, out)).ok()
    };
    let first = by("0", "0.png");
    assert_eq!(by("front", "front.png"), first);
    let second = by("near", "near.png");
    assert_ne!(second, first);
    by("all", "all");
    assert_eq!(fs::read(folder.path().join("all/00000.png")).ok(), first);
    assert_eq!(fs::read(folder.path().join("all/00001.png")).ok(), second);
    assert_eq!(png(path(&folder, "0.png")).to_rgb8().dimensions(), (64, 48), "the camera's own size");
    ok(&["render", "cactus:500", "--cameras", &file, "--size", "32x32", "-o", &path(&folder, "small.png")]);
    assert_eq!(png(path(&folder, "small.png")).to_rgb8().dimensions(), (32, 32));
    // Photographs may be named like positions of others.
    let text = fs::read_to_string(&file).unwrap();
    fs::write(path(&folder, "n.json"), text.replace("front", "1").replace("near", "0001")).unwrap();
    let by_number = |camera: &str| {
        let (file, out) = (path(&folder, "n.json"), path(&folder, "n.png"));
        ok(&["render", "cactus:500", "--cameras", &file, "--camera", camera, "-o", &out]);
        fs::read(out).ok()
    };
    assert_eq!([by_number("0"), by_number("1"), by_number("0001")], [first, second.clone(), second]);
    let error = fails(2, &["render", "cactus:500", "--cameras", &file, "--camera", "side"]);
    assert!(error.contains("there is no camera side: they are 0 to 1, from 'front' to 'near'"), "{error}");
}

#[test]
fn render_finds_the_cameras_of_a_model_folder() {
    let folder = tempfile::tempdir().unwrap();
    cameras(&folder, "cameras.json");
    let below = folder.path().join("point_cloud/iteration_7");
    fs::create_dir_all(&below).unwrap();
    let scene = below.join("point_cloud.ply");
    fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/plush.ply"), &scene).unwrap();
    let out = path(&folder, "a.png");
    ok(&["render", scene.to_str().unwrap(), "-o", &out]);
    assert_eq!(png(&out).to_rgb8().dimensions(), (64, 48));
    // A link finds the cameras beside itself.
    #[cfg(unix)]
    {
        let elsewhere = tempfile::tempdir().unwrap();
        cameras(&elsewhere, "cameras.json");
        let link = elsewhere.path().join("scene.ply");
        std::os::unix::fs::symlink(fs::canonicalize("tests/fixtures/plush.ply").unwrap(), &link).unwrap();
        ok(&["render", link.to_str().unwrap(), "-o", &out]);
        assert_eq!(png(&out).to_rgb8().dimensions(), (64, 48));
    }
    // The folder stands for its last iteration.
    fs::create_dir(folder.path().join("point_cloud/iteration_3")).unwrap();
    let by_folder = path(&folder, "b.png");
    ok(&["render", folder.path().to_str().unwrap(), "-o", &by_folder]);
    assert_eq!(fs::read(&by_folder).unwrap(), fs::read(&out).unwrap());
}

#[test]
fn render_prints_stages_and_dumps_buffers() {
    let folder = tempfile::tempdir().unwrap();
    let dump = path(&folder, "dump");
    let out = path(&folder, "a.png");
    let common = ["render", "cactus:500", "--size", "64x64", "-o", &out, "--timings"];
    let text = ok(&common);
    for stage in ["project", "list", "offsets", "sort", "merge", "masks", "blend"] {
        assert!(text.contains(&format!("\n  {stage} ")), "{text}");
    }
    let text = ok(&[&common[..], &["--portable", "--dump", &dump]].concat());
    for stage in ["cull", "project", "sort depths", "scan", "duplicate", "sort tiles", "ranges", "blend"] {
        assert!(text.contains(&format!("\n  {stage} ")), "{text}");
    }
    let files: Vec<PathBuf> = fs::read_dir(&dump).unwrap().map(|e| e.unwrap().path()).collect();
    let splats =
        files.iter().find(|f| f.display().to_string().ends_with("project.splats.npy")).expect("splats are there");
    let array = npyz::NpyFile::new(fs::File::open(splats).unwrap()).unwrap();
    assert_eq!(array.shape(), [500, 9]);
    assert!(array.into_vec::<f32>().unwrap().iter().any(|v| *v != 0.0));
}

#[test]
fn info_describes_a_scene() {
    let text = ok(&["info", "tests/fixtures/plush.ply"]);
    for part in ["61 Gaussians", "SH degree 3", "opacity", "anisotropy", "on the GPU"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let json: serde_json::Value =
        serde_json::from_str(&ok(&["info", "tests/fixtures/plush.ply", "--json", "-"])).unwrap();
    assert_eq!(json["gaussians"], 61);
    // The file's numbers lie on 8-bit grids: 16 bytes of bounds, 8 of shape, 48 of spherical harmonics.
    assert_eq!(json["required"]["gpu_bytes"], 61 * (16 + 8 + 48));
    assert_eq!(json["required"]["f32_bytes"], 61 * 15 * 16);
    assert_eq!(json["required"]["sh_degree_kept"], 3);
    assert_eq!(json["required"]["colour_error"], 0.0);
    assert_eq!(json["tally"]["read"], 61);
    assert!(json["opacity"]["p50"].as_f64().unwrap() > 0.0);
    let fast = ["info", "cactus:1000", "--preset", "fast", "--json", "-"];
    let json: serde_json::Value = serde_json::from_str(&ok(&fast)).unwrap();
    assert!(json["required"]["colour_error"].as_f64().unwrap() > 0.0, "16-bit floats lose something");
    assert_eq!(json["required"]["depth_bits_kept"], 24);
}

#[test]
fn doctor_lists_devices_and_tests_one() {
    let text = ok(&["doctor"]);
    assert!(text.starts_with("0  ") && text.contains("usable         yes") && text.contains("passed"), "{text}");
    let folder = tempfile::tempdir().unwrap();
    let file = path(&folder, "doctor.json");
    assert!(ok(&["doctor", "--json", &file]).contains("passed"));
    for text in [fs::read_to_string(file).unwrap(), ok(&["doctor", "--json", "-"])] {
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        let schema = serde_json::from_str(include_str!("../../docs/schemas/doctor.schema.json")).unwrap();
        assert!(jsonschema::is_valid(&schema, &json), "{json:#}");
        assert!(json["devices"][0]["limits"]["storage_range"].as_u64().unwrap() > 0);
        assert_eq!(json["self_test"]["passed"], true);
        assert!(json["self_test"]["paths"][1]["psnr_db"].as_f64().unwrap() >= 80.0);
    }
}

#[test]
fn doctor_reports_the_devices_even_if_none_can_be_opened() {
    let output = smalto(&["doctor", "--device", "99", "--json", "-"]);
    assert_eq!(output.status.code(), Some(3));
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(json["devices"][0]["name"].is_string() && json["self_test"].is_null());
}

#[test]
fn doctor_lists_registers_where_the_driver_knows_them() {
    let output = smalto(&["doctor", "--pipelines", "--json", "-"]);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{error}");
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let is_tested = |device: &&serde_json::Value| device["name"] == json["self_test"]["device"];
    let device = json["devices"].as_array().unwrap().iter().find(is_tested).unwrap();
    if device["optional"].to_string().contains("[\"pipeline statistics\",true]") {
        assert!(json["pipelines"].to_string().contains("bin_blend"), "{json:#}");
    } else {
        assert!(error.contains("has no statistics of pipelines"), "{error}");
        assert!(ok(&["doctor", "--pipelines"]).contains("passed"), "the device can be used all the same");
    }
}

#[test]
fn every_command_has_help() {
    for arguments in [
        &["--help"][..],
        &["render", "--help"],
        &["info", "--help"],
        &["compare", "--help"],
        &["trade", "--help"],
        &["doctor", "--help"],
        &["--version"],
    ] {
        assert!(!ok(arguments).is_empty());
    }
    assert!(ok(&["--help"]).contains("Exit codes: 0 success"));
}

#[test]
fn wrong_usage_is_exit_code_2() {
    for arguments in [
        &["paint"][..],
        &["render", "--size", "0x10"],
        &["render", "--size", "wide"],
        &["render", "--background", "1,2,3"],
        &["render", "--background", "red"],
        &["render", "--near=-1"],
        &["render", "--near", "nan"],
        &["render", "cactus:0"],
        &["render", "cactus:many"],
        &["render", "cactus:100", "--camera", "3"],
        &["render", "--reference", "--portable"],
        &["render", "cactus:100", "--reference", "--size", "20000x20"],
        &["render", "cactus:100", "--size", "8x8", "-o", "picture.jpg"],
    ] {
        let error = fails(2, arguments);
        assert!(!error.is_empty());
    }
}

#[test]
fn a_missing_device_or_driver_is_exit_code_3() {
    assert!(fails(3, &["render", "--device", "no such device"]).contains("there are: 0 "));
    assert!(fails(3, &["doctor", "--device", "99"]).contains("there are: 0 "));
    let output = run(&["render"], |c| {
        c.env("VK_DRIVER_FILES", "/nowhere").env("VK_ICD_FILENAMES", "/nowhere").env("SMALTO_VALIDATION", "0");
    });
    assert_eq!(output.status.code(), Some(3));
    assert!(String::from_utf8_lossy(&output.stderr).contains("install"));
}

#[test]
fn an_unreadable_scene_or_camera_file_is_exit_code_4() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("bad.ply"), "ply\nformat binary_little_endian 1.0\n").unwrap();
    fs::write(folder.path().join("bad.json"), "{}").unwrap();
    let out = path(&folder, "a.png");
    fs::write(&out, "kept").unwrap();
    let bad = path(&folder, "bad.ply");
    assert!(
        fails(4, &["render", &bad, "-o", &out]).contains("bad.ply: the file ends at byte 36, inside the PLY header")
    );
    assert!(fails(4, &["info", "no/such.ply"]).contains("no/such.ply: cannot be opened: there is no such file"));
    let cameras = path(&folder, "bad.json");
    assert!(
        fails(4, &["render", "cactus:10", "--cameras", &cameras, "-o", &out])
            .contains("bad.json: is neither a cameras.json nor a transforms.json")
    );
    assert!(fails(4, &["render", "cactus:10", "--cameras", "none.json"]).contains("none.json: "));
    assert_eq!(fs::read(&out).unwrap(), b"kept", "a failure leaves the old picture");
}

#[test]
fn too_little_memory_is_exit_code_5() {
    let error = fails(5, &["render", "cactus:100", "--size", "4000x4000", "--memory", "40MB"]);
    assert!(error.contains("bytes of"), "{error}");
    // Host memory: 236 bytes a Gaussian of SH degree 3.
    // 4 GB of address space.
    fails_within("-v 4000000", 5, &["info", "cactus:200000000"]);
}

#[test]
fn a_closed_pipe_is_no_failure() {
    let script = |text: &str| Command::new("sh").args(["-c", text, env!("CARGO_BIN_EXE_smalto")]).output().unwrap();
    let early = script("exec 3>&1; { \"$0\" info tests/fixtures/plush.ply; echo $? >&3; } | true");
    assert_eq!((early.stdout, early.stderr), (b"0\n".to_vec(), Vec::new()));
    let full = script("\"$0\" info tests/fixtures/plush.ply > /dev/full");
    assert_eq!(full.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&full.stderr).contains("cannot write to standard output"));
}

#[test]
fn a_picture_beyond_the_limits_of_the_device_is_wrong_usage() {
    let error = fails(2, &["render", "cactus:100", "--size", "60000x60000"]);
    assert!(error.contains(" draws pictures of at most ") && error.contains("not 60000x60000"), "{error}");
}

#[test]
fn an_unwritable_output_is_exit_code_1() {
    let error = fails(1, &["render", "cactus:100", "--size", "8x8", "-o", "/proc/a.png"]);
    assert!(error.contains("cannot write /proc/a.png"), "{error}");
}
