//! `smalto compare` of folders, depths, alpha, and pictures that are too large.

use std::fs;
use std::io::Write;
use std::path::Path;

use crate::common::program::{fails, limit, ok, path, run, smalto};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use serde_json::Value;
use smalto::pixels::{self, Alpha, FileKind, Pixels, Plane};

const SIZE: [u32; 2] = [16, 12];

fn grey(value: f32, alpha: f32) -> Pixels {
    Pixels { size: SIZE, rgba: vec![[value * alpha, value * alpha, value * alpha, alpha]; 16 * 12] }
}

fn place(folder: &tempfile::TempDir, name: &str) -> String {
    let file = path(folder, name);
    fs::create_dir_all(Path::new(&file).parent().unwrap()).unwrap();
    file
}

fn write(folder: &tempfile::TempDir, name: &str, pixels: &Pixels, transparent: bool) -> String {
    let file = place(folder, name);
    pixels.write(&file, Alpha::of(transparent)).unwrap();
    file
}

/// A photograph of this grey.
fn photograph(folder: &tempfile::TempDir, name: &str, grey: u8) {
    let file = place(folder, name);
    let picture = image::RgbImage::from_pixel(SIZE[0], SIZE[1], image::Rgb([grey; 3]));
    picture.save_with_format(file, image::ImageFormat::Jpeg).unwrap();
}

/// A picture of one channel with this value everywhere but in the first pixel.
fn plane(folder: &tempfile::TempDir, name: &str, value: f32, first: f32) -> String {
    let file = place(folder, name);
    let mut values = vec![value; 16 * 12];
    values[0] = first;
    let kind = FileKind::of(Path::new(&file)).unwrap();
    Plane { size: SIZE, values }.write_as(kind, pixels::Compression::Fast, Path::new(&file)).unwrap();
    file
}

fn json(arguments: &[&str]) -> Value {
    serde_json::from_str(&ok(&[&["compare"], arguments, &["--json", "-"]].concat())).unwrap()
}

#[test]
fn renders_are_compared_with_photographs_of_the_same_names_but_for_the_ending() {
    let folder = tempfile::tempdir().unwrap();
    let (renders, photographs) = (path(&folder, "renders"), path(&folder, "photographs"));
    for name in ["DSC1", "left/002", "left/0.3"] {
        write(&folder, &format!("renders/{name}.png"), &grey(0.5, 1.0), false);
        photograph(&folder, &format!("photographs/{name}.JPG"), 128);
    }
    fs::write(path(&folder, "photographs/notes.txt"), "").unwrap();
    fs::write(path(&folder, "photographs/left/.hidden"), "").unwrap();
    let output = smalto(&["compare", &renders, &photographs]);
    let (out, error) = (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    assert!(output.status.success(), "{error}");
    let expected = format!("smalto: note: 1 files are no pictures, the first is {photographs}/notes.txt\n");
    assert_eq!(error, expected);
    let titles: Vec<_> = out.lines().skip(1).map(|row| row.split("  ").nth(1).unwrap().trim()).collect();
    assert_eq!(titles, ["DSC1.png, DSC1.JPG", "left/0.3.png, left/0.3.JPG", "left/002.png, left/002.JPG", "worst"]);
    let heatmaps = path(&folder, "maps");
    ok(&["compare", &photographs, &renders, "--max-error", "0.01", "--heatmap", &heatmaps]);
    assert!(image::open(format!("{heatmaps}/left/0.3.JPG.png")).is_ok());
    let error = fails(2, &["compare", &photographs, &renders, "--heatmap", &format!("{renders}/maps")]);
    assert!(error.contains("is in a folder of pictures to compare"), "{error}");
}

#[test]
fn photographs_without_a_render_are_left_out_only_if_the_user_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let (renders, photographs) = (path(&folder, "renders"), path(&folder, "photographs"));
    write(&folder, "renders/b.png", &grey(0.5, 1.0), false);
    for name in ["a", "b", "c"] {
        photograph(&folder, &format!("photographs/{name}.jpg"), 128);
    }
    let error = fails(1, &["compare", &renders, &photographs]);
    let expected = format!(
        "smalto: {photographs}/a.jpg has no partner in {renders}, and 1 more have none; --partial compares those that \
         have one\n"
    );
    assert_eq!(error, expected);
    let output = smalto(&["compare", &renders, &photographs, "--partial", "--json", "-"]);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["pairs"].as_array().unwrap().len(), 1);
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(error.contains(&format!("note: 2 pictures of {photographs} have no partner in {renders}\n")), "{error}");
    fs::remove_file(path(&folder, "photographs/b.jpg")).unwrap();
    let error = fails(1, &["compare", &renders, &photographs, "--partial"]);
    assert!(error.ends_with(&format!("no picture of {renders} has a partner in {photographs}\n")), "{error}");
    let file = path(&folder, "renders/b.png");
    assert!(fails(2, &["compare", &file, &file, "--partial"]).contains("--partial needs two folders"));
}

#[test]
fn two_pictures_of_one_name_are_refused_where_it_is_not_clear_which_is_meant() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a/1.png", "b/1.png", "b/1.exr"] {
        write(&folder, name, &grey(0.5, 1.0), false);
    }
    let (a, b) = (path(&folder, "a"), path(&folder, "b"));
    let error = fails(1, &["compare", &a, &b, "--partial"]);
    assert_eq!(error, format!("smalto: {b}/1.exr and {b}/1.png have the same name: only one can be compared\n"));
    write(&folder, "a/1.exr", &grey(0.5, 1.0), false);
    assert_eq!(json(&[&a, &b])["pairs"].as_array().unwrap().len(), 2, "the same files in both");
}

#[test]
fn pictures_of_different_sizes_are_refused_with_the_option_that_helps() {
    let folder = tempfile::tempdir().unwrap();
    let a = write(&folder, "a.png", &grey(0.5, 1.0), false);
    let b = write(&folder, "b.png", &Pixels { size: [2, 1], rgba: vec![[0.0; 4]; 2] }, false);
    let error = fails(1, &["compare", &a, &b]);
    assert!(error.contains("draws at the size of a photograph with --size 2x1 or --size 16x12"), "{error}");
}

#[test]
fn depths_are_compared_as_numbers_and_judged_by_their_own_thresholds() {
    let folder = tempfile::tempdir().unwrap();
    for ending in ["exr", "npy"] {
        let [five, seven] = [5.0, 7.0].map(|v| plane(&folder, &format!("{v}.{ending}"), v, v));
        let error = fails(6, &["compare", &five, &seven, "--min-ssim", "0.999", "--max-flip", "0.001"]);
        let expected = "no threshold judges numbers such as depths: --max-depth-error or --max-depth-outliers would";
        assert!(error.contains(expected), "{error}");
        let error = fails(6, &["compare", &five, &seven, "--max-depth-error", "1.5"]);
        assert!(error.contains("largest error of depth 2 is over --max-depth-error 1.5"), "{error}");
        ok(&["compare", &five, &seven, "--max-depth-error", "2", "--min-ssim", "0.999"]);
        let pair = json(&[&five, &seven])["pairs"][0].clone();
        assert_eq!((&pair["difference"], &pair["alpha"]), (&Value::Null, &Value::Null));
        assert_eq!(pair["numbers"]["max_error"], 2.0);
        assert!((pair["numbers"]["mean_relative"].as_f64().unwrap() - 2.0 / 7.0).abs() < 1e-12);
    }
    // One pixel of 192 has a depth in only one picture.
    let (a, b) = (plane(&folder, "a.exr", 4.0, 4.0), plane(&folder, "b.npy", 4.0, f32::NAN));
    let error = fails(6, &["compare", &a, &b, "--max-depth-error", "9"]);
    assert!(error.contains("pixels with a number in only one picture: 1; none is allowed"), "{error}");
    ok(&["compare", &a, &b, "--max-depth-outliers", "0.006"]);
    let error = fails(6, &["compare", &a, &b, "--max-depth-outliers", "0.005"]);
    assert!(error.contains("fraction of outliers 0.005208"), "{error}");
    ok(&["compare", &b, &b, "--max-depth-error", "0"]);
    let map = path(&folder, "map.png");
    ok(&["compare", &a, &b, "--heatmap", &map]);
    let map = image::open(map).unwrap().to_rgb8();
    assert!(map.get_pixel(0, 0).0[0] > 200 && map.get_pixel(1, 0).0 == [0, 0, 4]);
    // Coverage as floats and as grey of 8 bits are the same numbers.
    let (floats, bits) = (plane(&folder, "alpha.exr", 0.2, 1.0), plane(&folder, "alpha.png", 0.2, 1.0));
    ok(&["compare", &floats, &bits, "--max-depth-error", "1e-6"]);
    ok(&["compare", &bits, &bits, "--max-error", "0"]);
    let colours = write(&folder, "colours.exr", &grey(0.5, 1.0), false);
    let error = fails(1, &["compare", &floats, &colours]);
    assert!(error.contains("one has a single channel of floats and the other has colours"), "{error}");
    let error = fails(6, &["compare", &colours, &colours, "--max-depth-error", "1"]);
    assert!(error.contains("no threshold judges colours"), "{error}");
}

#[test]
fn layers_of_two_runs_are_compared_together() {
    let folder = tempfile::tempdir().unwrap();
    for run in ["a", "b"] {
        write(&folder, &format!("{run}/colour/0.png"), &grey(0.5, 1.0), false);
        plane(&folder, &format!("{run}/depth/0.exr"), 5.0, if run == "a" { 5.0 } else { 5.5 });
    }
    let (a, b) = (path(&folder, "a"), path(&folder, "b"));
    let text = ok(&["compare", &a, &b, "--max-error", "0", "--max-depth-error", "0.5"]);
    assert!(text.contains("colour/0.png") && text.contains("depth/0.exr") && text.contains("only in one"), "{text}");
    let report = json(&[&a, &b]);
    assert_eq!((&report["worst"]["max_error"], &report["worst_numbers"]["max_error"]), (&0.0.into(), &0.5.into()));
    let schema = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/schemas/compare.schema.json");
    let schema: Value = serde_json::from_slice(&fs::read(schema).unwrap()).unwrap();
    assert!(jsonschema::validator_for(&schema).unwrap().is_valid(&report));
}

#[test]
fn alpha_is_compared_where_both_files_have_it() {
    let folder = tempfile::tempdir().unwrap();
    let solid = write(&folder, "solid.png", &grey(0.4, 1.0), true);
    let clear = write(&folder, "clear.exr", &grey(0.4, 0.25), true);
    let opaque = write(&folder, "opaque.png", &grey(0.4, 1.0), false);
    let pair = json(&[&solid, &clear])["pairs"][0].clone();
    assert_eq!(pair["alpha"]["max_error"], 0.75);
    // Over black, the colours are 0.4 and 0.1.
    assert!((pair["difference"]["max_error"].as_f64().unwrap() - 0.3).abs() < 1e-6);
    let error = fails(6, &["compare", &solid, &clear, "--max-alpha-error", "0.7"]);
    assert!(error.contains("largest error of alpha 0.75 is over --max-alpha-error 0.7"), "{error}");
    ok(&["compare", &solid, &clear, "--max-alpha-error", "0.75"]);
    assert!(ok(&["compare", &solid, &clear]).contains("alpha error"));
    assert_eq!(json(&[&solid, &opaque])["pairs"][0]["alpha"], Value::Null);
    assert!(!ok(&["compare", &solid, &opaque]).contains("alpha error"));
}

/// A black PNG of a bit per pixel, with a palette.
fn bomb(file: &str, [width, height]: [u32; 2], is_interlaced: bool) {
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut chunk = |kind: &[u8; 4], data: &[u8]| {
        let mut crc = flate2::Crc::new();
        crc.update(kind);
        crc.update(data);
        bytes.extend((data.len() as u32).to_be_bytes());
        bytes.extend(kind);
        bytes.extend(data);
        bytes.extend(crc.sum().to_be_bytes());
    };
    let sides = [width.to_be_bytes(), height.to_be_bytes()].concat();
    chunk(b"IHDR", &[&sides[..], &[1, 3, 0, 0, u8::from(is_interlaced)]].concat());
    chunk(b"PLTE", &[0; 6]);
    let mut packed = ZlibEncoder::new(Vec::new(), Compression::fast());
    // The passes of an interlaced picture take a little more than its rows.
    let rows = if is_interlaced { height * 2 } else { height };
    for _ in 0..rows {
        packed.write_all(&vec![0; width.div_ceil(8) as usize + 1]).unwrap();
    }
    chunk(b"IDAT", &packed.finish().unwrap());
    chunk(b"IEND", &[]);
    fs::write(file, bytes).unwrap();
}

/// The exit code and the message of the program with at most so many KiB of address space.
fn limited(kib: u32, arguments: &[&str]) -> (Option<i32>, String) {
    let output = run(arguments, |command| limit(command, &format!("-v {kib}")));
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn pictures_that_are_too_large_are_exit_code_5_before_they_are_decoded() {
    let folder = tempfile::tempdir().unwrap();
    let big = path(&folder, "big.png");
    bomb(&big, [30_000, 30_000], false);
    let expected = "big.png: cannot allocate the 31500000000 bytes of `30000x30000 pixels`: pictures have up to \
                    268435456 pixels (16384x16384)\n";
    let error = fails(5, &["compare", &big, &big]);
    assert!(error.ends_with(expected), "{error}");
    let error = fails(5, &["view", "cactus:100", "--compare", &big, "--offscreen", "4"]);
    assert!(error.ends_with(expected), "{error}");
    // The other kinds state their size in a header too.
    let jpeg = path(&folder, "big.jpg");
    photograph(&folder, "big.jpg", 0);
    let mut bytes = fs::read(&jpeg).unwrap();
    let frame = bytes.windows(2).position(|pair| pair == [0xff, 0xc0]).unwrap();
    bytes[frame + 5..frame + 9].copy_from_slice(&[0xea, 0x60, 0xea, 0x60]);
    fs::write(&jpeg, bytes).unwrap();
    assert!(fails(5, &["compare", &jpeg, &jpeg]).contains("`60000x60000 pixels`"));
    let npy = write(&folder, "big.npy", &grey(0.5, 1.0), false);
    let mut header = fs::read(&npy).unwrap();
    let (from, to) = (b"(12, 16, 3", b"(30000, 30000, 3");
    let at = header.windows(from.len()).position(|part| part == from).unwrap();
    header.splice(at..at + from.len(), *to);
    // The header keeps its length: spaces fill it up.
    let padding = header.windows(7).position(|part| part == b"      \n").unwrap();
    header.drain(padding..padding + to.len() - from.len());
    fs::write(&npy, header).unwrap();
    assert!(fails(4, &["compare", &npy, &npy]).contains("is a damaged .npy file"), "the file has not so much data");
}

/// Opening a FIFO waits for its writer.
#[test]
#[cfg(unix)]
fn a_fifo_is_not_a_picture() {
    let folder = tempfile::tempdir().unwrap();
    let fifo = path(&folder, "a.png");
    assert!(std::process::Command::new("mkfifo").arg(&fifo).status().unwrap().success());
    assert!(fails(4, &["compare", &fifo, &fifo]).ends_with("a.png: is not a file\n"));
}

/// Whatever memory there is: the program succeeds or says in one sentence that there is too little.
#[test]
#[cfg(target_os = "linux")]
fn little_memory_is_exit_code_5_and_never_an_abort() {
    let folder = tempfile::tempdir().unwrap();
    for is_interlaced in [false, true] {
        let file = path(&folder, "a.png");
        bomb(&file, [800, 600], is_interlaced);
        let mut codes = Vec::new();
        for mib in [80, 100, 120, 138, 139, 140, 141, 160, 200, 300, 340, 400, 500, 1500] {
            let (code, error) = limited(mib * 1024, &["compare", &file, &file, "--heatmap", &path(&folder, "map.png")]);
            assert!(matches!(code, Some(0 | 5)), "{mib} MiB: {code:?}, {error}");
            assert!(code == Some(0) || error.contains("too little free memory"), "{error}");
            codes.extend(code);
        }
        assert!(codes.contains(&5) && codes.ends_with(&[0]), "{codes:?}");
        assert!(codes.is_sorted_by(|less, more| less >= more), "more memory is never too little: {codes:?}");
    }
}
