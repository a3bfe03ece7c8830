//! `smalto convert`: writes what it read, with the edits, and reports the loss.

use std::fs;
use std::path::Path;

use crate::common::program::{fails, ok, path, smalto};
use serde_json::Value;
use smalto::formats;
use smalto::formats::Loss;
use smalto::scene::Gaussians;

const PLUSH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/plush.ply");

fn read(path: impl AsRef<Path>) -> Gaussians {
    formats::read(path.as_ref()).unwrap().gaussians
}

fn convert(arguments: &[&str]) -> Value {
    serde_json::from_str(&ok(&[&["convert"], arguments, &["--json", "-"]].concat())).unwrap()
}

/// The largest loss of an attribute.
fn largest(report: &Value, attribute: &str) -> f64 {
    let rows = report["loss"].as_array().unwrap();
    let row = rows.iter().find(|row| row["attribute"] == attribute).unwrap_or_else(|| panic!("no {attribute}"));
    row["largest"].as_f64().unwrap()
}

#[test]
fn float_formats_are_written_without_loss() {
    let folder = tempfile::tempdir().unwrap();
    let original = read(PLUSH);
    for name in ["a.ply", "a.glb"] {
        let out = path(&folder, name);
        let report = convert(&[PLUSH, &out]);
        assert!(read(&out) == original, "{name}");
        assert!(report["loss"].as_array().unwrap().iter().all(|row| row["largest"] == 0.0), "{report}");
        // And on from there.
        let again = path(&folder, "again.ply");
        convert(&[&out, &again]);
        assert!(read(&again) == original, "{name} to PLY");
    }
}

/// Half a step of each format's quantization, and a rounding.
#[test]
fn quantized_formats_lose_half_a_step() {
    let folder = tempfile::tempdir().unwrap();
    let convert = |name: &str, more: &[&str]| convert(&[&[PLUSH, &path(&folder, name)], more].concat());
    let spz = [convert("a.spz", &[]), convert("3.spz", &["--spz-version", "3"])];
    for report in &spz {
        assert!(largest(report, "position") < 3_f64.sqrt() * 0.5 / 65536.0 + 1e-6);
        assert!(largest(report, "scale") < 1.0 - (-0.5_f64 / 16.0).exp() + 1e-6);
        assert!(largest(report, "rotation") < 0.5);
        assert!(largest(report, "opacity") < 0.5 / 255.0 + 1e-6);
        assert!(largest(report, "colour") < 0.2820948 * 0.5 / 255.0 / 0.15 + 1e-6);
        assert!(largest(report, "SH degree 1") <= 4.0 / 128.0 + 0.5 / 128.0 + 1e-6);
        assert!(largest(report, "SH degree 3") <= 8.0 / 128.0 + 0.5 / 128.0 + 1e-6);
    }
    assert_eq!(spz[0]["loss"], spz[1]["loss"]);
    assert_eq!((&spz[0]["format"], &spz[1]["format"]), (&"SPZ 4".into(), &"SPZ 3".into()));
    let packed = convert("a.compressed.ply", &[]);
    assert!(largest(&packed, "opacity") < 0.5 / 255.0 + 1e-6);
    assert!(largest(&packed, "SH degree 2") <= 4.0 / 256.0 + 1e-6);
    assert!(largest(&packed, "rotation") < 0.3);
    let splat = convert("a.splat", &[]);
    assert_eq!(splat["sh_degree"], 0);
    // Colours over 1 are cut off.
    assert!(largest(&splat, "opacity") < 0.5 / 255.0 + 1e-6);
    assert_eq!((largest(&splat, "position"), largest(&splat, "scale")), (0.0, 0.0));
}

/// Steps that are in a file stay where they are.
#[test]
fn quantized_values_are_not_quantized_again() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["plush.v3.spz", "plush.v4.spz"] {
        let input = Path::new(PLUSH).with_file_name(name);
        let report = convert(&[input.to_str().unwrap(), &path(&folder, "a.spz")]);
        for attribute in ["position", "scale", "opacity", "colour", "SH degree 1", "SH degree 2", "SH degree 3"] {
            assert_eq!(largest(&report, attribute), 0.0, "{name}: {attribute}");
        }
        assert!(largest(&report, "rotation") < 1e-4);
    }
}

/// splat-transform's reading of files that smalto wrote earlier, and smalto still writes them.
#[test]
fn splat_transform_reads_what_is_written() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["written.ply", "written.compressed.ply", "written.splat", "written.v3.spz", "written.v4.spz"] {
        let fixture = Path::new(PLUSH).with_file_name(name);
        let out = path(&folder, name);
        let version: &[&str] = if name.contains("v3") { &["--spz-version", "3"] } else { &[] };
        convert(&[&[PLUSH, &out], version].concat());
        let (ours, kept) = (read(&out), read(&fixture));
        assert!(ours == kept, "{name} is what was read by splat-transform");
        let text = fs::read_to_string(fixture.with_file_name(format!("{name}.csv"))).unwrap();
        let mut lines = text.lines();
        let columns: Vec<&str> = lines.next().unwrap().split(',').collect();
        let rows: Vec<Vec<f64>> = lines.map(|l| l.split(',').map(|v| v.parse().unwrap()).collect()).collect();
        assert_eq!(rows.len(), ours.len(), "{name}");
        for (i, row) in rows.iter().enumerate() {
            let value = |column: &str| row[columns.iter().position(|c| *c == column).expect(column)];
            for (axis, column) in ["x", "y", "z"].iter().enumerate() {
                assert!((f64::from(ours.means()[i][axis]) - value(column)).abs() < 2e-6, "{name} {i} {column}");
                let scale = value(&format!("scale_{axis}")).exp();
                assert!((f64::from(ours.scales()[i][axis]) / scale - 1.0).abs() < 2e-6, "{name} {i} scale {axis}");
                let dc = value(&format!("f_dc_{axis}"));
                assert!((f64::from(ours.sh(i)[0][axis]) - dc).abs() < 2e-6, "{name} {i} colour {axis}");
            }
            let opacity = 1.0 / (1.0 + (-value("opacity")).exp());
            assert!((f64::from(ours.opacities()[i]) - opacity).abs() < 2e-6, "{name} {i} opacity");
            let q: Vec<f64> = (0..4).map(|k| value(&format!("rot_{k}"))).collect();
            let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
            let dot: f64 = q.iter().zip(ours.rotations()[i]).map(|(a, b)| a / length * f64::from(b)).sum();
            // splat-transform puts the 256 steps of .splat elsewhere than those who made the format, who divide by 128.
            let tolerance = if name.ends_with("splat") { 1e-4 } else { 1e-6 };
            assert!(dot.abs() > 1.0 - tolerance, "{name} {i} rotation: {dot}");
            let rest = ours.sh(i).len() - 1;
            for (k, coefficient) in ours.sh(i)[1..].iter().enumerate() {
                for (channel, ours) in coefficient.iter().enumerate() {
                    let theirs = value(&format!("f_rest_{}", channel * rest + k));
                    assert!((f64::from(*ours) - theirs).abs() < 2e-6, "{name} {i} SH {k}");
                }
            }
        }
    }
}

#[test]
fn scenes_are_moved_cropped_filtered_and_joined() {
    let folder = tempfile::tempdir().unwrap();
    let original = read(PLUSH);
    let out = path(&folder, "a.ply");
    let moved = ["--transform", "scale=2", "--transform", "translate=-1,0,0.5"];
    convert(&[&[PLUSH, &out][..], &moved].concat());
    let found = read(&out);
    for (mean, before) in found.means().iter().zip(original.means()) {
        assert_eq!(*mean, [before[0] * 2.0 - 1.0, before[1] * 2.0, before[2] * 2.0 + 0.5]);
    }
    // A turn, and the same turn back.
    convert(&[
        PLUSH,
        &out,
        "--transform",
        "rotate=10,20,30",
        "--transform",
        "rotate=0,0,-30",
        "--transform",
        "rotate=0,-20,0",
        "--transform",
        "rotate=-10,0,0",
    ]);
    for loss in Loss::between(&original, &read(&out)) {
        assert!(loss.largest < 2e-5, "{loss:?}");
    }
    convert(&[PLUSH, &out, "--up", "z", "--sh-degree", "1"]);
    let found = read(&out);
    assert_eq!(found.sh_degree(), 1);
    for (mean, before) in found.means().iter().zip(original.means()) {
        assert!((mean[1] + before[2]).abs() < 1e-6, "what was z is up, which is -y");
    }
    convert(&[PLUSH, &out, "--flip", "yz"]);
    convert(&[&out, &path(&folder, "b.ply"), "--flip", "zy"]);
    assert!(read(path(&folder, "b.ply")) == original);

    // Whatever reads a scene reads it the same way.
    let described = |args: &[&str]| {
        let mut report: Value = serde_json::from_str(&ok(&[&["info", "--json", "-"], args].concat())).unwrap();
        for name in ["scene", "format"] {
            report.as_object_mut().unwrap().remove(name);
        }
        report
    };
    let flags = ["--up", "z", "--flip", "x"];
    convert(&[&[PLUSH, out.as_str()], &flags[..]].concat());
    assert_eq!(described(&[&[PLUSH], &flags[..]].concat()), described(&[&out]));
    assert_ne!(described(&[PLUSH]), described(&[&out]));

    let [x, y, z] = original.means()[7];
    let report = convert(&[PLUSH, &out, "--crop", &format!("sphere={x},{y},{z},1e-3")]);
    assert_eq!(report["removed"], 60);
    let report = convert(&[PLUSH, &out, "--crop", "box=9e9,9e9,9e9,-9e9,-9e9,-9e9", "--min-opacity", "0.5"]);
    let opaque = original.opacities().iter().filter(|o| **o >= 0.5).count();
    assert!(opaque > 0 && opaque < 61);
    assert_eq!(report["gaussians"], opaque);
    let report = convert(&[PLUSH, "cactus:1000", &out]);
    assert_eq!(report["gaussians"], 61 + read_cactus());
}

fn read_cactus() -> usize {
    smalto::procedural::cactus(1000).unwrap().gaussians.len()
}

#[test]
fn the_table_reports_losses() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "a.splat");
    let text = ok(&["convert", PLUSH, &out]);
    assert!(text.contains("61 Gaussians") && text.contains("32.0 bytes each"), "{text}");
    assert!(text.contains("rotation") && text.contains("degrees"), "{text}");
}

#[test]
fn the_report_names_what_was_left_behind() {
    let folder = tempfile::tempdir().unwrap();
    let (input, out) = (path(&folder, "in.ply"), path(&folder, "out.spz"));
    let names =
        ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "rot_0", "rot_1", "rot_2"];
    let mut text = "ply\nformat ascii 1.0\nelement vertex 1\n".to_owned();
    names.iter().chain(&["rot_3", "sparkle"]).for_each(|name| text += &format!("property float {name}\n"));
    fs::write(&input, text + "end_header\n0 0 1 0 0 0 2 -2 -3 1 0 0 0 7\n").unwrap();
    let report = convert(&[&input, &out]);
    let notices = report["notices"].as_array().unwrap();
    let expected =
        ["it has two scales, and is drawn as flat Gaussians", "the property sparkle is unknown and not used"];
    assert_eq!(notices, &expected.map(Value::from));
    let joined = convert(&[&input, &input, &path(&folder, "both.ply")]);
    assert!(joined["notices"][3].as_str().unwrap().contains("in.ply: the property sparkle"), "{joined}");
    let pages = convert(&[&input, &path(&folder, "a.smalto")]);
    assert_eq!(pages["notices"], report["notices"]);
    // A flat Gaussian has a scale that SPZ does not hold.
    let written = smalto(&["convert", &input, &out]);
    let told = String::from_utf8(written.stderr).unwrap();
    assert!(told.contains("1 of 1 Gaussians have a scale outside of e^-10 to e^5.9375"), "{told}");
}

#[test]
fn wrong_arguments_are_refused_and_overwrite_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "a.ply");
    fs::write(&out, "precious").unwrap();
    for (code, arguments, sentence) in [
        (2, &[PLUSH, "a.xyz"][..], "scenes are written as .ply, .compressed.ply, .spz, .sog, meta.json"),
        (2, &[PLUSH, "a.xyz"], "or .smalto (pages)"),
        (2, &[PLUSH], "expected the files to read, then the file to write"),
        (2, &[PLUSH, PLUSH], "is both an input and the output"),
        (2, &[PLUSH, &out, "--transform", "shear=1"], "expected translate"),
        (2, &[PLUSH, &out, "--transform", "scale=0"], "scale"),
        (2, &[PLUSH, &out, "--crop", "sphere=1,2"], "numbers"),
        (2, &[PLUSH, &out, "--min-opacity", "2"], "from 0 to 1"),
        (2, &[PLUSH, &out, "--up", "w"], "expected x, y, z"),
        (2, &[PLUSH, &out, "--flip", "a"], "expected some of"),
        (2, &[PLUSH, &out, "--sh-degree", "5"], "5"),
        (1, &[PLUSH, &out, "--crop", "sphere=1e6,0,0,1"], "none of 61 Gaussians is left"),
        (4, &["none.ply", &out], "there is no such file"),
        (1, &[PLUSH, "/nowhere/a.ply"], "cannot write"),
        (1, &[PLUSH, &path(&folder, "far.spz"), "--transform", "translate=1e8,0,0"], "SPZ holds coordinates up to"),
    ] {
        let error = fails(code, &[&["convert"], arguments].concat());
        assert!(error.contains(sentence), "{arguments:?}: {error}");
    }
    assert_eq!(fs::read(&out).unwrap(), b"precious");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left behind");
}
