//! `smalto trade` and error budgets on the command line.

use std::fs;
use std::path::Path;

use crate::common::agree::{ahead, ball};
use crate::common::program::{fails, ok, path, smalto};
use crate::common::{Gpu, Random, gaussians};
use serde_json::Value;
use smalto::measure::bench::Protocol;
use smalto::measure::metrics::{max_error, psnr};
use smalto::measure::trade::{Study, knobs};
use smalto::options::Options;
use smalto::packing::Statistics;
use smalto::pixels::Pixels;
use smalto::procedural::cactus;
use smalto::rules::{Background, Rules};
use smalto::scene::{Gaussians, Requirements};

/// Little work, the same on every device.
const QUICK: [&str; 10] =
    ["--size", "48x32", "--oracle-size", "40x24", "--views", "2", "--frames", "2", "--warmup", "0"];

fn quick<'a>(scene: &'a str, parts: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["trade", scene], &QUICK[..], &["--parts", parts], more].concat()
}

/// The report of such a run, which the schema in the docs describes, and the printed tables.
fn report(scene: &str, parts: &str, more: &[&str]) -> (Value, String) {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "a.json");
    let text = ok(&quick(scene, parts, &[more, &["--json", &out]].concat()));
    let json = |file: &str| serde_json::from_str::<Value>(&fs::read_to_string(file).unwrap()).unwrap();
    let report = json(&out);
    let schema = json(&format!("{}/docs/schemas/trade.schema.json", env!("CARGO_MANIFEST_DIR")));
    let validator = jsonschema::validator_for(&schema).unwrap();
    assert!(validator.is_valid(&report), "{:?}", validator.validate(&report).err());
    let mut broken = report.clone();
    broken.as_object_mut().unwrap().remove("points");
    assert!(!validator.is_valid(&broken), "the schema notices what is missing");
    (report, text)
}

fn list<'r>(report: &'r Value, name: &str) -> &'r [Value] {
    report[name].as_array().unwrap()
}

fn names(points: &[Value]) -> Vec<&str> {
    points.iter().map(|p| p["name"].as_str().unwrap()).collect()
}

/// Time and PSNR.
fn place(point: &Value) -> (f64, f64) {
    (point["gpu_ms"].as_f64().unwrap(), point["from_oracle"]["psnr_db"].as_f64().unwrap_or(f64::INFINITY))
}

pub(super) fn scene() -> Gaussians {
    cactus(1500).unwrap().gaussians
}

#[test]
#[ignore = "long: every knob is measured"]
fn long_every_preset_and_every_knob_is_a_row() {
    let folder = tempfile::tempdir().unwrap();
    let plot = path(&folder, "a.svg");
    let (report, text) = report("cactus:300", "knobs", &["--plot", &plot]);
    let points = list(&report, "points");
    let gaussians = cactus(300).unwrap().gaussians;
    let mut expected = vec!["exact", "balanced", "fast", "preview", "inria", "gsplat", "khr"];
    let knobs = knobs(&Options::EXACT, &Requirements::of(&gaussians));
    expected.extend(knobs.iter().map(|(name, _)| name.as_str()));
    assert_eq!(names(points), expected);
    for name in &expected {
        assert!(text.contains(name), "{name}: {text}");
    }
    let stages = |point: &Value| list(point, "stages").len();
    assert_eq!(stages(&points[0]), 7);
    let scaled = points.iter().find(|p| p["name"] == "scale 0.5").unwrap();
    assert_eq!(stages(scaled), 8, "and an enlargement");
    assert!(points[0]["from_exact"]["psnr_db"].is_null(), "the exact options draw the exact picture");
    assert!(place(&points[0]).1 > 90.0);
    let is_beaten = |point: &Value| {
        let (ms, db) = place(point);
        points.iter().map(place).any(|other| other != (ms, db) && other.0 <= ms && other.1 >= db)
    };
    for point in points {
        assert_eq!(point["is_pareto"], !is_beaten(point), "{}", point["name"]);
    }
    assert!(points.iter().any(|p| p["is_pareto"] == true));
    for empty in ["search", "promises"] {
        assert!(list(&report, empty).is_empty(), "{empty} was not asked for");
    }
    assert!(report["certificate"].is_null() && report["budget"].is_null());
    let svg = fs::read_to_string(plot).unwrap();
    assert!(svg.contains("balanced") && svg.contains("1 step of 8 bits"));
}

#[test]
fn a_search_starts_from_the_exact_options() {
    let (report, _) = report("few-large:40", "search", &[]);
    assert_eq!(names(list(&report, "points")), ["exact"]);
    let found = list(&report, "search");
    assert!(names(found).iter().all(|name| name.starts_with("+ ")));
    let db = |point: &Value| point["from_exact"]["psnr_db"].as_f64().unwrap_or(f64::INFINITY);
    assert!(found.iter().all(|point| db(point) >= 36.0), "it ends where pictures are too far");
    let turned = |pair: &[Value]| pair[0]["options"] != pair[1]["options"];
    assert!(found.windows(2).all(turned));
}

/// A camera file with cameras in front of a scene, `x` aside.
fn camera_file(folder: &tempfile::TempDir, x: &[f64]) -> String {
    let file = path(folder, "cameras.json");
    let camera = |x: &f64| {
        format!(
            r#"{{"img_name": "a", "width": 64, "height": 48, "position": [{x}, -1.2, -5],
                 "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "fx": 60, "fy": 60}}"#
        )
    };
    fs::write(&file, format!("[{}]", x.iter().map(camera).collect::<Vec<_>>().join(", "))).unwrap();
    file
}

#[test]
fn levels_are_compared_with_exact_and_with_supersampled_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let cameras = camera_file(&folder, &[0.0]);
    let (levels, plot) = (path(&folder, "levels.smalto"), path(&folder, "a.svg"));
    ok(&["lod", "cactus:6000", "-o", &levels]);
    let (report, text) = report(&levels, "levels", &["--cameras", &cameras, "--plot", &plot]);
    let points = list(&report["levels"], "points");
    let number = |point: &Value, name: &str| point[name].as_f64().unwrap();
    let db = |point: &Value, to: &str| point[to]["psnr_db"].as_f64().unwrap_or(f64::INFINITY);
    assert_eq!(points.len(), 3 * 7);
    for (preset, points) in ["exact", "balanced", "fast"].iter().zip(points.chunks(7)) {
        assert!(points.iter().all(|point| point["preset"] == *preset));
        assert!(points[0]["options"]["splats"] == 0 && points[0]["pages"].is_null());
        let falls = |of: &dyn Fn(&Value) -> f64| points.windows(2).all(|pair| of(&pair[0]) > of(&pair[1]));
        assert!(falls(&|point| number(point, "visible")), "{preset} has fewer and fewer nodes: {text}");
        assert!(falls(&|point| db(point, "from_exact")), "{preset} differs more and more: {text}");
        assert!(points[1..].iter().all(|point| number(point, "predicted_psnr").is_finite()));
    }
    assert!(points[0]["from_exact"]["psnr_db"].is_null(), "the exact options draw the exact picture");
    for (mark, to) in [("is_pareto", "from_exact"), ("is_pareto_supersampled", "from_supersampled")] {
        let place = |point: &Value| (number(point, "gpu_ms"), db(point, to));
        let beats = |other: (f64, f64), one: (f64, f64)| other != one && other.0 <= one.0 && other.1 >= one.1;
        for point in points {
            let is_beaten = points.iter().any(|other| beats(place(other), place(point)));
            assert_eq!(point[mark], !is_beaten, "{mark} of {point}");
        }
    }
    let draw = |size: &str| {
        let out = path(&folder, &format!("{size}.npy"));
        ok(&["render", &levels, "--preset", "exact", "--cameras", &cameras, "--size", size, "-o", &out]);
        Pixels::read(Path::new(&out)).unwrap()
    };
    let truth = psnr(&draw("48x32"), &draw("192x128").averaged(4));
    assert!(db(&points[0], "from_supersampled") < 60.0, "the pictures differ");
    assert!((db(&points[0], "from_supersampled") - truth).abs() < 1e-6, "{truth}: {text}");
    assert!(list(&report, "points").is_empty() && report["views"] == 1);
    assert!(fs::read_to_string(plot).unwrap().contains("balanced, to 16 samples"));
    // A file without levels has none to measure.
    let error = fails(2, &quick("cactus:10", "levels", &[]));
    assert!(error.contains("`smalto lod` makes a file with them"), "{error}");
    let missing = path(&folder, "missing.smalto");
    assert!(fails(4, &quick(&missing, "levels", &[])).contains("missing.smalto: cannot be opened"));
}

#[test]
fn presets_keep_their_promises_and_errors_stay_below_certificates() {
    let folder = tempfile::tempdir().unwrap();
    // Three cameras, of which two are views.
    let file = camera_file(&folder, &[-1.0, 0.0, 1.0]);
    let (report, text) = report("cactus:2000", "promises,certificate", &["--cameras", &file]);
    let promises = list(&report, "promises");
    let presets: Vec<_> = promises.iter().map(|p| p["preset"].as_str().unwrap()).collect();
    assert_eq!(presets, ["exact", "balanced", "fast", "preview"]);
    for promise in promises {
        assert_eq!((&promise["cameras"], &promise["is_kept"]), (&3.into(), &true.into()), "{promise}");
        assert!(promise["worst"]["psnr_db"].as_f64() >= promise["min_psnr_db"].as_f64());
    }
    let certificate = &report["certificate"];
    let settings = list(certificate, "settings").len() as u64;
    assert_eq!(certificate["violations"], 0);
    assert_eq!(certificate["pixel_tests"], settings * 2 * 40 * 24);
    assert!(list(&report, "points").is_empty());
    assert!(text.contains("0 violations"), "{text}");
}

#[test]
fn budget_options_are_checked_on_other_views() {
    let (report, text) = report("cactus:500", "certificate", &["--min-psnr", "45", "--held-out", "3"]);
    let budget = &report["budget"];
    assert_eq!(budget["budget"], "--min-psnr 45");
    assert_eq!(budget["held_out_views"], 3);
    assert!(budget["gpu_ms"].as_f64() <= budget["exact_gpu_ms"].as_f64());
    let worst = budget["from_oracle"]["psnr_db"].as_f64().unwrap();
    assert_eq!(worst < 45.0, budget["exceeded"] != 0, "{budget}");
    assert!(text.contains(&format!("on 3 other views: {} over the budget", budget["exceeded"])), "{text}");
}

#[test]
fn an_unmeetable_budget_is_exit_code_6() {
    for command in ["render", "trade"] {
        let mut arguments = vec![command, "cactus:100", "--size", "16x16", "--max-error", "1e-9"];
        if command == "trade" {
            arguments.extend(["--parts", "certificate", "--oracle-size", "16x16", "--views", "1", "--frames", "1"]);
        }
        let error = fails(6, &arguments);
        assert!(error.contains("cannot be met: 32-bit floats alone differ from the reference by"), "{error}");
    }
    assert!(fails(6, &["render", "cactus:100", "--size", "16x16", "--min-psnr", "900"]).contains("--min-psnr 900"));
}

#[test]
fn measurements_are_written_even_if_the_budget_is_unmeetable() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "a.json");
    fails(6, &quick("cactus:100", "certificate", &["--json", &out, "--max-error", "1e-9"]));
    let report: Value = serde_json::from_str(&std::fs::read_to_string(out).unwrap()).unwrap();
    assert_eq!(report["certificate"]["violations"], 0);
    assert!(report["budget"].is_null());
}

/// A haze of faint black Gaussians: nothing is left of it on black.
#[test]
fn a_budget_holds_for_the_background_of_the_picture() {
    let mut random = Random(5);
    let mut haze = || {
        let mean = [random.between(-2.0, 2.0), random.between(-2.0, 2.0), random.between(4.0, 6.0)];
        (ball(mean, 0.5, 0.006), [0.0; 3])
    };
    let scene = gaussians(&(0..800).map(|_| haze()).collect::<Vec<_>>());
    let (gpu, statistics) = (Gpu::new(), Statistics::of(&scene));
    let white = Background::Colour([1.0; 3]);
    let views = [[ahead([32, 24], 30.0)].to_vec(), [ahead([32, 24], 30.0)].to_vec()];
    let protocol = Protocol { warmup: 0, frames: 1 };
    let study =
        Study::new(&gpu.0, (&scene, &statistics), (Options::EXACT, white), views, protocol, &|_| Ok(())).unwrap();
    let faint = Rules { alpha_min: 1.0 / 64.0, ..Rules::TRAINED };
    let error = study.from_exact(&Options { rules: faint, ..Options::EXACT }).unwrap().max_error;
    assert!(error > 0.2, "what a threshold takes from the haze is white: {error}");
}

#[test]
#[ignore = "long: a budget is searched"]
fn long_render_reports_the_options_chosen_for_a_budget() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "a.npy");
    let common = ["render", "many-small:200", "--size", "32x24", "-o"];
    let output = smalto(&[&common[..], &[&out, "--max-error", "0.01"]].concat());
    let note = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && note.contains("note: --max-error 0.01: "), "{note}");
    assert!(note.contains("when exact"), "{note}");
    let exact = path(&folder, "b.npy");
    ok(&[&common[..], &[&exact, "--reference"]].concat());
    let [chosen, exact] = [out, exact].map(|file| Pixels::read(Path::new(&file)).unwrap());
    assert!(max_error(&chosen, &exact) <= 0.01);
}

#[test]
fn wrong_knobs_and_budgets_are_exit_code_2() {
    for wrong in [
        &["--max-error", "0"][..],
        &["--max-error=-1"],
        &["--max-error", "nan"],
        &["--max-error", "inf"],
        &["--max-error", "0.1", "--min-psnr", "40"],
        &["--min-psnr", "0"],
        &["--min-psnr", "nan"],
        &["--order", "per-pixel"],
        &["--alpha-min", "0"],
        &["--alpha-min", "1e-13"],
        &["--alpha-min", "1.1"],
        &["--alpha-min", "nan"],
        &["--stop=-0.1"],
        &["--stop", "1.5"],
        &["--stop", "nan"],
        &["--scale", "0"],
        &["--scale", "1.5"],
        &["--scale", "nan"],
        &["--key-bits", "7"],
        &["--key-bits", "33"],
        &["--sh-degree", "5"],
        &["--sh-storage", "u4"],
        &["--shape-storage", "bytes"],
        &["--extent", "two-sigma"],
        &["--near", "0"],
    ] {
        for command in ["render", "trade"] {
            assert!(!fails(2, &[&[command, "cactus:10"], wrong].concat()).is_empty());
        }
    }
    for wrong in [
        &["--max-error", "0.1", "--preset", "fast"][..],
        &["--min-psnr", "40", "--preset", "exact"],
        &["--min-psnr", "40", "--scale", "0.5"],
        &["--max-error", "0.1", "--reference"],
        &["-o", "a.exr", "--certificate", "a.exr"],
        &["--certificate", "a.png"],
        &["--certificate", "a.exr", "--extent", "three-sigma-squares"],
    ] {
        assert!(!fails(2, &[&["render", "cactus:10"], wrong].concat()).is_empty());
    }
    for wrong in [
        &["--parts", "certificate", "--plot", "a.svg"][..],
        &["--parts", "certificate", "--extent", "three-sigma-squares"],
        &["--scale", "0.5"],
    ] {
        assert!(!fails(2, &[&["trade", "cactus:10"], wrong].concat()).is_empty());
    }
    for wrong in [&["--parts", "none"][..], &["--views", "0"], &["--frames", "0"], &["--held-out", "0"]] {
        assert!(!fails(2, &[&["trade", "cactus:10"], wrong].concat()).is_empty());
    }
    let error = fails(2, &["render", "cactus:10", "--order", "per-pixel"]);
    assert!(error.contains("--order per-pixel needs --reference"), "{error}");
}

#[test]
fn render_sorts_per_pixel_in_the_reference() {
    let folder = tempfile::tempdir().unwrap();
    let draw = |order: &str| {
        let out = path(&folder, &format!("{order}.npy"));
        ok(&["render", "cactus:500", "--size", "40x30", "--reference", "--order", order, "-o", &out]);
        Pixels::read(Path::new(&out)).unwrap()
    };
    assert!(max_error(&draw("per-pixel"), &draw("depth")) > 0.01);
}

#[test]
fn unwritable_outputs_are_reported_before_the_measurement() {
    for file in ["--json", "--plot"] {
        let arguments = quick("cactus:100", "knobs", &[file, "/nowhere/a"]);
        let output = smalto(&arguments);
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(1) && error.contains("cannot write /nowhere/a"), "{error}");
        assert!(output.stdout.is_empty(), "nothing was measured");
    }
}
