//! `smalto bench` as its users meet it: reports, baselines.

use std::fs;

use crate::common::program::{fails, ok, path, smalto};
use serde_json::Value;

/// Little work, the same on every device.
const QUICK: [&str; 6] = ["--size", "48x40", "--warmup", "0", "--frames", "3"];

fn quick<'a>(scene: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["bench", scene], &QUICK[..], more].concat()
}

fn json(file: &str) -> Value {
    serde_json::from_str(&fs::read_to_string(file).unwrap()).unwrap()
}

fn schema(name: &str) -> Value {
    json(&format!("{}/docs/schemas/{name}.schema.json", env!("CARGO_MANIFEST_DIR")))
}

fn median(value: &Value) -> f64 {
    value["median"].as_f64().unwrap()
}

#[test]
fn bench_reports_frames_stages_counts_and_memory() {
    let folder = tempfile::tempdir().unwrap();
    let (out, table, plot) = (path(&folder, "a.json"), path(&folder, "a.csv"), path(&folder, "a.svg"));
    let presets = ["--preset", "balanced,portable", "--json", &out, "--csv", &table, "--plot", &plot, "--check"];
    let text = ok(&quick("cactus:2000", &presets));
    let report = json(&out);
    let validator = jsonschema::validator_for(&schema("bench")).unwrap();
    assert!(validator.is_valid(&report), "{:?}", validator.validate(&report).err());
    let mut broken = report.clone();
    broken["runs"][0]["frame"].as_object_mut().unwrap().remove("gpu_ms");
    assert!(!validator.is_valid(&broken), "the schema notices what is missing");

    let run = &report["runs"][0];
    let stages = |run: &Value| -> Vec<String> {
        run["stages"].as_array().unwrap().iter().map(|s| s["name"].as_str().unwrap().to_owned()).collect()
    };
    let fast = ["project", "list", "offsets", "sort", "merge", "masks", "blend", "gaps"];
    let portable =
        ["clear", "cull", "project", "sort depths", "scan", "duplicate", "sort tiles", "ranges", "blend", "gaps"];
    assert_eq!(stages(run), fast);
    assert_eq!(stages(&report["runs"][1]), portable);
    assert_eq!([&run["drawn_by"], &report["runs"][1]["drawn_by"]], ["fast", "portable"]);
    assert!(run["notice"].is_null() && run["warm_up"].is_null(), "{run}");
    for stage in report["runs"].as_array().unwrap().iter().flat_map(|run| run["stages"].as_array().unwrap()) {
        let has_bytes = stage["least_bytes"].as_u64().unwrap() > 0;
        // No list of this scene is long enough to be merged.
        assert!(has_bytes != ["gaps", "merge"].contains(&stage["name"].as_str().unwrap()), "{stage}");
    }
    let mean = |value: &Value| value["mean"].as_f64().unwrap();
    let inside: f64 = run["stages"].as_array().unwrap().iter().map(|s| mean(&s["ms"])).sum();
    let frame = mean(&run["frame"]["staged_gpu_ms"]);
    assert!((inside / frame - 1.0).abs() < 1e-6, "stages and gaps make the frame: {inside} of {frame} ms");
    assert!(median(&run["frame"]["wall_ms"]) >= median(&run["frame"]["gpu_ms"]));
    assert!(run["frame"]["pipelined_ms"].as_f64().unwrap() > 0.0);
    let counts = &run["counts"];
    assert!(median(&counts["visible"]) <= 2000.0 && median(&counts["visible"]) > 500.0);
    assert_eq!(counts["tiles"], 9);
    assert!(median(&counts["entries"]) > 0.0 && median(&counts["entries"]) < median(&counts["instances"]));
    assert!(report["runs"][1]["counts"]["entries"].is_null(), "the portable path has no entries");
    assert_eq!(median(&report["runs"][1]["counts"]["instances"]), median(&counts["instances"]));
    assert!(median(&counts["evaluations_per_pixel"]) <= median(&counts["lanes_per_pixel"]));
    assert!(median(&counts["evaluations_per_pixel"]) > 1.0);
    assert!((0.0..=1.0).contains(&median(&counts["early_exit_rate"])));
    assert!(run["memory"].as_array().unwrap().iter().any(|m| m["buffer"] == "splats" && m["bytes"].as_u64() > Some(0)));
    assert!(run["psnr_db"].as_f64().unwrap() > 60.0);
    assert_eq!(report["runs"][1]["subject"]["preset"], "portable");
    assert!(report["runs"][1]["psnr_db"].as_f64().unwrap() > 60.0);
    assert_eq!(report["runs"][1]["subject"]["scene"], run["subject"]["scene"]);

    let mut rows = csv::Reader::from_path(&table).unwrap();
    let rows: Vec<Vec<String>> = rows.records().map(|r| r.unwrap().iter().map(str::to_owned).collect()).collect();
    let blend = rows.iter().find(|row| row[6] == "blend ms").unwrap();
    let place = fast.iter().position(|stage| *stage == "blend").unwrap();
    assert_eq!(blend[8].parse::<f64>().unwrap(), median(&run["stages"][place]["ms"]), "CSV is a view of the JSON");
    assert!(fs::read_to_string(&plot).unwrap().contains("sort depths"));
    assert!(text.contains("frame, GPU") && text.contains("to the float64 reference"), "{text}");
    assert!(text.contains("SH degree 3, fast path") && text.contains("SH degree 3, portable path"), "{text}");
}

#[test]
fn several_devices_are_measured_together() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "a.json");
    let device = std::env::var("SMALTO_DEVICE").unwrap_or_else(|_| "0".to_owned());
    let devices = format!("{device},{device}");
    let text = ok(&quick("cactus:2000", &["--device", &devices, "--json", &out]));
    assert!(text.contains(" frames per second on 2 devices: "), "{text}");
    let report = json(&out);
    assert!(jsonschema::validator_for(&schema("bench")).unwrap().is_valid(&report));
    let together = report["runs"][0]["together"].as_array().unwrap();
    assert_eq!(together.len(), 2);
    assert!(together.iter().all(|device| device["frames_per_second"].as_f64().unwrap() > 0.0));
}

#[test]
fn frames_in_bands_are_measured_on_two_instances_of_a_device() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "a.json");
    let device = std::env::var("SMALTO_DEVICE").unwrap_or_else(|_| "0".to_owned());
    let devices = format!("{device},{device}");
    let shared = ["bench", "cactus:2000", "--warmup", "0", "--frames", "3", "--size", "64x128", "--json", &out];
    let text = ok(&[&shared[..], &["--device", &devices, "--share", "frame"]].concat());
    assert!(text.contains("in bands on 2 devices"), "{text}");
    let report = json(&out);
    assert!(jsonschema::validator_for(&schema("bench")).unwrap().is_valid(&report));
    let split = &report["runs"][0]["split"];
    let devices = split["devices"].as_array().unwrap();
    let rows: f64 = devices.iter().map(|device| device["rows"]["mean"].as_f64().unwrap()).sum();
    assert_eq!((devices.len(), rows), (2, 128.0));
    assert!(split["slowest_over_mean"]["min"].as_f64().unwrap() >= 1.0);
    assert!(devices.iter().all(|device| device["stages"].as_array().unwrap().len() > 5));

    let devices = format!("{device},{device}");
    for (option, expected) in
        [(["--response", "ray"], "in bands on 2 devices"), (["--scale", "0.5"], " frames per second on 2 devices: ")]
    {
        let text = ok(&quick("cactus:2000", &[&["--device", &devices, "--share", "frame"], &option[..]].concat()));
        assert!(text.contains(expected), "{text}");
    }
}

/// A device whose loops end after some rounds draws such views on the portable path, after an attempt on the fast one.
#[test]
fn views_that_always_need_a_second_attempt_are_measured() {
    let args = ["bench", "many-small:100000", "--path", "orbit", "--size", "16x16", "--warmup", "0", "--frames", "2"];
    let text = ok(&args);
    assert!(text.contains("longest list 100000"), "{text}");
}

#[test]
fn bench_reports_how_it_warmed_up() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "a.json");
    let text = ok(&["bench", "cactus:50", "--size", "16x16", "--warmup", "3", "--frames", "1", "--json", &out]);
    let warm_up = &json(&out)["runs"][0]["warm_up"];
    // Three kinds of frames with two windows each: of one second for the first, of a quarter after a steady one.
    assert!(warm_up["frames"].as_u64() > Some(9) && warm_up["seconds"].as_f64() > Some(2.9), "{warm_up}");
    let line = if warm_up["is_steady"] == true { "  steady after " } else { "  warning: the frame time is not steady" };
    assert!(text.contains(line), "{text}");
}

#[test]
fn a_frame_slower_than_the_baseline_is_exit_code_6() {
    let folder = tempfile::tempdir().unwrap();
    let (out, changed) = (path(&folder, "a.json"), path(&folder, "b.json"));
    ok(&quick("cactus:500", &["--json", &out]));
    let pretend = |factor: f64| {
        let mut report = json(&out);
        let frame = &mut report["runs"][0]["frame"]["gpu_ms"]["median"];
        *frame = (frame.as_f64().unwrap() * factor).into();
        report["runs"][0]["image_hash"] = "another".into();
        fs::write(&changed, report.to_string()).unwrap();
    };
    pretend(1e-3);
    let error = fails(6, &quick("cactus:500", &["--baseline", &changed, "--threshold", "50"]));
    assert!(error.contains("slower than the baseline by more than 50 %: cactus:500 48x40 balanced"), "{error}");
    assert!(error.contains("the picture differs from the baseline's"), "{error}");
    pretend(1e3);
    let text = ok(&quick("cactus:500", &["--baseline", &changed]));
    assert!(text.contains("compared with the baseline"), "{text}");
    // The same scene twice is two runs; the baseline has one for both.
    let text = ok(&quick("cactus:500", &["cactus:500", "--baseline", &changed]));
    assert_eq!(text.matches("compared with the baseline").count(), 2, "{text}");
}

#[test]
fn a_damaged_or_foreign_baseline_is_refused_before_anything_is_measured() {
    let folder = tempfile::tempdir().unwrap();
    let (out, other) = (path(&folder, "a.json"), path(&folder, "b.json"));
    ok(&quick("cactus:500", &["--json", &out]));
    let refused = |content: &str, sentence: &str| {
        fs::write(&other, content).unwrap();
        let error = fails(4, &quick("cactus:500", &["--baseline", &other]));
        assert!(error.contains("b.json: ") && error.contains(sentence), "{error}");
    };
    let good = fs::read_to_string(&out).unwrap();
    refused("", "is not JSON");
    refused(&good[..good.len() / 2], "is not JSON");
    refused("[1, 2]", "is not a report of this version: its format is unknown, not smalto bench 3");
    refused(r#"{"format": "smalto ladder 1"}"#, "its format is smalto ladder 1");
    refused(&good.replace("smalto bench 3", "smalto bench 2"), "its format is smalto bench 2, not smalto bench 3");
    refused(&good.replace("\"frames\"", "\"framed\""), "is a damaged report");
    assert!(fails(4, &quick("cactus:500", &["--baseline", "none.json"])).contains("none.json: cannot be opened"));
    let foreign = |arguments: &[&str], sentence: &str| {
        let output = smalto(arguments);
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && error.contains(sentence), "{error}");
        assert!(output.stdout.is_empty(), "nothing was measured");
    };
    let against = ["--baseline", &out];
    foreign(&quick("cactus:501", &against), "it has no run of cactus:501 48x40 balanced from the same cameras");
    foreign(&quick("cactus:500", &["--near", "0.1", "--baseline", &out]), "it has no run of");
    foreign(
        &quick("cactus:500", &["--path", "orbit", "--baseline", &out]),
        "its camera path is orbit-zoom, this run's is orbit",
    );
    let warm = ["bench", "cactus:500", "--size", "48x40", "--warmup", "1", "--frames", "3", "--baseline", &out];
    foreign(&warm, "its number of warm-up frames is 0, this run's is 1");
    let device = good.replace(json(&out)["device"]["name"].as_str().unwrap(), "abacus");
    fs::write(&other, device).unwrap();
    foreign(&quick("cactus:500", &["--baseline", &other]), "its device is abacus, this run's is ");
}

#[test]
fn bench_refuses_wrong_arguments() {
    for arguments in [
        &["bench", "--path", "circle"][..],
        &["bench", "--path", "keyframes:"],
        &["bench", "--frames", "0"],
        &["bench", "--frames", "18446744073709551615"],
        &["bench", "--warmup", "1000001"],
        &["bench", "--preset", "wrong"],
        &["bench", "--size", "720"],
        &["bench", "--threshold", "3"],
        &["bench", "--baseline", "a.json", "--threshold=-1"],
        &["bench", "--near", "0"],
        &["bench", "--cameras", "a.json", "--path", "orbit"],
        &["bench", "cactus:0", "--frames", "1", "--warmup", "0"],
    ] {
        assert!(!fails(2, arguments).is_empty());
    }
    assert!(fails(4, &["bench", "no/such.ply"]).contains("no/such.ply"));
    assert!(fails(4, &["bench", "cactus:10", "--path", "none.json"]).contains("none.json"));
    let error = fails(1, &["bench", "cactus:10", "--json", "/nowhere/a.json"]);
    assert!(error.contains("cannot write /nowhere/a.json"), "{error}");
}

#[test]
fn bench_follows_keyframes_and_camera_files() {
    let folder = tempfile::tempdir().unwrap();
    let cameras = path(&folder, "cameras.json");
    let camera = |x: f64| {
        format!(
            r#"{{"img_name": "a", "width": 64, "height": 48, "position": [{x}, -1.2, -5],
                 "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "fx": 60, "fy": 60}}"#
        )
    };
    fs::write(&cameras, format!("[{}, {}]", camera(-1.0), camera(1.0))).unwrap();
    let hash = |arguments: &[&str]| {
        let out = path(&folder, "a.json");
        ok(&quick("cactus:500", &[arguments, &["--json", &out]].concat()));
        let report = json(&out);
        (report["path"].as_str().unwrap().to_owned(), report["runs"][0]["image_hash"].as_str().unwrap().to_owned())
    };
    let keyframes = cameras.clone();
    let (from_file, along) = (hash(&["--cameras", &cameras]), hash(&["--path", &keyframes]));
    assert_eq!((from_file.0.as_str(), along.0.as_str()), ("cameras.json", "keyframes:cameras.json"));
    // Of three frames the last is the file's first camera again, and the last keyframe.
    assert_ne!(from_file.1, along.1);
}
