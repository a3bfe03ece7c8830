//! Streamed SOG as `smalto lod` writes it: its levels, its leaves, and what becomes of files that are there.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::{Value, json};
use smalto::formats::Reading;
use smalto::scene::Gaussians;

use crate::common::program::{fails, ok, path};
use crate::common::table::read;

/// A scene of two parts.
const SCENE: &str = "cactus:40000";

fn level(folder: &Path, level: u32) -> Gaussians {
    Reading { level: Some(level), ..Reading::default() }.read(folder).unwrap().gaussians
}

fn lod_meta(folder: &Path) -> Value {
    serde_json::from_slice(&fs::read(folder.join("lod-meta.json")).unwrap()).unwrap()
}

/// The leaves of a tree. The box of every node holds the boxes of its children.
fn leaves<'n>(node: &'n Value, found: &mut Vec<&'n Value>) {
    let Some(children) = node["children"].as_array() else { return found.push(node) };
    assert_eq!(children.len(), 2);
    for child in children {
        assert!(holds(node, &corner(child, "min"), 0.0) && holds(node, &corner(child, "max"), 0.0));
        leaves(child, found);
    }
}

fn corner(node: &Value, name: &str) -> [f64; 3] {
    std::array::from_fn(|axis| node["bound"][name][axis].as_f64().unwrap())
}

fn holds(node: &Value, point: &[f64; 3], margin: f64) -> bool {
    let [min, max] = ["min", "max"].map(|name| corner(node, name));
    (0..3).all(|axis| (min[axis] - margin..=max[axis] + margin).contains(&point[axis]))
}

/// Every level represents the whole scene, and the ranges of the leaves cover its files.
#[test]
fn leaves_name_all_gaussians_of_all_levels() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("new/levels of cactus");
    let said = ok(&["lod", SCENE, "-o", out.join("lod-meta.json").to_str().unwrap()]);
    assert!(said.contains("streamed SOG, 6 levels") && said.contains("SH degree 3"), "{said}");
    let meta = lod_meta(&out);
    let (counts, filenames) = (meta["counts"].as_array().unwrap(), meta["filenames"].as_array().unwrap());
    assert_eq!((&meta["version"], &meta["lodLevels"], counts.len()), (&json!(1), &json!(6), 6));
    assert_eq!(meta["count"].as_u64(), Some(counts.iter().map(|count| count.as_u64().unwrap()).sum()));
    let mut found = Vec::new();
    leaves(&meta["tree"], &mut found);
    assert_eq!(found.len(), 2);

    let mut ends = BTreeMap::new();
    for number in 0..6_u32 {
        let gaussians = level(&out, number);
        assert_eq!(Some(gaussians.len() as u64), counts[number as usize].as_u64());
        let most = 40_000 >> number;
        assert!(
            gaussians.len() <= most + 2 && gaussians.len() + most / 100 > most - 2,
            "{} of {most}",
            gaussians.len()
        );
        let mut next = 0;
        for leaf in &found {
            let range = &leaf["lods"][number.to_string()];
            let [file, offset, count] = ["file", "offset", "count"].map(|name| range[name].as_u64().unwrap());
            assert!(filenames[file as usize].as_str().unwrap().starts_with(&format!("levels/{number}_")));
            assert_eq!(ends.insert(file, offset + count).unwrap_or(0), offset, "ranges follow each other");
            // 16 bits for a mean in this scene are a millimetre at most.
            let own = &gaussians.means()[next..next + count as usize];
            assert!(own.iter().all(|mean| holds(leaf, &mean.map(f64::from), 1e-3)), "level {number}");
            next += count as usize;
        }
        assert_eq!(next, gaussians.len());
    }
    for (file, end) in ends {
        let unit = read(&out.join(filenames[file as usize].as_str().unwrap())).gaussians;
        assert_eq!(unit.len() as u64, end);
        assert_eq!(unit.sh_degree(), 3);
    }
}

/// The finest level is the scene as a SOG; a page file with levels gives the same bytes.
#[test]
fn the_finest_level_is_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let [pages, one, direct] = ["a.smalto", "one.sog", "direct/lod-meta.json"].map(|name| path(&folder, name));
    let from_pages = path(&folder, "pages/lod-meta.json");
    ok(&["convert", SCENE, &one]);
    ok(&["lod", SCENE, "-o", &pages]);
    ok(&["lod", SCENE, "-o", &direct]);
    ok(&["lod", &pages, "-o", &from_pages]);
    let [direct, from_pages] = ["direct", "pages"].map(|name| folder.path().join(name));
    assert_eq!(lod_meta(&direct), lod_meta(&from_pages));
    let textures = |folder: &Path| fs::read(folder.join("levels/3_0/sh0.webp")).unwrap();
    assert!(textures(&direct) == textures(&from_pages));
    let sorted = |gaussians: &Gaussians| {
        let mut rows: Vec<_> = gaussians.means().iter().zip(gaussians.opacities()).map(|(m, o)| (*m, *o)).collect();
        rows.sort_by(|(a, _), (b, _)| a.partial_cmp(b).unwrap());
        rows
    };
    // Textures of all Gaussians have the same steps.
    assert!(sorted(&level(&direct, 0)) == sorted(&read(Path::new(&one)).gaussians));
    let left: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left.len(), 4, "levels that were made for the output are removed: {left:?}");
}

#[test]
fn a_new_set_replaces_the_old_one_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "lod-meta.json");
    let entries = |below: &str| {
        let names = fs::read_dir(folder.path().join(below)).unwrap();
        let mut names: Vec<_> = names.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    };
    ok(&["lod", "cactus:3000", "-o", &out]);
    assert_eq!(entries(""), ["levels", "lod-meta.json"]);
    let kept = folder.path().join("levels/0_0/notes.txt");
    fs::write(&kept, "mine").unwrap();
    ok(&["lod", "cactus:2000", "-o", &out]);
    assert_eq!(entries(""), ["levels", "levels.1", "lod-meta.json"]);
    assert_eq!(entries("levels"), ["0_0"]);
    assert_eq!(entries("levels/0_0"), ["notes.txt"], "files of others stay");
    assert_eq!(level(folder.path(), 0).len(), 2000);
    fs::remove_file(kept).unwrap();
    fs::remove_dir_all(folder.path().join("levels")).unwrap();
    ok(&["lod", "cactus:1000", "-o", &out]);
    assert_eq!(entries(""), ["levels", "lod-meta.json"]);

    // A name that leads out of the folder is no reason to remove anything.
    let beside = path(&folder, "levels/0_0/meta.json");
    let inner = folder.path().join("inner");
    fs::create_dir(&inner).unwrap();
    fs::write(inner.join("lod-meta.json"), json!({ "filenames": ["../levels/0_0/meta.json"] }).to_string()).unwrap();
    ok(&["lod", "cactus:1000", "-o", inner.join("lod-meta.json").to_str().unwrap()]);
    assert!(Path::new(&beside).exists());
}

#[test]
fn wrong_wishes_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "lod-meta.json");
    for (wish, expected) in [
        (vec!["--level", "1"], "lod-meta.json holds all levels: leave out --level and --splats"),
        (vec!["--splats", "9"], "lod-meta.json holds all levels: leave out --level and --splats"),
        (vec!["--storage", "fast"], "--storage needs a .smalto file to write"),
    ] {
        let error = fails(2, &[vec!["lod", "cactus:1000", "-o", &out], wish].concat());
        assert!(error.contains(expected), "{error}");
    }
    let error = fails(2, &["convert", "cactus:1000", &out]);
    assert!(error.contains("a streamed SOG is written by `smalto lod`"), "{error}");
    assert!(fs::read_dir(folder.path()).unwrap().next().is_none());
    ok(&["lod", "cactus:1000", "-o", &out]);
    let same = fails(2, &["lod", folder.path().to_str().unwrap(), "-o", &out]);
    assert!(same.contains("is both the input and the output"), "{same}");
    let mut meta: serde_json::Value = serde_json::from_slice(&fs::read(&out).unwrap()).unwrap();
    meta["lodLevels"] = json!(4_000_000_000_u32);
    fs::write(&out, meta.to_string()).unwrap();
    let error = fails(4, &["info", &out]);
    assert!(error.contains("lod-meta.json claims 4000000000 levels, its tree has"), "{error}");
    // Where the folder cannot be made, nothing stays.
    let file = path(&folder, "file");
    fs::write(&file, "").unwrap();
    let error = fails(1, &["lod", "cactus:1000", "-o", &format!("{file}/lod-meta.json")]);
    assert!(error.contains("cannot make the folder") && error.lines().count() == 1, "{error}");
}
