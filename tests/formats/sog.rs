//! SOG: agreement with independent software, every container and version, and one clear sentence for every lie.

use std::fs;
use std::io::{Cursor, Read, Write};
use std::path::Path;

use crate::common::captured;
use crate::common::table::{self, SAME, Table, fixture, parse, parse_at, read};
use serde_json::{Value, json};
use smalto::formats;
use smalto::formats::Reading;
use smalto::scene::{Gaussians, Watch};
use tempfile::TempDir;

fn agrees_with_splat_transform(gaussians: &Gaussians, csv: &str) {
    table::agrees(csv, gaussians, &Table::read(&fixture(csv)), &SAME);
}

/// The files of a fixture in a folder of their own.
fn unpacked(name: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut archive = zip::ZipArchive::new(Cursor::new(fs::read(fixture(name)).unwrap())).unwrap();
    archive.extract(folder.path()).unwrap();
    folder
}

pub fn copied(name: &str) -> TempDir {
    fn copy(from: &Path, to: &Path) {
        for entry in fs::read_dir(from).unwrap().map(Result::unwrap) {
            let target = to.join(entry.file_name());
            if entry.path().is_dir() {
                fs::create_dir(&target).unwrap();
                copy(&entry.path(), &target);
            } else {
                fs::write(target, fs::read(entry.path()).unwrap()).unwrap();
            }
        }
    }
    let folder = tempfile::tempdir().unwrap();
    copy(&fixture(name), folder.path());
    folder
}

pub fn change(json: &Path, change: impl FnOnce(&mut Value)) {
    let mut value = serde_json::from_slice(&fs::read(json).unwrap()).unwrap();
    change(&mut value);
    fs::write(json, value.to_string()).unwrap();
}

#[test]
fn sog_agrees_with_splat_transform() {
    let scene = read(&fixture("plush.sog"));
    agrees_with_splat_transform(&scene.gaussians, "plush.sog.csv");
    assert_eq!(scene.format, "SOG 2");
}

/// The textures of plush.sog, whose bytes a `meta.json` of version 1 gives other meanings.
#[test]
fn sog_1_agrees_with_splat_transform() {
    let scene = read(&fixture("plush.v1/meta.json"));
    agrees_with_splat_transform(&scene.gaussians, "plush.v1.csv");
    assert_eq!(scene.format, "SOG 1");
}

#[test]
fn every_sog_container_holds_the_same_scene() {
    let expected = read(&fixture("plush.sog")).gaussians;
    assert_eq!(read(&fixture("plush.deflated.sog")).gaussians, expected);
    let folder = unpacked("plush.sog");
    assert_eq!(read(folder.path()).gaussians, expected);
    assert_eq!(read(&folder.path().join("meta.json")).gaussians, expected);
    assert_eq!(parse("", &fs::read(fixture("plush.sog")).unwrap()).unwrap().gaussians, expected);
}

#[test]
fn sog_is_read_at_every_sh_degree() {
    for degree in 0..2 {
        let gaussians = read(&fixture(&format!("plush.sh{degree}.sog"))).gaussians;
        assert_eq!((gaussians.sh_degree(), gaussians.len()), (degree, 61));
    }
    let folder = unpacked("plush.sog");
    change(&folder.path().join("meta.json"), |meta| meta["shN"]["bands"] = json!(0));
    assert_eq!(read(folder.path()).gaussians.sh_degree(), 0);
}

#[test]
fn antialiased_scenes_are_recognized() {
    let folder = unpacked("plush.sog");
    assert!(!read(folder.path()).is_antialiased);
    change(&folder.path().join("meta.json"), |meta| meta["antialias"] = json!(true));
    assert!(read(folder.path()).is_antialiased);
}

/// A repair as in PlayCanvas' engine: a mean step before the second.
#[test]
fn a_null_first_codebook_value_is_repaired() {
    let folder = unpacked("plush.sog");
    let (mut lost, mut second, mut last) = (0.0, 0.0, 0.0);
    change(&folder.path().join("meta.json"), |meta| {
        let book = &mut meta["sh0"]["codebook"];
        [lost, second, last] = [0, 1, 255].map(|i| book[i].as_f64().unwrap());
        book[0] = Value::Null;
    });
    let (whole, repaired) = (read(&fixture("plush.sog")).gaussians, read(folder.path()).gaussians);
    let mut changed = 0;
    for i in 0..whole.len() {
        for channel in 0..3 {
            let (before, after) = (whole.sh(i)[0][channel], repaired.sh(i)[0][channel]);
            if before == lost as f32 {
                table::close("repaired", after, second + (second - last) / 255.0, 1e-6);
                changed += 1;
            } else {
                assert_eq!(before, after);
            }
        }
    }
    assert!(changed > 0);
    // Any other lost value drops its Gaussians, and the report counts them.
    change(&folder.path().join("meta.json"), |meta| meta["sh0"]["codebook"] = json!([0.5]));
    assert!(parse_at(folder.path()).unwrap_err().contains("dropped as not finite"));
}

/// Level 0, then its environment.
#[test]
fn the_finest_level_of_a_streamed_sog_is_read() {
    let scene = read(&fixture("lod"));
    assert_eq!(scene.format, "streamed SOG, level 0 of 2");
    let (level, around) = (read(&fixture("lod/0_0")).gaussians, read(&fixture("lod/env/meta.json")).gaussians);
    assert_eq!((level.len(), around.len()), (305, 61));
    assert_eq!(scene.gaussians.means(), [level.means(), around.means()].concat());
    assert_eq!(scene.gaussians.rotations(), [level.rotations(), around.rotations()].concat());
    assert_eq!(read(&fixture("lod/lod-meta.json")).gaussians, scene.gaussians);

    // Files of different degrees in one scene: what one has not is zero.
    let folder = copied("lod");
    let mut archive = fs::File::create(folder.path().join("0_1.sog")).unwrap();
    archive.write_all(&fs::read(fixture("plush.sog")).unwrap()).unwrap();
    change(&folder.path().join("lod-meta.json"), |meta| {
        meta["filenames"] = json!(["0_0/meta.json", "1_0/meta.json", "0_1.sog"]);
        let children = meta["tree"]["children"].as_array_mut().unwrap();
        children.push(json!({ "lods": { "0": { "file": 2, "offset": 0, "count": 61 } } }));
    });
    let both = read(folder.path()).gaussians;
    assert_eq!((both.len(), both.sh_degree()), (305 + 61 + 61, 3));
    assert!(both.sh(0)[1..].iter().all(|k| *k == [0.0; 3]));
    let plush = read(&fixture("plush.sog")).gaussians;
    assert_eq!(both.sh(305 + 7), plush.sh(7));

    // Without level 0, the finest is 1.
    change(&folder.path().join("lod-meta.json"), |meta| {
        for child in meta["tree"]["children"].as_array_mut().unwrap() {
            child["lods"].as_object_mut().unwrap().remove("0");
        }
    });
    let coarse = read(folder.path());
    assert_eq!((coarse.gaussians.len(), coarse.format.as_str()), (122 + 61, "streamed SOG, level 1 of 2"));
}

#[test]
fn error_messages_escape_names_from_files() {
    let folder = copied("lod");
    for name in ["a\nb/meta.json".to_owned(), "\u{7}".repeat(5000), "a".repeat(100_000)] {
        change(&folder.path().join("lod-meta.json"), |meta| meta["filenames"][0] = json!(name));
        let problem = formats::read(folder.path()).unwrap_err().to_string();
        assert!(!problem.contains(char::is_control) && problem.len() < 4000, "{problem}");
    }
}

#[test]
fn a_level_of_a_streamed_sog_can_be_chosen() {
    let level = |path: &str, level| Reading { level: Some(level), ..Reading::default() }.read(&fixture(path));
    let coarse = level("lod", 1).unwrap();
    assert_eq!((coarse.gaussians.len(), coarse.format.as_str()), (122 + 61, "streamed SOG, level 1 of 2"));
    assert_eq!(coarse.gaussians.means()[..122], *read(&fixture("lod/1_0")).gaussians.means());
    assert_eq!(level("lod", 0).unwrap().gaussians, read(&fixture("lod")).gaussians);
    let refused = |path, number| level(path, number).unwrap_err().to_string();
    assert!(refused("lod", 2).ends_with("there is no level 2 in lod-meta.json, only 0, 1"), "{}", refused("lod", 2));
    for path in ["plush.ply", "plush.sog", "plush.v1", "plush.v1/meta.json", "plush.glb"] {
        assert!(refused(path, 0).contains("there are no numbered levels of detail"), "{}", refused(path, 0));
    }
}

/// A change of `meta.json`, and the error message.
#[test]
fn inconsistent_meta_json_is_refused() {
    type Change = fn(&mut Value);
    let cases: Vec<(&str, Change, &str)> = vec![
        ("version", |m| m["version"] = json!(3), "SOG version 3 is not supported"),
        ("count", |m| m["count"] = json!(81), "means_l.webp is 8x8 texels large, expected 81 to"),
        ("huge count", |m| m["count"] = json!(u64::MAX), "claims 18446744073709551615 Gaussians, textures of"),
        ("small count", |m| m["count"] = json!(0), "the scene holds no Gaussians"),
        ("no count", |m| drop(m.as_object_mut().unwrap().remove("count")), "does not say how many"),
        ("text", |m| m["count"] = json!("many"), "meta.json is not that of a SOG scene: invalid type"),
        ("no means", |m| drop(m.as_object_mut().unwrap().remove("means")), "neither means"),
        ("no scales", |m| drop(m.as_object_mut().unwrap().remove("scales")), "missing field `scales`"),
        ("file", |m| m["quats"]["files"] = json!(["no.webp"]), "no.webp: cannot be opened: there is no such file"),
        ("outside", |m| m["quats"]["files"] = json!(["../meta.json"]), "'../meta.json' is not the name"),
        ("absolute", |m| m["quats"]["files"] = json!(["/etc/hostname"]), "is not the name"),
        ("not an image", |m| m["quats"]["files"] = json!(["meta.json"]), "meta.json is not a WebP image"),
        ("codebook", |m| m["scales"]["codebook"] = json!([]), "scales in meta.json: the codebook has 0 values"),
        ("no codebook", |m| m["scales"]["codebook"] = Value::Null, "no codebook, nor a smallest"),
        ("bands", |m| m["shN"]["bands"] = json!(2), "960 texels wide, as of SH degree 3, but meta.json says 2 bands"),
        ("palette", |m| m["shN"]["count"] = json!(65), "claims 65 palette entries"),
        ("labels", |m| m["shN"]["count"] = json!(5), "has palette entry"),
        ("swapped", |m| m["shN"]["files"] = json!(["shN_labels.webp", "shN_centroids.webp"]), "8 texels wide, 192"),
    ];
    for (name, lie, expected) in cases {
        let folder = unpacked("plush.sog");
        change(&folder.path().join("meta.json"), lie);
        let problem = parse_at(&folder.path().join("meta.json")).expect_err(name);
        assert!(problem.contains(expected), "{name}: {problem}");
    }
}

#[test]
fn inconsistent_lod_meta_json_is_refused() {
    type Change = fn(&mut Value);
    let cases: Vec<(&str, Change, &str)> = vec![
        (
            "file",
            |m| [0, 1].map(|i| m["tree"]["children"][i]["lods"]["0"]["file"] = json!(9)).into_iter().collect(),
            "names file 9 of 2",
        ),
        ("count", |m| m["tree"]["children"][0]["lods"]["0"]["count"] = json!(1), "of which lod-meta.json assigns 143"),
        ("no file", |m| m["filenames"][0] = json!("no/meta.json"), "no/meta.json: "),
        ("outside", |m| m["filenames"][0] = json!("../lod/0_0/meta.json"), "is not the name of a file in the folder"),
        ("environment", |m| m["environment"] = json!("lod-meta.json"), "missing field `means`"),
        ("empty", |m| m["tree"] = json!({}), "has no Gaussians"),
    ];
    for (name, lie, expected) in cases {
        let folder = copied("lod");
        change(&folder.path().join("lod-meta.json"), lie);
        let problem = parse_at(folder.path()).expect_err(name);
        assert!(problem.contains(expected), "{name}: {problem}");
    }
    // The same file again and again would be a scene of any size.
    let folder = copied("lod");
    change(&folder.path().join("lod-meta.json"), |meta| {
        meta["filenames"][1] = json!("0_0/meta.json");
        let leaf = json!({ "lods": { "0": { "file": 1, "offset": 0, "count": 305 } } });
        meta["tree"]["children"].as_array_mut().unwrap().push(leaf);
    });
    assert!(parse_at(folder.path()).unwrap_err().contains("names 0_0/meta.json twice"));
    // Nor is a deep tree a deep recursion.
    let depth = 100_000;
    let deep = [r#"{"filenames":[],"tree":"#, &r#"{"children":["#.repeat(depth), &"]}".repeat(depth), "}"].concat();
    assert!(parse(".json", deep.as_bytes()).unwrap_err().contains("recursion limit exceeded"));
}

/// A zip archive of these files, deflated.
fn deflated(files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
    for (name, bytes) in files {
        archive.start_file(*name, options).unwrap();
        archive.write_all(bytes).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

/// An image of one colour, which takes few bytes.
fn plain(width: u32, height: u32) -> Vec<u8> {
    let mut webp = Vec::new();
    let bytes = vec![0; 3 * (width * height) as usize];
    image_webp::WebPEncoder::new(&mut webp).encode(&bytes, width, height, image_webp::ColorType::Rgb8).unwrap();
    webp
}

#[test]
fn compression_bombs_are_refused_before_they_are_inflated() {
    let zeros = vec![0; 20 << 20];
    let bomb = deflated(&[("meta.json", &zeros)]);
    assert!(bomb.len() < 100_000);
    assert!(parse(".sog", &bomb).unwrap_err().contains("meta.json has over 16777216 bytes"));

    // An image that has many more texels than the scene Gaussians, and one that is far too large a file.
    let folder = unpacked("plush.sog");
    fs::write(folder.path().join("scales.webp"), plain(400, 400)).unwrap();
    let problem = parse_at(folder.path()).unwrap_err();
    assert!(problem.contains("scales.webp is 400x400 texels large, expected 61 to 65658"), "{problem}");
    fs::write(folder.path().join("scales.webp"), &zeros).unwrap();
    let problem = parse_at(folder.path()).unwrap_err();
    assert!(problem.contains("scales.webp: it has 20971520 bytes, expected at most"), "{problem}");
    let folder = unpacked("plush.sog");
    fs::write(folder.path().join("shN_centroids.webp"), plain(960, 1100)).unwrap();
    let problem = parse_at(folder.path()).unwrap_err();
    assert!(problem.contains("960x1100 texels large"), "{problem}");
}

#[test]
fn damaged_archives_are_refused_in_one_sentence() {
    let whole = fs::read(fixture("plush.sog")).unwrap();
    let mut files = Vec::new();
    let mut archive = zip::ZipArchive::new(Cursor::new(&whole)).unwrap();
    for i in 0..archive.len() {
        let mut file = archive.by_index(i).unwrap();
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).unwrap();
        files.push((file.name().unwrap().into_owned(), bytes));
    }
    let without = |missing: &str| {
        let rest: Vec<_> =
            files.iter().filter(|(n, _)| n != missing).map(|(n, b)| (n.as_str(), b.as_slice())).collect();
        deflated(&rest)
    };
    let at = whole.windows(4).position(|bytes| bytes == b"VP8L").unwrap();
    let mut damaged = whole.clone();
    damaged[at + 60] ^= 0xff;
    let cases: [(&str, Vec<u8>, &str); 6] = [
        ("magic only", whole[..4].to_vec(), "the zip archive cannot be read"),
        ("cut", whole[..whole.len() - 30].to_vec(), "the zip archive cannot be read"),
        ("empty", deflated(&[("readme.txt", b"hello")]), "the zip archive has no meta.json"),
        ("no texture", without("sh0.webp"), "the zip archive has no sh0.webp"),
        ("no palette", without("shN_centroids.webp"), "the zip archive has no shN_centroids.webp"),
        ("checksum", damaged, "means_l.webp cannot be unpacked"),
    ];
    for (name, bytes, expected) in cases {
        let problem = parse(".sog", &bytes).expect_err(name);
        assert!(problem.contains(expected), "{name}: {problem}");
    }
}

#[test]
fn files_with_random_damage_never_panic() {
    table::survives_damage(".sog", &fs::read(fixture("plush.sog")).unwrap(), 50);
    table::survives_damage(".sog", &fs::read(fixture("plush.deflated.sog")).unwrap(), 50);
    // Past the checksums of an archive, in the textures themselves.
    let folder = unpacked("plush.sog");
    let mut random = crate::common::Random(5);
    for name in ["means_l.webp", "quats.webp", "shN_centroids.webp", "shN_labels.webp", "meta.json"] {
        let whole = fs::read(folder.path().join(name)).unwrap();
        for _ in 0..60 {
            let mut bytes = whole.clone();
            for _ in 0..1 + random.below(3) {
                bytes[random.below(whole.len() as u32) as usize] = random.bits() as u8;
            }
            fs::write(folder.path().join(name), bytes).unwrap();
            let _ = parse_at(folder.path());
        }
        fs::write(folder.path().join(name), whole).unwrap();
    }
}

#[test]
fn progress_goes_from_the_beginning_to_the_end() {
    for name in ["plush.sog", "plush.v1", "lod"] {
        let seen = std::cell::RefCell::new(Vec::new());
        smalto::formats::read_watched(fixture(name), &Watch::of_progress(&|fraction| seen.borrow_mut().push(fraction)))
            .unwrap();
        let seen = seen.into_inner();
        assert!(seen.is_sorted() && seen.iter().all(|f| (0.0..=1.0).contains(f)), "{name}: {seen:?}");
        assert_eq!(seen.last(), Some(&1.0), "{name}");
    }
}

/// A captured scene, and what splat-transform made of it as SPZ: 12 bits behind the point, scales in steps of 1/16 of
/// their logarithm.
#[test]
#[ignore = "needs the captured scenes (SMALTO_TEST_SCENES)"]
fn a_captured_sog_is_the_spz_made_of_it() {
    let [sog, spz] = ["playbot.sog", "playbot.spz"].map(|name| read(&captured(name)).gaussians);
    assert_eq!((sog.len(), sog.sh_degree()), (spz.len(), spz.sh_degree()));
    for i in 0..sog.len() {
        for axis in 0..3 {
            table::close("mean", sog.means()[i][axis], spz.means()[i][axis].into(), 1.3e-4);
            let ratio = sog.scales()[i][axis] / spz.scales()[i][axis];
            table::close("scale", ratio.ln(), 0.0, 0.5 / 16.0 + 1e-3);
        }
        table::close("opacity", sog.opacities()[i], spz.opacities()[i].into(), 1.5 / 255.0);
        let dot: f32 = sog.rotations()[i].iter().zip(spz.rotations()[i]).map(|(a, b)| a * b).sum();
        assert!(dot.abs() > 0.9999, "{i}: {dot}");
    }
}
