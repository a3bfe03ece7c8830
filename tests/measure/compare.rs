//! `smalto compare` as its users meet it: tables, reports, heatmaps, thresholds.

use std::fs;
use std::path::Path;

use crate::common::program::{fails, ok, path};
use serde_json::Value;
use smalto::pixels::{Alpha, Pixels};

/// 16x12 pixels of grey, and one that differs by `error`.
fn picture(error: f32) -> Pixels {
    let mut pixels = Pixels { size: [16, 12], rgba: vec![[0.5, 0.5, 0.5, 1.0]; 16 * 12] };
    pixels.rgba[40][1] += error;
    pixels
}

fn write(folder: &tempfile::TempDir, name: &str, pixels: &Pixels) -> String {
    let file = folder.path().join(name);
    fs::create_dir_all(file.parent().unwrap()).unwrap();
    pixels.write(&file, Alpha::Opaque).unwrap();
    file.display().to_string()
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

fn schema() -> Value {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/schemas/compare.schema.json");
    json(&fs::read_to_string(file).unwrap())
}

#[test]
fn equal_pictures_are_equal_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let grey = Pixels { size: [16, 12], rgba: vec![[0.2, 0.4, 0.6, 1.0]; 16 * 12] };
    let [png, exr, npy] = ["a.png", "a.exr", "a.npy"].map(|name| write(&folder, name, &grey));
    for other in [&exr, &npy] {
        let text = ok(&["compare", &exr, other, "--max-error", "0", "--min-psnr", "1000", "--min-ssim", "1"]);
        assert!(text.contains("equal") && text.contains("1.000000"), "{text}");
    }
    // 51, 102 and 153 of 255 are these floats.
    ok(&["compare", &png, &exr, "--max-error", "0", "--max-flip", "0"]);
}

#[test]
fn known_differences_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (write(&folder, "a.npy", &picture(0.0)), write(&folder, "b.npy", &picture(0.125)));
    let text = ok(&["compare", &a, &b]);
    let row = text.lines().nth(1).unwrap();
    // 0.125^2 in one value of 16 * 12 * 3, so 10 log10(36864) dB; one pixel of 192.
    for part in ["a.npy, b.npy", "0.125000", "45.67", "0.521 %", "0.174 %", " 31 "] {
        assert!(row.contains(part), "{part}: {row}");
    }
    let report = json(&ok(&["compare", &a, &b, "--json", "-", "--ppd", "30"]));
    let validator = jsonschema::validator_for(&schema()).unwrap();
    assert!(validator.is_valid(&report), "{:?}", validator.validate(&report).err());
    assert_eq!(report["format"], "smalto compare 2");
    assert_eq!(report["pixels_per_degree"], 30.0);
    let difference = &report["pairs"][0]["difference"];
    assert_eq!(difference["mse"].as_f64().unwrap(), 0.125 * 0.125 / 576.0);
    assert_eq!((&difference["largest_step"], &difference["non_finite"]), (&Value::from(31), &Value::from(0)));
    assert_eq!(report["worst"], *difference);
    let mut broken = report.clone();
    broken["worst"].as_object_mut().unwrap().remove("flip");
    assert!(!validator.is_valid(&broken), "the schema notices what is missing");
    // From another viewing distance it looks different.
    let near = json(&ok(&["compare", &a, &b, "--json", "-"]));
    assert_ne!(near["worst"]["flip"], report["worst"]["flip"]);
}

#[test]
fn folders_are_compared_by_file_name_with_the_worst_last() {
    let folder = tempfile::tempdir().unwrap();
    for (name, error) in [("1.npy", 0.25), ("2.npy", 0.0), ("3.exr", 0.125)] {
        write(&folder, &format!("a/{name}"), &picture(0.0));
        write(&folder, &format!("b/{name}"), &picture(error));
    }
    fs::write(folder.path().join("a/.hidden"), "").unwrap();
    let (a, b, report) = (path(&folder, "a"), path(&folder, "b"), path(&folder, "report.json"));
    let heatmaps = folder.path().join("flip/maps");
    let text = ok(&["compare", &a, &b, "--heatmap", heatmaps.to_str().unwrap(), "--json", &report]);
    let rows: Vec<_> = text.lines().skip(1).collect();
    assert_eq!(rows.len(), 4, "{text}");
    for (row, [name, error]) in
        rows.iter().zip([["1.npy", "0.250000"], ["2.npy", "equal"], ["3.exr", "0.125000"], ["worst", "0.250000"]])
    {
        assert!(row.trim_start().starts_with(name) && row.contains(error), "{row}");
    }
    let report = json(&fs::read_to_string(report).unwrap());
    assert_eq!(report["pairs"][2]["a"], folder.path().join("a/3.exr").display().to_string());
    assert_eq!(report["worst"]["max_error"], 0.25);
    for name in ["1.npy.png", "2.npy.png", "3.exr.png"] {
        assert!(image::open(heatmaps.join(name)).is_ok(), "{name}");
    }
    let error = fails(6, &["compare", &a, &b, "--max-error", "0.1"]);
    assert_eq!(error, "smalto: 1.npy: largest error 0.25 is over --max-error 0.1\n", "of two over it, the worst");
}

#[test]
fn a_heatmap_is_bright_where_the_pictures_differ() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (write(&folder, "a.npy", &picture(0.0)), write(&folder, "b.npy", &picture(0.5)));
    let out = path(&folder, "flip.png");
    ok(&["compare", &a, &b, "--heatmap", &out]);
    let map = image::open(out).unwrap().to_rgb8();
    let brightness = |x: u32, y: u32| map.get_pixel(x, y).0.iter().map(|v| u32::from(*v)).sum::<u32>();
    assert_eq!(map.dimensions(), (16, 12));
    // Pixel 40 is in column 8 of row 2; magma begins at nearly black.
    assert!(brightness(8, 2) > 200 && brightness(8, 2) > 3 * brightness(0, 11), "{}", brightness(8, 2));
    ok(&["compare", &a, &a, "--heatmap", &path(&folder, "none.png")]);
    let none = image::open(path(&folder, "none.png")).unwrap().to_rgb8();
    assert!(none.pixels().all(|p| p.0 == [0, 0, 4]));
}

#[test]
fn thresholds_pass_and_fail_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (write(&folder, "a.npy", &picture(0.0)), write(&folder, "b.npy", &picture(0.125)));
    let found = json(&ok(&["compare", &a, &b, "--json", "-"]))["worst"].clone();
    let value = |name: &str| found[name].as_f64().unwrap();
    for (option, name, sign) in [
        ("--max-error", "max_error", 1.0),
        ("--min-psnr", "psnr_db", -1.0),
        ("--min-ssim", "ssim", -1.0),
        ("--max-flip", "flip", 1.0),
    ] {
        ok(&["compare", &a, &b, option, &value(name).to_string()]);
        ok(&["compare", &a, &b, option, &(value(name) + sign * 1e-4).to_string()]);
        let limit = (value(name) - sign * 1e-4).to_string();
        let error = fails(6, &["compare", &a, &b, option, &limit]);
        assert!(error.contains("a.npy, b.npy: ") && error.contains(option), "{error}");
    }
    let error = fails(6, &["compare", &a, &b, "--max-error", "0.1", "--min-psnr", "50"]);
    assert_eq!(
        error,
        "smalto: a.npy, b.npy: largest error 0.125 is over --max-error 0.1; a.npy, b.npy: PSNR 45.666023 is under \
         --min-psnr 50\n"
    );
    // In 32 bits 0.1 is a little more than in 64, yet not over the 0.1 of the command line.
    let [c, d] = [0.0, 0.1].map(|v| Pixels { size: [1, 1], rgba: vec![[v, v, v, 1.0]] });
    let (c, d) = (write(&folder, "c.npy", &c), write(&folder, "d.npy", &d));
    ok(&["compare", &c, &d, "--max-error", "0.1"]);
    let error = fails(6, &["compare", &c, &c, "--min-ssim=-1"]);
    assert!(error.contains("--min-ssim -1: the pictures are too small: SSIM needs at least 11x11 pixels"), "{error}");
}

#[test]
fn values_that_are_not_finite_pass_no_threshold() {
    let folder = tempfile::tempdir().unwrap();
    for value in [f32::NAN, f32::INFINITY] {
        let bad = write(&folder, "bad.npy", &picture(value));
        let good = write(&folder, "good.npy", &picture(0.0));
        for other in [&good, &bad] {
            let text = ok(&["compare", &bad, other]);
            assert!(text.lines().nth(1).unwrap().ends_with(" 1"), "{text}");
            for threshold in ["--max-error=1e6", "--min-psnr=-1000", "--min-ssim=-1", "--max-flip=1"] {
                let error = fails(6, &["compare", &bad, other, threshold]);
                assert!(error.contains("pixels with infinities or NaN: 1; "), "{error}");
            }
        }
    }
}

#[test]
fn files_without_a_partner_are_exit_code_1() {
    let folder = tempfile::tempdir().unwrap();
    let small = Pixels { size: [2, 1], rgba: vec![[0.0; 4]; 2] };
    let (a, b) = (write(&folder, "a/1.png", &picture(0.0)), write(&folder, "b/1.png", &small));
    let error = fails(1, &["compare", &a, &b]);
    assert!(error.contains("a/1.png has 16x12 pixels and ") && error.contains("b/1.png has 2x1"), "{error}");
    write(&folder, "a/2.png", &small);
    write(&folder, "a/3.png", &small);
    let (a, b) = (path(&folder, "a"), path(&folder, "b"));
    for arguments in [["compare", &a, &b], ["compare", &b, &a]] {
        let error = fails(1, &arguments);
        assert!(error.contains("a/2.png has no partner in ") && error.contains("and 1 more have none"), "{error}");
    }
    let empty = path(&folder, "empty");
    fs::create_dir(&empty).unwrap();
    assert!(fails(1, &["compare", &empty, &empty]).contains("hold no pictures"));
}

#[test]
fn an_unreadable_picture_is_exit_code_4() {
    let folder = tempfile::tempdir().unwrap();
    let a = write(&folder, "a.png", &picture(0.0));
    let bad = path(&folder, "bad.png");
    fs::write(&bad, "ply\n").unwrap();
    assert!(fails(4, &["compare", &a, &bad]).contains("bad.png: not an image that smalto reads"));
    let none = path(&folder, "none.png");
    assert!(fails(4, &["compare", &none, &a]).contains("none.png: cannot be opened: there is no such file"));
}

#[test]
fn unwritable_outputs_are_reported_before_the_comparison() {
    let folder = tempfile::tempdir().unwrap();
    let (a, bad) = (write(&folder, "a.png", &picture(0.0)), path(&folder, "none.png"));
    for option in ["--heatmap", "--json"] {
        let error = fails(1, &["compare", &a, &bad, option, "/proc/a.png"]);
        assert!(error.contains("cannot write /proc/a.png"), "{error}");
    }
    let b = write(&folder, "b.png", &picture(0.0));
    let before = fs::read(&b).unwrap();
    let error = fails(2, &["compare", &a, &b, "--heatmap", &b]);
    assert!(error.contains("b.png is an input and would be overwritten"), "{error}");
    assert_eq!(fs::read(&b).unwrap(), before);
}

#[test]
fn wrong_usage_is_exit_code_2() {
    let folder = tempfile::tempdir().unwrap();
    let a = write(&folder, "views/a.png", &picture(0.0));
    for more in [
        &["--ppd", "0"][..],
        &["--max-error", "nan"],
        &["--max-error=-1"],
        &["--min-psnr", "much"],
        &["--min-ssim", "2"],
        &["--max-flip", "1.5"],
        &["--heatmap", "flip.exr"],
    ] {
        fails(2, &[&["compare", &a, &a], more].concat());
    }
    fails(2, &["compare", &a]);
    let views = path(&folder, "views");
    assert!(fails(2, &["compare", &a, &views]).contains("expected two files or two folders"));
    assert!(fails(2, &["compare", &views, &views, "--heatmap", &views]).contains("would be overwritten"));
    assert!(ok(&["compare", "--help"]).contains("docs/schemas/compare.schema.json"));
}
