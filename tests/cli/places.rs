//! `--place`: a scene at many places.

use std::fs;

use serde_json::{Value, json};

use super::shards::cameras;
use crate::common::program::{fails, ok, path};
use crate::common::table::fixture;

fn list(folder: &tempfile::TempDir, name: &str, places: &Value) -> String {
    let file = path(folder, name);
    fs::write(&file, json!({ "places": places }).to_string()).unwrap();
    file
}

#[test]
fn a_list_of_places_is_drawn_and_reported() {
    let folder = tempfile::tempdir().unwrap();
    let places = json!([
        {"position": [0, 0, 0]},
        {"position": [3, 0, 0], "rotation": [1, 0, 1, 0], "scale": 0.5},
        {"position": [0, -2, 5]},
    ]);
    let (file, out) = (list(&folder, "list.json", &places), path(&folder, "a.png"));
    let schema = serde_json::from_str(include_str!("../../docs/schemas/places.schema.json")).unwrap();
    assert!(jsonschema::is_valid(&schema, &json!({ "places": places })));
    let render = ["render", "cactus:300", "--size", "32x24", "--json", "-", "-o", &out];
    let report = |more: &[&str]| serde_json::from_str::<Value>(&ok(&[&render[..], more].concat())).unwrap();
    let (one, three) = (report(&[]), report(&["--place", &file]));
    assert_eq!((&one["scene"]["gaussians"], &three["scene"]["gaussians"]), (&json!(300), &json!(900)));
    assert_ne!(one["scene"]["hash"], three["scene"]["hash"]);
    let distance = |report: &Value| {
        let position = report["frames"][0]["camera"]["position"].as_array().unwrap();
        position.iter().map(|v| v.as_f64().unwrap().powi(2)).sum::<f64>().sqrt()
    };
    assert!(distance(&three) > distance(&one) + 1.0, "the default camera sees all places");
    let bench = ["bench", "cactus:300", "--size", "32x24", "--warmup", "0", "--frames", "1", "--json", "-"];
    let bench: Value = serde_json::from_str(&ok(&[&bench[..], &["--place", &file]].concat())).unwrap();
    assert_eq!(bench["runs"][0]["subject"]["scene"]["gaussians"], 900);
    assert!(bench["runs"][0]["counts"]["visible"]["median"].as_f64().unwrap() > 300.0, "{}", bench["runs"][0]);
}

#[test]
fn what_cannot_be_placed_is_refused_in_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let one = list(&folder, "list.json", &json!([{"position": [0, 0, 0]}]));
    let out = path(&folder, "a.exr");
    let render = ["render", "cactus:50", "--size", "8x8", "-o", &out, "--place"];
    let error = fails(2, &[&render[..], &[&one, "--layers", "depth"]].concat());
    assert!(error.contains("--place cannot be combined with --layers depth"), "{error}");
    let error = fails(1, &[&render[..], &[&one, "--preset", "portable"]].concat());
    assert!(error.contains("only the fast path draws scenes at places"), "{error}");
    let wrong = list(&folder, "wrong.json", &json!([{"position": [0, 0, 0]}, {"position": [0, 0]}]));
    let error = fails(4, &[&render[..], &[&wrong]].concat());
    assert!(error.contains(&format!("{wrong}: place 1: ")), "{error}");
    let many = list(&folder, "many.json", &json!(vec![json!({"position": [0, 0, 0]}); 50_000]));
    let error = fails(1, &["render", "cactus:100000", "--size", "8x8", "-o", &out, "--place", &many]);
    assert!(error.contains("50000 places of 100000 Gaussians are more than 4294967295 Gaussians"), "{error}");
}

#[test]
fn resume_and_verify_compare_the_list() {
    let folder = tempfile::tempdir().unwrap();
    let (views, out) = (cameras(&folder, 2), path(&folder, "views"));
    let lists = [0, 1].map(|x| list(&folder, &format!("{x}.json"), &json!([{"position": [x, 0, 0]}])));
    let render = ["render", "cactus:200", "--cameras", &views, "--camera", "all", "-o", &out];
    let run = |list: &str, option: &str, code: i32| {
        let place: &[&str] = if list.is_empty() { &[] } else { &["--place", list] };
        let line = [&render[..], place, &[option]].concat();
        if code == 0 { ok(&line) } else { fails(code, &line) }
    };
    run(&lists[0], "--resume", 0);
    assert!(run(&lists[0], "--verify", 0).contains("all 2 files are complete"));
    for other in [lists[1].as_str(), ""] {
        assert!(run(other, "--resume", 2).contains("had other settings (places, scene)"));
        assert!(run(other, "--verify", 6).contains("2 of 2 files are wrong: 2 of other settings"));
    }
}

/// Positions in doubles at 5301 km, where 32-bit floats are 0.5 apart.
#[test]
fn convert_moves_positions_before_they_are_rounded() {
    let (folder, scene) = (tempfile::tempdir().unwrap(), fixture("far/utm.ply").display().to_string());
    let (out, json) = (path(&folder, "a.ply"), path(&folder, "a.json"));
    let position = |report: &Value| report["loss"][0]["largest"].as_f64().unwrap();
    let convert = |scene: &str, steps: &[&str]| -> Value {
        let steps = steps.iter().flat_map(|step| ["--transform", step]);
        ok(&["convert", scene, &out, "--json", &json].into_iter().chain(steps).collect::<Vec<_>>());
        serde_json::from_slice(&fs::read(&json).unwrap()).unwrap()
    };
    let report = convert(&scene, &["translate=-500123.37,-5301234.61,-412.125"]);
    assert!(position(&report) < 1e-7 && report["notices"] == json!([]), "{report}");
    let expected = [[0.0; 3], [0.3, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.3], [0.21, 0.21, 0.06]];
    let found = smalto::formats::read(&out).unwrap().gaussians;
    for (found, expected) in found.means().as_flattened().iter().zip(expected.as_flattened()) {
        assert!((f64::from(*found) - expected).abs() < 3e-8, "{found}, not {expected}");
    }
    for steps in [&[][..], &["scale=1e-300"]] {
        let report = convert(&scene, steps);
        assert!(position(&report) > 0.0, "{report}");
        let notice = report["notices"][0].as_str().unwrap();
        assert!(
            notice.starts_with("of 5 Gaussians") && notice.contains("moved by over a tenth of their size"),
            "{notice}"
        );
    }
    let far = ["--transform", "translate=1e300,0,0"];
    let said = fails(4, &["convert", &scene, &out, far[0], far[1]]);
    assert!(
        said.contains("none of its 5 Gaussians can be drawn: 5 dropped as") && said.contains("too large"),
        "{said}"
    );
    let said = fails(1, &["convert", "cactus:10", &out, far[0], far[1]]);
    assert!(said.contains("none of its 10 Gaussians can be drawn") && said.contains("too large"), "{said}");
    let said = fails(4, &["convert", &scene, &path(&folder, "a.smalto"), far[0], far[1]]);
    assert!(said.contains("Gaussians"), "{said}");
    // What a file holds beside Gaussians is in the report, too.
    let report = convert(&fixture("variant.2dgs.ply").display().to_string(), &[]);
    assert!(report["notices"][0].as_str().unwrap().contains("it has two scales"), "{report}");
}
