//! The start of a run: its phases, and what is kept for the next one.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output};

use serde_json::Value;

use crate::common::program::{fails, ok, path, run};

const SCENE: &str = "tests/fixtures/plush.ply";

#[test]
fn render_times_the_phases_of_the_start() {
    let folder = tempfile::tempdir().unwrap();
    let (out, json) = (path(&folder, "a.png"), path(&folder, "a.json"));
    let text = ok(&["render", SCENE, "--size", "16x16", "-o", &out, "--timings", "--json", &json]);
    let names = ["device", "reading", "layout", "upload", "pipelines", "first picture"];
    for name in names {
        assert!(text.contains(&format!("\n  {name} ")), "{name}: {text}");
    }
    let report: Value = serde_json::from_str(&fs::read_to_string(json).unwrap()).unwrap();
    let phases = report["start"].as_array().unwrap();
    let ends: Vec<_> = phases.iter().map(|phase| phase["end_ms"].as_f64().unwrap()).collect();
    assert!(ends.is_sorted() && phases.iter().all(|phase| phase["ms"].as_f64().unwrap() >= 0.0), "{phases:?}");
    assert_eq!(phases.last().unwrap()["name"], "first picture");
}

#[test]
fn a_missing_device_is_reported_before_an_unreadable_scene() {
    let folder = tempfile::tempdir().unwrap();
    let bad = path(&folder, "bad.ply");
    fs::write(&bad, "ply\n").unwrap();
    let error = fails(3, &["render", &bad, "--device", "no such device"]);
    assert_eq!(error.lines().count(), 1, "{error}");
}

/// The lines on the standard error output, without those of progress, which a busy machine prints every ten seconds.
fn messages(output: &Output) -> Vec<String> {
    let text = String::from_utf8_lossy(&output.stderr);
    text.lines().filter(|line| !line.contains(" %")).map(str::to_owned).collect()
}

/// The files of the cache in `folder`.
fn kept(folder: &tempfile::TempDir) -> Vec<PathBuf> {
    let files = fs::read_dir(folder.path().join("smalto")).into_iter().flatten();
    files.map(|file| file.unwrap().path()).collect()
}

#[test]
fn pipelines_are_kept_and_a_damaged_file_is_replaced() {
    let (folder, cache) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let out = path(&folder, "a.png");
    let render = || {
        let cached = |command: &mut Command| _ = command.env("XDG_CACHE_HOME", cache.path());
        let output = run(&["render", SCENE, "--size", "16x16", "-o", &out], cached);
        assert!(output.status.success() && messages(&output).is_empty(), "{output:?}");
        fs::read(&out).unwrap()
    };
    let picture = render();
    let files = kept(&cache);
    assert_eq!(files.len(), 1, "{files:?}");
    let whole = fs::read(&files[0]).unwrap();
    for damaged in [&whole[..whole.len() / 2], b"not of smalto", b""] {
        fs::write(&files[0], damaged).unwrap();
        assert_eq!(render(), picture);
        assert_eq!(fs::read(&files[0]).unwrap().len(), whole.len());
    }
}

#[test]
fn a_cache_that_cannot_be_written_is_no_failure() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("smalto"), "a file").unwrap();
    let arguments = ["render", SCENE, "--size", "16x16", "-o", &path(&folder, "a.png")];
    let output = run(&arguments, |command| _ = command.env("XDG_CACHE_HOME", folder.path()));
    assert!(output.status.success() && messages(&output).is_empty(), "{output:?}");
    assert_eq!(fs::read_to_string(folder.path().join("smalto")).unwrap(), "a file");
}
