//! What the texts of commands say: counts in the units of the path that drew, and no figure that is known to be wrong.

use crate::common::program::{fails, ok, path, smalto};

const QUICK: [&str; 6] = ["--size", "16x16", "--warmup", "0", "--frames", "1"];

#[test]
fn texts_on_levels_of_detail_have_measured_figures_only() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (path(&folder, "a.smalto"), path(&folder, "a.png"));
    ok(&["lod", "cactus:9000", "-o", &file]);
    let render = ["render", &file, "--splats", "1K", "--size", "64x48", "-o", &out];
    let text = ok(&render);
    assert!(text.contains(" nodes in ") && !text.contains("dB") && !text.contains("predicted"), "{text}");
    let measured = ok(&[&render[..], &["--measure-levels"]].concat());
    assert!(measured.contains(" dB to all Gaussians"), "{measured}");
    let text = ok(&[&["bench", &file, "--splats", "1K", "--measure-levels"], &QUICK[..]].concat());
    assert!(text.contains(" dB to all Gaussians, ") && !text.contains("predicted"), "{text}");
}

#[test]
fn bench_says_which_path_counted() {
    let text = |preset: &str| ok(&[&["bench", "cactus:100", "--preset", preset], &QUICK[..]].concat());
    let fast = text("exact");
    if fast.contains("fast path\n") {
        assert!(fast.contains(" entries in bins (median)\n  counted by the portable path: "), "{fast}");
    }
    let lens = ok(&[&["bench", "cactus:100", "--preset", "exact", "--response", "ray"], &QUICK[..]].concat());
    if lens.contains("fast-rays path\n") {
        assert!(lens.contains(" entries in bins (median)\n  counted by the rays path: "), "{lens}");
    }
    let portable = text("portable");
    assert!(portable.contains("instances in") && !portable.contains("counted by"), "{portable}");
}

#[test]
fn too_little_device_memory_is_told_in_true_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "a.png");
    let render = |memory: &str| fails(5, &["render", "cactus:100", "--size", "64x48", "-o", &out, "--memory", memory]);
    let error = render("1MB");
    assert!(error.contains("the limit of 1000000 bytes is too low: ") && error.contains("for the driver"), "{error}");
}

#[test]
fn a_run_in_depth_slabs_for_lack_of_memory_says_so_once() {
    let folder = tempfile::tempdir().unwrap();
    let view = ["--eye", "0,-3,-40", "--size", "160x120", "-o", &path(&folder, "a.png")];
    let output = smalto(&[&["render", "cactus:60K"], &view[..]].concat());
    let [text, notes] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
    assert!(output.status.success(), "{notes}");
    let is_in_slabs = text.contains(" depth slabs, ");
    let count = notes.matches("drawn in depth slabs, which changes no pixel").count();
    assert_eq!(count, usize::from(is_in_slabs), "{text}{notes}");
    assert_eq!(text.contains("at least "), is_in_slabs, "{text}");
}
