//! The formats without a magic number, .splat and .ksplat: agreement with independent software, and what is not of
//! them.

use std::fs;

use crate::common::table::{self, SAME, Table, Tolerance, fixture, parse, read};
use smalto::scene::LoadReport;

fn agrees_with_splat_transform(name: &str, tolerance: &Tolerance) {
    let table = Table::read(&fixture(&format!("{name}.csv")));
    table::agrees(name, &read(&fixture(name)).gaussians, &table, tolerance);
}

/// Rotations are read as the format's own viewer reads them, (b - 128) / 128; splat-transform reads b / 127.5 - 1.
#[test]
fn splat_agrees_with_splat_transform() {
    agrees_with_splat_transform("plush.splat", &Tolerance { rotation: 4e-5, ..SAME });
}

/// Files of level 0 with three sections and SH degree 2, of level 1 with one section and SH degree 1, of level 2 with
/// two sections, full and partial buckets, and SH degree 2.
#[test]
fn ksplat_of_every_level_agrees_with_splat_transform() {
    for level in 0..3 {
        agrees_with_splat_transform(&format!("plush.l{level}.ksplat"), &SAME);
    }
}

/// The scene that both were made from, in another order.
#[test]
fn ksplat_levels_hold_the_same_gaussians() {
    let sorted = |level: u32| {
        let mut means = read(&fixture(&format!("plush.l{level}.ksplat"))).gaussians.means().to_vec();
        means.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        means
    };
    let exact = sorted(0);
    for level in [1, 2] {
        // 0.05 units a bucket, in 65,535 steps.
        for (a, b) in exact.iter().zip(sorted(level)) {
            assert!((a[0] - b[0]).abs() < 1e-6, "level {level}: {a:?} for {b:?}");
        }
    }
}

#[test]
fn splat_files_are_recognized_by_their_ending() {
    let mut bytes = fs::read(fixture("plush.splat")).unwrap();
    for magic in [b"{\"", &[0x1f, 0x8b]] {
        bytes[..2].copy_from_slice(magic);
        assert_eq!(parse(".splat", &bytes).unwrap().gaussians.len(), 61);
        assert_eq!(parse(".SPLAT", &bytes).unwrap().format, "SPLAT");
    }
    let nameless = parse("", &fs::read(fixture("plush.splat")).unwrap()).unwrap_err();
    assert!(nameless.contains("or a file named .splat, .ksplat or .gltf"), "{nameless}");
    // Content with a signature is read under any name.
    assert_eq!(parse(".splat", &fs::read(fixture("plush.ply")).unwrap()).unwrap().format, "PLY");
}

#[test]
fn files_that_are_no_splat_files_are_refused() {
    let splat = fs::read(fixture("plush.splat")).unwrap();
    let text = "No scene, but a letter: it says a thing or two. ".repeat(40).into_bytes();
    let mut random = crate::common::Random(3);
    let noise: Vec<u8> = (0..3200).map(|_| random.bits() as u8).collect();
    let cases: [(&str, Vec<u8>, &str); 5] = [
        ("empty", vec![], "the file is empty"),
        ("cut", splat[..100].to_vec(), "these 100 are not a multiple"),
        ("text", text, "not a .splat file: of its first 60 records"),
        ("noise", noise, "not a .splat file: of its first 100 records"),
        ("zeros", vec![0; 320], "of its first 10 records, 10 have"),
    ];
    for (name, bytes, expected) in cases {
        let problem = parse(".splat", &bytes).expect_err(name);
        assert!(problem.contains(expected), "{name}: {problem}");
    }
}

/// A single damaged Gaussian does not make a file another one: it is dropped, and said to be.
#[test]
fn damaged_gaussians_of_a_splat_file_are_counted() {
    let mut bytes = fs::read(fixture("plush.splat")).unwrap();
    bytes[32..36].copy_from_slice(&f32::NAN.to_le_bytes());
    bytes[64 + 12..][..4].copy_from_slice(&(-1.0_f32).to_le_bytes());
    bytes[96 + 28..][..4].copy_from_slice(&[128; 4]);
    let report = parse(".splat", &bytes).unwrap().report;
    let expected = LoadReport { read: 61, not_finite: 1, negative_scale: 1, zero_rotation: 1, ..LoadReport::default() };
    assert_eq!(report, expected);
}

/// A wrong number in a header, and the error message.
#[test]
fn inconsistent_ksplat_headers_are_refused() {
    let whole = fs::read(fixture("plush.l2.ksplat")).unwrap();
    let zero = fs::read(fixture("plush.l0.ksplat")).unwrap();
    let with = |at: usize, value: u32| {
        let mut bytes = whole.clone();
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        bytes
    };
    let section = 4096;
    let cases: Vec<(&str, Vec<u8>, &str)> = vec![
        ("version", with(0, 3), "its version would be 3.0"),
        ("text", vec![b'a'; 8192], "its version would be 97.97"),
        ("header cut", whole[..100].to_vec(), "inside the header at bytes 0 to 4096"),
        ("sections", with(4, u32::MAX), "sections need"),
        ("more sections than room", with(8, 7), "claims 7 sections, with room for 2"),
        ("level", with(20, 3), "compression level 3"),
        ("count", with(16, 62), "the header claims 62 Gaussians, those of its sections 61"),
        ("huge count", with(16, u32::MAX), "claims 4294967295 Gaussians, those of its sections 61"),
        ("section count", with(section, 41), "section 0 claims 41 Gaussians, with room for 40"),
        ("section room", with(section + 4, u32::MAX), "truncated or its headers wrong"),
        ("bucket capacity", with(section + 8, 1), "40 Gaussians, its buckets hold 35"),
        ("bucket count", with(section + 12, 3), "21 full and partial buckets, but 3 centres"),
        ("huge bucket count", with(section + 12, u32::MAX), "buckets need"),
        ("bucket bytes", with(section + 20, 16), "buckets of 16 bytes"),
        ("full buckets", with(section + 32, u32::MAX), "full and partial buckets"),
        ("partial buckets", with(section + 36, u32::MAX), "partial buckets need"),
        ("degree", with(section + 40, 4), "SH degree 4"),
        ("cut", whole[..whole.len() - 1].to_vec(), "the file ends at byte"),
        ("level 0 cut", zero[..zero.len() - 1].to_vec(), "truncated or its headers wrong"),
    ];
    for (name, bytes, expected) in cases {
        let problem = parse(".ksplat", &bytes).expect_err(name);
        assert!(problem.contains(expected), "{name}: {problem}");
    }
}

/// Unused capacity of a section lies behind its Gaussians.
#[test]
fn ksplat_sections_may_have_unused_room() {
    let mut bytes = fs::read(fixture("plush.l0.ksplat")).unwrap();
    let expected = read(&fixture("plush.l0.ksplat")).gaussians;
    // The first of three sections, of 25, uses 20.
    bytes[4096..4100].copy_from_slice(&20_u32.to_le_bytes());
    bytes[16..20].copy_from_slice(&56_u32.to_le_bytes());
    let read = parse(".ksplat", &bytes).unwrap().gaussians;
    assert_eq!(read.means(), [&expected.means()[..20], &expected.means()[25..]].concat());
}

#[test]
fn files_with_random_damage_never_panic() {
    table::survives_damage(".splat", &fs::read(fixture("plush.splat")).unwrap(), 50);
    for level in 0..3 {
        table::survives_damage(".ksplat", &fs::read(fixture(&format!("plush.l{level}.ksplat"))).unwrap(), 50);
    }
}
