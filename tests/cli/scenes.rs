//! The scene argument: pipes, folders, levels of detail, scenes that are too large, and what `info` says of them.

use std::fs::{self, File};
use std::io::Write;
use std::process::{Command, Output, Stdio};

use flate2::{Compression, write::GzEncoder};
use serde_json::{Value, json};

use crate::common::Random;
use crate::common::program::{fails, fails_within, ok, path, run, smalto};
use crate::common::table::fixture;

fn fixture_text(name: &str) -> String {
    fixture(name).display().to_string()
}

/// Runs the program with this file behind a pipe on its standard input.
fn piped(arguments: &[&str], name: &str) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_smalto"))
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    // The program may end before it has read everything.
    _ = stdin.write_all(&fs::read(fixture(name)).unwrap());
    drop(stdin);
    child.wait_with_output().unwrap()
}

#[test]
fn scenes_come_from_standard_input_by_their_content() {
    let shown = |output: Output| {
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8(output.stdout).unwrap();
        text.split_once(": ").unwrap().1.to_owned()
    };
    for name in ["plush.ply", "plush.compressed.ply", "plush.v3.spz", "plush.v4.spz", "plush.sog", "plush.glb"] {
        let expected = shown(smalto(&["info", &fixture_text(name)]));
        assert_eq!(shown(piped(&["info", "-"], name)), expected, "{name} on standard input");
        let script = format!("\"$0\" info <(cat '{}')", fixture_text(name));
        let substituted = Command::new("bash").args(["-c", &script, env!("CARGO_BIN_EXE_smalto")]).output().unwrap();
        assert_eq!(shown(substituted), expected, "{name} in a process substitution");
    }
    for (name, expected) in [
        ("plush.splat", "or a file named .splat, .ksplat or .gltf"),
        ("plush.v1/meta.json", "JSON names other files of the scene"),
    ] {
        let output = piped(&["info", "-"], name);
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(4), "{error}");
        assert!(error.starts_with("smalto: standard input: ") && error.contains(expected), "{error}");
    }
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "a.glb");
    assert!(piped(&["convert", "-", &out], "plush.ply").status.success());
    assert!(ok(&["info", &out]).contains("61 Gaussians"));
}

#[test]
fn pictures_are_named_after_the_folder_of_a_model_or_a_sog() {
    let folder = tempfile::tempdir().unwrap();
    let iteration = folder.path().join("garden.v2/point_cloud/iteration_7");
    fs::create_dir_all(&iteration).unwrap();
    fs::copy(fixture("plush.ply"), iteration.join("point_cloud.ply")).unwrap();
    let sog = folder.path().join("bunny");
    fs::create_dir(&sog).unwrap();
    for entry in fs::read_dir(fixture("plush.v1")).unwrap() {
        let entry = entry.unwrap();
        fs::copy(entry.path(), sog.join(entry.file_name())).unwrap();
    }
    for (scene, picture) in [
        ("garden.v2", "garden.v2.png"),
        ("garden.v2/point_cloud", "garden.v2.png"),
        ("garden.v2/point_cloud/iteration_7", "garden.v2.png"),
        ("garden.v2/point_cloud/iteration_7/point_cloud.ply", "point_cloud.png"),
        ("bunny", "bunny.png"),
        ("bunny/meta.json", "bunny.png"),
    ] {
        let out = run(&["render", scene, "--size", "16x16", "--reference"], |command| {
            command.current_dir(folder.path());
        });
        assert!(out.status.success(), "{scene}: {}", String::from_utf8_lossy(&out.stderr));
        let picture = folder.path().join(picture);
        fs::remove_file(&picture).unwrap_or_else(|error| panic!("{scene}: {}: {error}", picture.display()));
    }
}

#[test]
fn a_level_that_a_scene_lacks_is_wrong_usage() {
    let (ply, lod) = (fixture_text("plush.ply"), fixture_text("lod"));
    for (scene, level, expected) in [
        (ply.as_str(), "0", "no numbered levels of detail"),
        ("cactus:10", "0", "no numbered levels"),
        (&lod, "7", "only 0, 1"),
    ] {
        let error = fails(2, &["info", scene, "--sog-level", level]);
        assert!(
            error.starts_with(&format!("smalto: --sog-level: {}", scene.trim_end_matches(":10")))
                && error.contains(expected),
            "{error}"
        );
    }
}

#[test]
fn info_tells_levels_antialiasing_and_labelled_percentiles() {
    let schema: Value = serde_json::from_str(include_str!("../../docs/schemas/info.schema.json")).unwrap();
    let validator = jsonschema::validator_for(&schema).unwrap();
    let report = |scene: &str| -> Value {
        let report = serde_json::from_str(&ok(&["info", scene, "--json", "-"])).unwrap();
        assert!(validator.is_valid(&report), "{scene}: {:?}", validator.validate(&report).err());
        report
    };
    let lod = report(&fixture_text("lod"));
    assert_eq!(lod["levels"], json!([{"level": 0, "gaussians": 366}, {"level": 1, "gaussians": 183}]));
    assert!(ok(&["info", &fixture_text("lod")]).contains("level 1     183 Gaussians"));
    let plain = report(&fixture_text("plush.ply"));
    assert_eq!((&plain["levels"], &plain["is_antialiased"]), (&json!([]), &json!(false)));
    let opacity = plain["opacity"].as_object().unwrap();
    assert!(opacity["p1"].as_f64() < opacity["p50"].as_f64() && opacity["p50"].as_f64() < opacity["p99"].as_f64());

    let folder = tempfile::tempdir().unwrap();
    let mut spz = fs::read(fixture("plush.v4.spz")).unwrap();
    spz[14] |= 1;
    let mip = path(&folder, "mip.spz");
    fs::write(&mip, spz).unwrap();
    assert_eq!(report(&mip)["is_antialiased"], true);
    assert!(ok(&["info", &mip]).contains("antialiasing of Mip-Splatting"));
    assert!(!ok(&["info", &fixture_text("plush.ply")]).contains("antialiasing of"));
}

#[test]
fn the_report_of_convert_is_that_of_its_schema() {
    let schema: Value = serde_json::from_str(include_str!("../../docs/schemas/convert.schema.json")).unwrap();
    let validator = jsonschema::validator_for(&schema).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let text = ok(&["convert", &fixture_text("plush.ply"), &path(&folder, "a.spz"), "--json", "-"]);
    let mut report = serde_json::from_str(&text).unwrap();
    assert!(validator.is_valid(&report), "{:?}", validator.validate(&report).err());
    report["loss"][0]["largest"] = "much".into();
    assert!(!validator.is_valid(&report), "the schema notices what is wrong");
}

#[test]
fn files_of_too_many_gaussians_are_exit_code_5_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let count = 80_000_000_u32;
    let header = |version: u32| -> Vec<u8> {
        let words = [0x5053_474e, version, count];
        words.into_iter().flat_map(u32::to_le_bytes).chain([0, 12, 0, 5]).collect()
    };
    // Content that cannot be compressed: as large as the file must be to be believed.
    let mut random = Random(3);
    let noise: Vec<u8> = (0..200_000).flat_map(|_| random.bits().to_le_bytes()).collect();
    let gzip = path(&folder, "a.spz");
    let mut file = GzEncoder::new(File::create(&gzip).unwrap(), Compression::fast());
    file.write_all(&header(3)).and_then(|()| file.write_all(&noise)).unwrap();
    file.finish().unwrap();
    let zstd = path(&folder, "b.spz");
    let mut bytes = header(4);
    bytes.extend(32_u32.to_le_bytes());
    bytes.resize(32, 0);
    for each in [9_u64, 1, 3, 3, 4] {
        bytes.extend([1000, each * u64::from(count)].into_iter().flat_map(u64::to_le_bytes));
    }
    bytes.extend(noise);
    fs::write(&zstd, bytes).unwrap();
    for file in [&gzip, &zstd] {
        // 4 GB of address space.
        let error = fails_within("-v 4000000 -t 5", 5, &["info", file]);
        assert_eq!(error.lines().count(), 1, "{error}");
    }
}

/// A stream of gigabytes for one Gaussian is not read.
#[test]
fn streams_beyond_their_content_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = fs::read(fixture("plush.v4.spz")).unwrap();
    bytes[32..40].copy_from_slice(&4_500_000_000_u64.to_le_bytes());
    let file = path(&folder, "a.spz");
    fs::write(&file, bytes).unwrap();
    File::options().write(true).open(&file).unwrap().set_len(5_000_000_000).unwrap();
    let error = fails_within("-v 4000000 -t 2", 4, &["info", &file]);
    assert!(error.contains("the stream of the positions takes 4500000000 bytes"), "{error}");
}

#[test]
fn a_procedural_scene_that_the_device_cannot_hold_is_refused_before_it_is_made() {
    let limit = 1 << 27; // bytes of a buffer on llvmpipe
    let is_small = std::env::var("SMALTO_DEVICE").is_ok_and(|name| name == "llvmpipe");
    // Without room on the host either: who holds the scene on the device fails to make it.
    let render = ["render", "many-small:200000000", "--size", "16x16", "-o", "none.png"];
    let error = fails_within("-v 4000000", 5, &render);
    assert!(!is_small || error.contains(&format!("reaches at most {limit} bytes of a buffer")), "{error}");
}
