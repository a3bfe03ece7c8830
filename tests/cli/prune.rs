//! `smalto prune`: limits that hold, Gaussians that are kept or go, and every refusal.

use std::fs;
use std::path::Path;

use serde_json::Value;
use smalto::formats::SceneFile;
use smalto::measure::metrics::{max_error, psnr};
use smalto::pixels::Pixels;
use smalto::scene::Gaussians;

use super::shards::cameras;
use crate::common::agree::{GREEN, RED, ball};
use crate::common::gaussians;
use crate::common::program::{fails, ok, path, run};
use smalto::formats;

/// Rounding of 32-bit floats, where another path draws the same picture.
const ROUNDING: f32 = 1e-4;

/// Prunes, and returns the report.
fn prune(arguments: &[&str]) -> Value {
    let schema = serde_json::from_str(include_str!("../../docs/schemas/prune.schema.json")).unwrap();
    let report = serde_json::from_str(&ok(&[&["prune"], arguments, &["--json", "-"]].concat())).unwrap();
    assert!(jsonschema::is_valid(&schema, &report), "{:?}", jsonschema::validate(&schema, &report));
    report
}

fn read(file: &str) -> Gaussians {
    formats::read(Path::new(file)).unwrap().gaussians
}

fn write(folder: &tempfile::TempDir, name: &str, gaussians: &Gaussians) -> String {
    let file = path(folder, name);
    let mut bytes = Vec::new();
    SceneFile::Ply.write(gaussians, false, &mut bytes).unwrap();
    fs::write(&file, bytes).unwrap();
    file
}

/// Cameras of 32x32 pixels that look along z or back from these places.
fn looking(folder: &tempfile::TempDir, places: &[([f64; 3], f64)]) -> String {
    let entry = |(i, ([x, y, z], ahead)): (usize, &([f64; 3], f64))| {
        format!(
            r#"{{"id": {i}, "img_name": "{i}.jpg", "width": 32, "height": 32, "position": [{x}, {y}, {z}],
            "rotation": [[{ahead}, 0, 0], [0, 1, 0], [0, 0, {ahead}]], "fx": 30, "fy": 30}}"#
        )
    };
    let file = path(folder, "looking.json");
    let entries: Vec<_> = places.iter().enumerate().map(entry).collect();
    fs::write(&file, format!("[{}]", entries.join(","))).unwrap();
    file
}

fn views(report: &Value) -> &[Value] {
    report["views"].as_array().unwrap()
}

/// Walls that let no light through, and a ball between them that no camera before or behind them sees; and balls that
/// only one of the cameras sees.
fn walled() -> Gaussians {
    let wall = |z: f64| (ball([0.0, 0.0, z], 30.0, 0.99999), GREEN);
    let walls = [wall(5.0), wall(5.1), wall(5.2), wall(5.3)];
    let hidden: Vec<_> = (0..10).map(|i| (ball([0.1 * f64::from(i), 0.0, 5.15], 0.01, 0.9), RED)).collect();
    let before = (ball([0.2, 0.1, 3.0], 0.05, 0.9), RED);
    let behind = (ball([-0.2, 0.1, 7.0], 0.05, 0.9), RED);
    gaussians(&[&walls[..], &hidden, &[before, behind]].concat())
}

#[test]
fn hidden_gaussians_go_and_the_only_view_of_one_keeps_it() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write(&folder, "walled.ply", &walled());
    let (both, out) = (looking(&folder, &[([0.0; 3], 1.0), ([0.0, 0.0, 10.0], -1.0)]), path(&folder, "out.ply"));
    let report = prune(&[&scene, "--cameras", &both, "--max-error", "0", "-o", &out]);
    let counts = &report["gaussians"];
    assert_eq!((&counts["before"], &counts["unseen"]), (&16.into(), &10.into()), "{counts}");
    assert_eq!((&report["measured"]["max_error"], &report["measured"]["psnr_db"]), (&0.0.into(), &Value::Null));
    // Without the inner walls the farther outer one ends the pixels as well, so a measured limit may let them go.
    let kept: Vec<f32> = read(&out).means().iter().map(|mean| mean[2]).collect();
    assert!([3.0, 5.0, 5.3, 7.0].iter().all(|z| kept.contains(z)) && !kept.contains(&5.15), "{kept:?}");
    assert!((4..=6).contains(&kept.len()), "{kept:?}");
    // Each of the two balls is seen from one side alone.
    for (camera, z) in [("0", 3.0), ("1", 7.0)] {
        let report = prune(&[&scene, "--cameras", &both, "--camera", camera, "--max-error", "1/255", "-o", &out]);
        assert!(read(&out).means().iter().any(|mean| mean[2] == z), "camera {camera} sees it");
        assert!(!read(&out).means().iter().any(|mean| mean[2] == 10.0 - z), "camera {camera} does not see it");
        // The other camera misses the ball that is gone.
        let other = &report["others"];
        assert_eq!(other["views"], 1);
        assert!(other["measured"]["max_error"].as_f64().unwrap() > 0.2, "{other}");
        assert!(report["gaussians"]["unseen"].as_u64().unwrap() > 10, "{report}");
        // Unless what is not seen is kept for it.
        let kept = ["--camera", camera, "--max-error", "1/255", "--keep-unseen", "-o", &out];
        let report = prune(&[&[&scene[..], "--cameras", &both], &kept[..]].concat());
        assert_eq!(report["gaussians"]["unseen"], 0);
        assert!([3.0, 5.15, 7.0].iter().all(|z| read(&out).means().iter().any(|mean| mean[2] == *z)), "{report}");
    }
}

#[test]
fn limits_hold_in_every_view() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (cameras(&folder, 3), path(&folder, "out.ply"));
    let draw = |scene: &str, camera: usize| {
        let picture = path(&folder, "a.npy");
        let camera = camera.to_string();
        ok(&["render", scene, "--cameras", &file, "--camera", &camera, "--preset", "exact", "-o", &picture]);
        Pixels::read(Path::new(&picture)).unwrap()
    };
    let whole: Vec<_> = (0..3).map(|camera| draw("cactus:3000", camera)).collect();
    let mut kept = Vec::new();
    for (limit, value, most, least) in [
        ("--max-error", "2/255", 2.0 / 255.0, 0.0),
        ("--max-error", "0.1", 0.1, 0.0),
        ("--min-psnr", "60", 1.0, 60.0),
        ("--min-psnr", "40", 1.0, 40.0),
    ] {
        let report = prune(&["cactus:3000", "--cameras", &file, limit, value, "-o", &out]);
        let number = |of: &Value, name: &str| of[name].as_f64().unwrap_or(f64::INFINITY);
        for view in views(&report).iter().chain([&report]) {
            let (measured, bound) = (&view["measured"], &view["bound"]);
            assert!(number(measured, "max_error") <= most, "{limit} {value}: {measured}");
            assert!(number(measured, "psnr_db") >= least, "{limit} {value}: {measured}");
            assert!(number(bound, "max_error") >= number(measured, "max_error"), "{view}");
            assert!(number(bound, "psnr_db") <= number(measured, "psnr_db"), "{view}");
        }
        assert!(report["others"].is_null());
        for (camera, whole) in whole.iter().enumerate() {
            let pruned = draw(&out, camera);
            let (change, db) = (max_error(whole, &pruned), psnr(whole, &pruned));
            assert!(f64::from(change - ROUNDING) <= most && db >= least - 0.1, "{limit} {value}: {change}, {db} dB");
        }
        let counts = ["before", "dropped", "kept", "unseen"].map(|name| report["gaussians"][name].as_u64().unwrap());
        assert_eq!((counts[0], counts[2]), (3000, read(&out).len() as u64));
        assert!(counts[1] + counts[2] == 3000 && counts[3] <= counts[1], "{counts:?}");
        kept.push(counts[2]);
    }
    assert!(kept[0] > kept[1] && kept[2] > kept[3], "a wider limit leaves fewer Gaussians: {kept:?}");
    assert!(kept[0] < 3000 && kept[3] > 1, "{kept:?}");
}

#[test]
fn the_same_command_writes_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let file = cameras(&folder, 4);
    let write = |name: &str, more: &[&str]| {
        let out = path(&folder, name);
        let common = ["cactus:2000", "--cameras", &file, "--min-psnr", "45", "-o", &out];
        let report = prune(&[&common[..], more].concat());
        (fs::read(&out).unwrap(), report["gaussians"].clone(), report["output"]["format"].clone())
    };
    let (first, second) = (write("a.spz", &[]), write("b.spz", &[]));
    assert!(first == second);
    // Other formats hold the same Gaussians.
    for (name, format) in [("a.ply", "PLY"), ("a.sog", "SOG"), ("a.splat", "SPLAT"), ("a.glb", "glTF")] {
        let (bytes, gaussians, written) = write(name, &[]);
        assert!(!bytes.is_empty() && gaussians == first.1, "{name}");
        assert!(written.as_str().unwrap().contains(format), "{name}: {written}");
    }
    let (_, gaussians, _) = write("a.smalto", &[]);
    let pages = ok(&["info", &path(&folder, "a.smalto"), "--json", "-"]);
    let pages: Value = serde_json::from_str(&pages).unwrap();
    assert_eq!(pages["gaussians"], gaussians["kept"]);
    // Standard output takes the scene alone.
    let piped = run(
        &["prune", "cactus:2000", "--cameras", &file, "--min-psnr", "45", "-o", "-", "--format", "spz"],
        |command| _ = command.current_dir(folder.path()),
    );
    assert!(piped.status.success() && piped.stdout == first.0);
}

#[test]
fn the_text_says_what_is_bound_measured_and_not_covered() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (cameras(&folder, 4), path(&folder, "out.ply"));
    let text = ok(&["prune", "cactus:1000", "--cameras", &file, "--camera", "0,2", "--min-psnr", "40", "-o", &out]);
    for part in ["1000 Gaussians, 2 views: at least 40 dB", "bound", "measured", "not covered", "out.ply  PLY"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let text = ok(&["prune", "cactus:1000", "--cameras", &file, "--max-error", "2/255", "--size", "20x10", "-o", &out]);
    assert!(text.contains("4 views: no value changes by more than 0.0078"), "{text}");
    assert!(!text.contains("not covered"), "all cameras are given: {text}");
}

#[test]
fn what_cannot_be_done_is_refused_in_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (cameras(&folder, 2), path(&folder, "out.ply"));
    let (away, empty) = (looking(&folder, &[([0.0, 0.0, 90.0], 1.0)]), path(&folder, "empty.ply"));
    fs::write(&out, "old").unwrap();
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 0\n";
    let names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let properties: String = names.split(' ').map(|name| format!("property float {name}\n")).collect();
    fs::write(&empty, format!("{header}{properties}end_header\n")).unwrap();
    let missing = path(&folder, "no folder/out.ply");
    let with = ["--cameras", &file];
    for (code, arguments, sentence) in [
        (
            2,
            vec!["cactus:10", "--min-psnr", "40", "-o", &out],
            "prune needs views: no --cameras, and none found next to",
        ),
        (2, [&["cactus:10", "-o", &out], &with[..]].concat(), "prune needs a limit of what it may change"),
        (
            2,
            [&["cactus:10", "-o", &out, "--min-psnr", "40", "--max-error", "0.1"], &with[..]].concat(),
            "--min-psnr cannot be combined with --max-error",
        ),
        (2, [&["cactus:10", "--min-psnr", "40"], &with[..]].concat(), "missing: --output <FILE>"),
        (2, [&["cactus:10", "--min-psnr", "0", "-o", &out], &with[..]].concat(), "--min-psnr 0: expected a PSNR in dB"),
        (2, [&["cactus:10", "--max-error", "7", "-o", &out], &with[..]].concat(), "steps of 8 bits like 2/255"),
        (2, [&["cactus:10", "--max-error", "-0.1", "-o", &out], &with[..]].concat(), "expected a number from 0 to 1"),
        (2, [&["cactus:10", "--min-psnr", "40", "-o", "a.xyz"], &with[..]].concat(), "scenes are written as .ply"),
        (2, [&["cactus:10", "--min-psnr", "40", "-o", "a"], &with[..]].concat(), "does not say which format it has"),
        (
            2,
            [&["cactus:10", "--min-psnr", "40", "-o", &out, "--spz-version", "3"], &with[..]].concat(),
            "--spz-version needs an .spz file",
        ),
        (2, [&["cactus:10", "--min-psnr", "40", "-o", &out, "--stop", "0.1"], &with[..]].concat(), "--stop"),
        (
            2,
            [&["cactus:10", "--min-psnr", "40", "-o", &out, "--order", "per-pixel"], &with[..]].concat(),
            "--reference",
        ),
        (
            2,
            [&["cactus:10", "--min-psnr", "40", "-o", &out, "--camera", "7"], &with[..]].concat(),
            "there is no camera 7",
        ),
        (
            2,
            [&["cactus:10", "--min-psnr", "40", "-o", "-", "--format", "ply", "--json", "-"], &with[..]].concat(),
            "would both be written to standard output",
        ),
        (
            2,
            [&["cactus:10", "--min-psnr", "40", "-o", "-", "--format", "smalto"], &with[..]].concat(),
            "a page file cannot go to standard output",
        ),
        (1, [&["cactus:10", "--min-psnr", "40", "-o", &missing], &with[..]].concat(), "cannot write"),
        (1, [&["cactus:10", "--min-psnr", "40", "-o", &out, "--no-clobber"], &with[..]].concat(), "out.ply"),
        (4, [&[&empty[..], "--min-psnr", "40", "-o", &out], &with[..]].concat(), "the scene holds no Gaussians"),
        (1, vec!["cactus:10", "--min-psnr", "40", "-o", &out, "--cameras", &away], "no given view sees a Gaussian"),
        (4, vec!["cactus:10", "--min-psnr", "40", "-o", &out, "--cameras", "none.json"], "none.json"),
        (4, [&["none.ply", "--min-psnr", "40", "-o", &out], &with[..]].concat(), "none.ply"),
    ] {
        let error = fails(code, &[&["prune"], &arguments[..]].concat());
        assert!(error.starts_with("smalto: ") && error.contains(sentence), "{arguments:?}: {error}");
        assert_eq!(error.lines().count(), 1, "{arguments:?}: {error}");
    }
    let scene = write(&folder, "walled.ply", &walled());
    let error = fails(2, &["prune", &scene, "--cameras", &file, "--min-psnr", "40", "-o", &scene]);
    assert!(error.contains("is both an input and the output"), "{error}");
    assert_eq!(fs::read_to_string(&out).unwrap(), "old", "a file is replaced only by a complete one");
}
