//! Damage of page files: flipped bits, cut files, changed numbers and failed reads are found.

use std::fs;

use smalto::formats::Reading;
use smalto::options::Options;
use smalto::pagefile::write::write_whole;
use smalto::pagefile::{PAGE, PageFile};
use smalto::procedural::cactus;
use smalto::scene::Unreadable;

use super::{EXACT, job, of_file, scene_of, watch};
use crate::common::program::{fails, ok, path};
use smalto::pagefile;

#[test]
fn every_flipped_byte_is_found_or_harmless() {
    let folder = tempfile::tempdir().unwrap();
    let gaussians = cactus(PAGE + 100).unwrap().gaussians;
    let out = folder.path().join("a.smalto");
    write_whole(&job(&out, EXACT), &scene_of(gaussians.clone())).unwrap();
    let whole = fs::read(&out).unwrap();
    let header = PageFile::open(&out).unwrap().header().clone();
    let table_end = pagefile::HEADER + header.pages() * 48;
    let mut found = 0;
    let places = (0..table_end).step_by(7).chain((table_end..whole.len()).step_by(997));
    for place in places {
        let mut bytes = whole.clone();
        bytes[place] ^= 0x10;
        fs::write(&out, &bytes).unwrap();
        match pagefile::read(&Reading::default(), &out, &watch()) {
            Ok(scene) => {
                assert!(scene.gaussians == gaussians, "byte {place} changes the scene");
                let is_gap = (table_end..header.geometry_at as usize).contains(&place) || place < 8;
                assert!(is_gap || place as u64 >= header.geometry_at, "byte {place} of {} is used", whole.len());
            }
            Err(error) => {
                assert!(place < 8 || error.is::<Unreadable>(), "byte {place}: {error:#}");
                found += 1;
            }
        }
    }
    assert!(found > 1000, "{found} found");
    for end in [0, 7, 100, 4095, 4096, 4100, table_end, header.geometry_at as usize, whole.len() - 1] {
        fs::write(&out, &whole[..end]).unwrap();
        let error = PageFile::open(&out).err().unwrap();
        assert!(error.is::<Unreadable>() && !format!("{error:#}").contains('\n'), "{end} bytes: {error:#}");
    }
    fs::write(&out, [&whole[..], &[0]].concat()).unwrap();
    assert!(PageFile::open(&out).is_err(), "one byte more");
}

#[test]
fn a_source_that_cannot_be_read_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let [source, out] = ["a.ply", "a.smalto"].map(|name| path(&folder, name));
    ok(&["convert", "cactus:100000", &source]);
    let bytes = fs::read(&source).unwrap();
    fs::write(&source, &bytes[..bytes.len() / 2]).unwrap();
    fails(4, &["convert", &source, &out]);
    fails(1, &["convert", "cactus:100", &path(&folder, "none/a.smalto")]);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn damage_of_a_page_is_named_by_page_and_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let gaussians = cactus(3 * PAGE).unwrap().gaussians;
    let out = folder.path().join("a.smalto");
    write_whole(&job(&out, EXACT), &scene_of(gaussians)).unwrap();
    let header = PageFile::open(&out).unwrap().header().clone();
    let mut bytes = fs::read(&out).unwrap();
    bytes[header.colours_at as usize + 2 * 4 * 48 * PAGE + 5] ^= 1;
    fs::write(&out, bytes).unwrap();
    let pages = of_file(&out, &Options::EXACT);
    let mut words = vec![0; 2 * pages.colour_words()];
    pages.read_colours(0..2, &mut words).unwrap();
    let error = format!("{:#}", pages.read_colours(1..3, &mut words).unwrap_err());
    let from = header.colours_at + 2 * 4 * 48 * PAGE as u64;
    let range = format!("the colours of page 2, bytes {from} to {}, are damaged", from + 4 * 48 * PAGE as u64);
    assert_eq!(error, format!("{}: {range}", out.display()));
}

#[test]
fn a_file_that_changes_while_it_is_open_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let gaussians = cactus(PAGE).unwrap().gaussians;
    let out = folder.path().join("a.smalto");
    write_whole(&job(&out, EXACT), &scene_of(gaussians)).unwrap();
    let pages = of_file(&out, &Options::EXACT);
    let mut words = vec![0; pages.geometry_words()];
    pages.read_geometry(0..1, &mut words).unwrap();
    let file = fs::File::options().write(true).open(&out).unwrap();
    file.set_modified(std::time::SystemTime::now() - std::time::Duration::from_secs(9)).unwrap();
    let error = pages.read_geometry(0..1, &mut words).unwrap_err();
    assert!(error.is::<Unreadable>() && error.to_string().ends_with("the file was changed while it was read"));
}

#[test]
fn a_page_that_cannot_be_read_is_exit_code_4() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "a.smalto");
    ok(&["convert", "cactus:3000", &out]);
    let smalto = |fault: &str| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_smalto"));
        let output = command.args(["convert", &out, &path(&folder, "b.ply")]).env("SMALTO_FAULT", fault).output();
        let output = output.unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    let (code, error) = smalto("page@2");
    assert_eq!(code, Some(4), "{error}");
    assert!(error.contains("the geometry of page 2, bytes") && error.contains("simulated fault"), "{error}");
    assert_eq!(smalto("page@3"), (Some(0), String::new()));
    assert_eq!(smalto("slow@1"), (Some(0), String::new()));
    assert_eq!(smalto("page@x").0, Some(2));
}
