//! `.rad` of Spark: agreement with Spark's own decoder, every encoding, and one clear sentence for every lie.

use std::fs;

use crate::common::table::{self, Table, fixture, parse, read};
use serde_json::{Value, json};
use smalto::formats;
use smalto::scene::{Gaussians, harmonics};

/// The rows of the CSV that Spark's decoder made of a file, of nodes without children.
fn leaves(table: &Table, has_tree: bool) -> Vec<usize> {
    (0..table.rows.len()).filter(|row| !has_tree || table.value(*row, "child_count") == 0.0).collect()
}

/// Every attribute as Spark's decoder reads it.
fn agrees(name: &str, has_tree: bool) -> Gaussians {
    let gaussians = read(&fixture(&format!("rad/{name}.rad"))).gaussians;
    let table = Table::read(&fixture(&format!("rad/{name}.csv")));
    let rows = leaves(&table, has_tree);
    assert_eq!(gaussians.len(), rows.len(), "{name}");
    for (i, row) in rows.into_iter().enumerate() {
        let theirs = |column: &str| table.value(row, column);
        let close = |what: &str, ours: f32, theirs: f64, tolerance: f64| {
            table::close(&format!("{name} {i} {what}"), ours, theirs, tolerance);
        };
        assert!(theirs("alpha") <= 1.0, "a leaf of the scene");
        close("alpha", gaussians.opacities()[i], theirs("alpha"), 1e-6);
        let q = ["qw", "qx", "qy", "qz"].map(&theirs);
        let dot: f64 = q.iter().zip(gaussians.rotations()[i]).map(|(a, b)| a * f64::from(b)).sum();
        let length = q.iter().map(|value| value * value).sum::<f64>().sqrt();
        assert!(dot.abs() / length > 1.0 - 1e-6, "{name} {i}: {q:?}");
        for axis in 0..3 {
            let [mean, scale, colour] = [["x", "y", "z"], ["sx", "sy", "sz"], ["r", "g", "b"]].map(|names| names[axis]);
            close(mean, gaussians.means()[i][axis], theirs(mean), 1e-6);
            close(scale, gaussians.scales()[i][axis], theirs(scale), 2e-6 * theirs(scale));
            let sh = gaussians.sh(i);
            close(colour, sh[0][axis], (theirs(colour) - 0.5) / harmonics::C0, 1e-5);
            for (basis, value) in (1..).zip(&sh[1..]) {
                let column = format!("sh{basis}_{}", ["r", "g", "b"][axis]);
                close(&column, value[axis], theirs(&column), 1e-6);
            }
        }
    }
    gaussians
}

#[test]
fn rad_agrees_with_sparks_decoder() {
    for name in ["plush-default-lod", "plush-enc-f16", "plush-enc-f16lebytes-r8-s8delta", "plush-clusters-lod"] {
        let gaussians = agrees(name, true);
        assert_eq!((gaussians.len(), gaussians.sh_degree()), (61, 3), "{name}");
    }
    agrees("plush-nolod-f32", false);
}

/// All files have the Gaussians of one scene, up to the precision of each.
#[test]
fn every_rad_holds_the_scene() {
    let expected = sorted(&read(&fixture("plush.ply")).gaussians);
    for (name, degree, format) in [
        ("plush-default-lod", 3, "RAD, the leaves of 79 nodes"),
        ("plush-enc-f32", 3, "RAD, the leaves of 79 nodes"),
        ("plush-chunked-lod", 3, "RAD, the leaves of 79 nodes"),
        ("plush-clusters-few16", 3, "RAD, the leaves of 79 nodes"),
        ("plush-sh1-lod", 1, "RAD, the leaves of 79 nodes"),
        ("plush-inflate-lod", 3, "RAD, the leaves of 79 nodes"),
        ("plush-nolod", 3, "RAD"),
    ] {
        let scene = read(&fixture(&format!("rad/{name}.rad")));
        let found = (scene.format.as_str(), scene.gaussians.sh_degree(), scene.gaussians.len());
        assert_eq!(found, (format, degree, 61), "{name}");
        for (found, expected) in sorted(&scene.gaussians).iter().zip(&expected) {
            for axis in 0..3 {
                assert!((found.0[axis] - expected.0[axis]).abs() < 3e-3, "{name}: {found:?} {expected:?}");
                assert!((found.1[axis] / expected.1[axis] - 1.0).abs() < 0.05, "{name}: {found:?} {expected:?}");
            }
            assert!((found.2 - expected.2).abs() < 0.006, "{name}: {found:?} {expected:?}");
        }
    }
}

/// Means, scales and opacities in the order of the means.
fn sorted(gaussians: &Gaussians) -> Vec<([f32; 3], [f32; 3], f32)> {
    let row = |i: usize| (gaussians.means()[i], gaussians.scales()[i], gaussians.opacities()[i]);
    let mut rows: Vec<_> = (0..gaussians.len()).map(row).collect();
    rows.sort_by(|a, b| a.partial_cmp(b).unwrap());
    rows
}

/// The file with another header.
fn changed(name: &str, change: impl FnOnce(&mut Value)) -> Vec<u8> {
    let bytes = fs::read(fixture(&format!("rad/{name}.rad"))).unwrap();
    let length = u32::from_le_bytes(bytes[4..8].try_into().unwrap()) as usize;
    let rest = &bytes[8 + length.next_multiple_of(8)..];
    let mut meta = serde_json::from_slice(&bytes[8..8 + length]).unwrap();
    change(&mut meta);
    let mut text = meta.to_string().into_bytes();
    let length = text.len() as u32;
    text.resize(text.len().next_multiple_of(8), 0);
    [b"RAD0", &length.to_le_bytes()[..], &text, rest].concat()
}

#[test]
fn inconsistent_rad_headers_are_refused() {
    type Change = fn(&mut Value);
    let cases: [(&str, Change, &str); 16] = [
        ("version", |m| m["version"] = json!(2), "RAD version 2 is not supported, only 1"),
        ("type", |m| m["type"] = json!("mesh"), "its type is 'mesh', and only gsplat is supported"),
        ("degree", |m| m["maxSh"] = json!(4), "SH degree 4 is not supported"),
        ("lower degree", |m| m["maxSh"] = json!(0), ""),
        ("count", |m| m["count"] = json!(78), "it has 79 Gaussians, expected 78"),
        ("chunks", |m| m["count"] = json!(65537), "65537 Gaussians are not 1 chunks of 65536"),
        ("size", |m| m["chunkSize"] = json!(10), "79 Gaussians are not 1 chunks of 10"),
        ("huge", |m| (m["count"], m["chunkSize"]) = (json!(u64::MAX), json!(u64::MAX)), "the header claims"),
        ("no degree", |m| m["maxSh"] = Value::Null, ""),
        ("no tree", |m| m["lodTree"] = Value::Null, ""),
        ("large chunks", |m| m["chunkSize"] = json!(1 << 25), "chunks of 33554432 Gaussians are not supported"),
        ("lie", |m| (m["count"], m["chunkSize"]) = (json!(1 << 24), json!(1 << 24)), "the file is truncated or its"),
        ("none", |m| (m["count"], m["chunks"]) = (json!(0), json!([])), "the scene holds no Gaussians"),
        ("bytes", |m| m["chunks"][0]["bytes"] = json!(1 << 20), "its content takes"),
        ("short", |m| m["chunks"][0]["bytes"] = json!(99), "of 99 of the chunk"),
        ("file", |m| m["chunks"][0]["filename"] = json!("../a.radc"), "is not the name of a file in the folder"),
    ];
    for (name, lie, expected) in cases {
        let read = parse(".rad", &changed("plush-default-lod", lie));
        match expected {
            "" => assert!(read.is_ok(), "{name}: {read:?}"),
            _ => {
                let problem = read.err().unwrap_or_else(|| panic!("{name} is read"));
                assert!(problem.contains(expected), "{name}: {problem}");
            }
        }
    }
    // A palette that is smaller than its labels.
    let problem = parse(".rad", &changed("plush-clusters-lod", |m| m["shCodeCount"] = json!(3))).unwrap_err();
    assert!(problem.contains("sh1_code does not hold 27 bytes"), "{problem}");
    // A chunk in a file of its own that is not there.
    let bytes = fs::read(fixture("rad/plush-chunked-lod.rad")).unwrap();
    let problem = parse(".rad", &bytes).unwrap_err();
    assert!(problem.contains("plush-chunked-lod-0.radc"), "{problem}");
    let problem = formats::read(fixture("rad/plush-chunked-lod-0.radc")).unwrap_err().to_string();
    assert!(problem.contains("not a scene that smalto reads"), "{problem}");
}

#[test]
fn properties_are_checked() {
    let whole = fs::read(fixture("rad/plush-default-lod.rad")).unwrap();
    for (from, to, expected) in [
        ("\"property\":\"alpha\"", "\"property\":\"gamma\"", "chunk 0: it has no alpha"),
        ("\"property\":\"child_count\"", "\"property\":\"child_counT\"", "chunk 0: it has no child_count"),
        (
            "\"encoding\":\"oct88r8\"",
            "\"encoding\":\"oct88r9\"",
            "the encoding 'oct88r9' of orientation is not supported",
        ),
        ("\"encoding\":\"f16\"", "\"encoding\":\"f32\"", "alpha does not hold 316 bytes"),
        ("\"compression\":\"gz\"", "\"compression\":\"xz\"", "is compressed by 'xz', and only gz is supported"),
        ("\"property\":\"sh2\"", "\"property\":\"sh9\"", "it has no sh2, and the file no palette"),
        ("\"version\":1,\"base\"", "\"version\":9,\"base\"", "its version is 9, and only 1 is supported"),
        ("\"min\":-1.0", "\"mim\":-1.0", ""),
        ("RADC", "RADX", "its header does not begin with RADC"),
    ] {
        let at = whole.windows(from.len()).position(|part| part == from.as_bytes()).expect(from);
        let bytes = [&whole[..at], to.as_bytes(), &whole[at + from.len()..]].concat();
        let problem = parse(".rad", &bytes).err().unwrap_or_default();
        // Signed bytes need no smallest value.
        assert!(problem.contains(expected) && problem.is_empty() == expected.is_empty(), "{to}: {problem}");
    }
}

#[test]
fn labels_lie_in_the_palette() {
    let mut text = fs::read(fixture("rad/plush-clusters-few16.rad")).unwrap();
    // The places of children as labels of a palette of 16.
    for (from, to) in [(&b"\"sh_label\""[..], &b"\"xx_label\""[..]), (b"\"child_start\"", b"\"sh_label\"   ")] {
        let at = text.windows(from.len()).position(|part| part == from).unwrap();
        text[at..at + from.len()].copy_from_slice(to);
    }
    let problem = parse(".rad", &text).unwrap_err();
    assert!(problem.contains("has palette entry") && problem.contains(", there are 16"), "{problem}");
}

#[test]
fn damage_is_no_panic() {
    for name in ["plush-default-lod", "plush-clusters-lod", "plush-enc-f16lebytes-r8-s8delta"] {
        table::survives_damage(".rad", &fs::read(fixture(&format!("rad/{name}.rad"))).unwrap(), 50);
    }
}
