//! The conventions of all commands: refused arguments, options between files, reports on standard output.

use std::fs;
use std::path::Path;

use serde_json::Value;
use smalto::measure::metrics::max_error;
use smalto::pixels::Pixels;

use crate::common::program::{fails, ok, path, run};

#[test]
fn wrong_arguments_are_one_sentence() {
    for (line, sentence) in [
        ("paint", "there is no command paint"),
        ("render --siz 8x8", "there is no option --siz: did you mean --size?"),
        ("render cactus:10 more", "more is one argument too many"),
        ("render --size 8x8 --size 9x9", "--size is given twice"),
        ("render --size", "--size <WxH>: a value is expected"),
        ("render --size 100000x100000", "like 1280x720, each from 1 to 65536"),
        ("render --size -1x5", "--size -1x5: expected WIDTHxHEIGHT"),
        ("render --memory -5MB", "--memory -5MB: expected"),
        ("render --near -1", "--near -1: expected a number above 0"),
        ("render --stop -0.5", "--stop -0.5: expected a number from 0 to 1"),
        ("render --background -1,0,0", "--background -1,0,0: expected R,G,B from 0 to 1"),
        ("render --background #12345g", "expected R,G,B from 0 to 1, like 1,1,1, or #rrggbb"),
        ("render --video --fps 1/0", "expected frames per second, above 0 and at most 1000"),
        ("render --video --fps -5", "--fps -5: expected frames per second"),
        ("render --fps 24", "--fps needs --video or --path"),
        ("render --preset wrong", "--preset wrong: expected balanced, exact, fast"),
        ("render --reference --stop 0.1", "cannot be combined with"),
        ("render --reference --preset balanced", "--reference cannot be combined with --preset balanced"),
        ("render --reference --preset portable", "--reference cannot be combined with --preset portable"),
        ("render --json - -o -", "--output and --json would both be written to standard output"),
        ("convert a.ply", "expected the files to read, then the file to write"),
        ("convert cactus:10 --spz-version 3 b.glb", "--spz-version needs an .spz file to write"),
        ("compare a.png", "missing: <B>"),
        ("info tests/fixtures/plush.ply --json ./tests/fixtures/plush.ply", "--json would replace ./tests/fixtures"),
        ("trade --held-out 3", "--held-out needs --max-error or --min-psnr"),
        ("view --compare-by flicker", "--compare-by needs --compare"),
        ("bench --threshold -1 --baseline a", "--threshold -1: expected a number from 0 to 1000000"),
        ("bench --json a --csv ./a", "--json and --csv would both be written to a"),
        ("bench --json - --csv -", "--json and --csv would both be written to standard output"),
        ("doctor --device=", "--device <DEVICE>: a value is expected"),
    ] {
        let error = fails(2, &line.split(' ').collect::<Vec<_>>());
        assert!(error.starts_with("smalto: ") && error.contains(sentence), "{line}: {error}");
        assert_eq!(error.lines().count(), 1, "{line}: {error}");
    }
}

#[test]
fn environment_variables_without_meaning_are_refused() {
    for (name, value) in [("SMALTO_VALIDATION", "yes"), ("SMALTO_FAULT", "nonsense")] {
        let output = run(&["info", "cactus:10"], |command| {
            command.env(name, value);
        });
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{error}");
        assert!(error.starts_with(&format!("smalto: {name}={value}: expected ")), "{error}");
    }
}

#[test]
fn options_may_stand_between_files() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, a, b) = (path(&folder, "a.ply"), path(&folder, "a.png"), path(&folder, "b.png"));
    ok(&["convert", "cactus:50", "--sh-degree", "0", &scene]);
    assert!(ok(&["info", &scene]).contains("SH degree 0"));
    ok(&["convert", "cactus:50", "--flip", "y", &scene, "--json", "-", &path(&folder, "joined.ply")]);
    for file in [&a, &b] {
        ok(&["render", "--size", "16x16", &scene, "-o", file]);
    }
    ok(&["compare", &a, "--max-error", "0", &b]);
    let quick = ["--size", "16x16", "--warmup", "0", "--frames", "1"];
    let text = ok(&[&["bench", "cactus:20"], &quick[..], &["few-large:20"]].concat());
    assert!(text.contains("cactus:20 16x16") && text.contains("few-large:20 16x16"), "{text}");
}

#[test]
fn every_report_can_be_printed_instead_of_the_text() {
    let folder = tempfile::tempdir().unwrap();
    let picture = path(&folder, "a.png");
    let (scene, quick) = (path(&folder, "a.ply"), ["--size", "16x16", "--warmup", "0", "--frames", "1"]);
    for arguments in [
        &["render", "cactus:20", "--size", "16x16", "--timings", "-o", &picture][..],
        &["info", "cactus:20"],
        &["convert", "cactus:20", &scene],
        &["compare", &picture, &picture],
        &[&["bench", "cactus:20"], &quick[..]].concat(),
        &[&["trade", "cactus:20", "--parts", "certificate", "--views", "1"], &quick[..]].concat(),
        &["doctor"],
    ] {
        let file = path(&folder, "report.json");
        let output = run(&[arguments, &["--json", "-"]].concat(), |command| {
            command.current_dir(folder.path());
        });
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        let printed: Value = serde_json::from_slice(&output.stdout).expect("nothing else is printed");
        assert!(!ok(&[arguments, &["--json", &file]].concat()).is_empty(), "{arguments:?}: the text is still printed");
        let written: Value = serde_json::from_str(&fs::read_to_string(&file).unwrap()).unwrap();
        let members = |report: &Value| report.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
        assert_eq!(members(&printed), members(&written), "{arguments:?}");
    }
    let text = ok(&[&["bench", "cactus:20"], &quick[..], &["--csv", "-"]].concat());
    assert!(text.starts_with("scene,gaussians,"), "{text}");
    assert!(!folder.path().join("-").exists(), "- is not a file");
}

#[test]
fn render_reports_every_frame() {
    let folder = tempfile::tempdir().unwrap();
    let schema = serde_json::from_str(include_str!("../../docs/schemas/render.schema.json")).unwrap();
    let report = |more: &[&str]| {
        let common = ["render", "cactus:50", "--size", "16x12", "--json", "-", "-o"];
        let report: Value = serde_json::from_str(&ok(&[&common[..], more].concat())).unwrap();
        assert!(jsonschema::is_valid(&schema, &report), "{:?}", jsonschema::validate(&schema, &report));
        report
    };
    let out = path(&folder, "a.png");
    let gpu = report(&[&out, "--layers", "colour,depth", "--preset", "exact"]);
    assert_eq!((&gpu["preset"], gpu["frames"].as_array().unwrap().len()), (&"exact".into(), 2));
    let frame = &gpu["frames"][0];
    assert_eq!(frame["files"][0]["path"], out.as_str());
    assert_eq!(gpu["frames"][1]["files"][0]["layer"], "depth");
    assert_eq!(frame["size"], serde_json::json!([16, 12]));
    let stages = frame["gpu"]["stages"].as_array().unwrap();
    let whole = frame["gpu"]["ms"].as_f64().unwrap();
    let inside: f64 = stages.iter().map(|stage| stage["ms"].as_f64().unwrap()).sum();
    assert!(inside > 0.0 && inside <= whole * 1.001, "{inside} of {whole} ms");
    let bound = path(&folder, "bound.exr");
    let certified = &report(&[&out, "--certificate", &bound])["frames"][0];
    assert_eq!(certified["files"][1]["path"], bound.as_str());
    assert!(certified["certified_error"].as_f64().unwrap() > 0.0);
    let reference = report(&[&out, "--reference"]);
    assert!(reference["device"].is_null() && reference["preset"].is_null());
    assert!(reference["frames"][0]["reference_seconds"].as_f64().unwrap() >= 0.0);
}

#[test]
fn the_reference_obeys_the_degree_and_rules() {
    let folder = tempfile::tempdir().unwrap();
    let draw = |scene: &str, more: &[&str]| {
        let out = path(&folder, "a.npy");
        ok(&[&["render", scene, "--size", "24x24", "--reference", "-o", &out], more].concat());
        Pixels::read(Path::new(&out)).unwrap()
    };
    let scene = "tests/fixtures/plush.ply";
    let flat = path(&folder, "flat.ply");
    ok(&["convert", scene, "--sh-degree", "0", &flat]);
    let (full, of_degree_0) = (draw(scene, &[]), draw(scene, &["--sh-degree", "0"]));
    assert!(max_error(&full, &of_degree_0) > 0.01);
    assert!(max_error(&draw(&flat, &[]), &of_degree_0) < 1e-5);
    assert_eq!(draw(scene, &["--preset", "exact"]), full);
    assert_ne!(draw(scene, &["--preset", "inria"]), full);
}

#[test]
fn backgrounds_have_names_and_hexadecimal_digits() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "a.png");
    for (background, bytes) in [
        ("#102030", [16, 32, 48]),
        ("white", [255; 3]),
        ("black", [0; 3]),
        ("grey", [128; 3]),
        ("1,0.5,0", [255, 128, 0]),
    ] {
        // Nothing is that far away.
        let empty = ["render", "cactus:20", "--size", "4x4", "--near", "1e6", "-o", &out, "--background", background];
        ok(&empty);
        assert!(image::open(&out).unwrap().to_rgb8().pixels().all(|pixel| pixel.0 == bytes), "{background}");
    }
}
