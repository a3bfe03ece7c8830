//! Page files with levels of detail: they hold the scene, are the same whatever the way, and damage is found.

use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use serde_json::Value;
use smalto::options::{Options, Storage};
use smalto::scene::{Cancelled, Unreadable, synthetic};
use smalto::storage::convert::{Job, Settings, Take, write_blocks, write_in_order, write_whole};
use smalto::storage::{LEVEL_WORDS, PAGE, Page, PageFile};

use super::{EXACT, bits, job, of_file, read, scene_of};
use crate::common::program::{fails, ok, path};

const LEVELS: Settings = Settings { has_levels: true, ..EXACT };

#[test]
fn a_file_with_levels_holds_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    for count in [1, PAGE, PAGE + 1, 9 * PAGE + 17] {
        let gaussians = synthetic::cactus(count).unwrap().gaussians;
        for options in [Settings::LOSSLESS, Options::BALANCED] {
            let [plain, out] = ["plain.smalto", "a.smalto"].map(|name| folder.path().join(name));
            let settings = Settings { options, ..LEVELS };
            write_whole(&job(&plain, Settings { has_levels: false, ..settings }), &scene_of(gaussians.clone()))
                .unwrap();
            write_whole(&job(&out, settings), &scene_of(gaussians.clone())).unwrap();
            assert!(bits(&read(&out)) == bits(&read(&plain)), "{count}");
            let file = PageFile::open(&out).unwrap();
            let nodes = file.pages().iter().map(|page| page.count as usize).sum::<usize>();
            assert!(nodes >= count && nodes < 2 * count + PAGE, "{nodes} nodes of {count}");
            assert_eq!(file.levels().unwrap().len(), file.pages().len());
            // Without a wish for levels, there are the pages of the scene alone.
            assert_eq!(of_file(&out, &options).nodes(), count);
            let wanted = of_file(&out, &Options { splats: 1, ..options });
            assert_eq!((wanted.nodes(), wanted.level_words()), (nodes, LEVEL_WORDS * PAGE));
        }
    }
}

/// Scales that lie on a grid of 256 steps may have no step for a node, which is larger than all Gaussians.
#[test]
fn nodes_of_a_scene_of_bytes_are_as_large_as_they_must_be() {
    let folder = tempfile::tempdir().unwrap();
    let [source, out] = ["a.spz", "a.smalto"].map(|name| path(&folder, name));
    ok(&["convert", "many-small:9000", &source]);
    for storage in ["lossless", "balanced"] {
        ok(&["lod", &source, "-o", &out, "--storage", storage]);
        let file = PageFile::open(Path::new(&out)).unwrap();
        assert!(file.statistics().requirements.scale_grid.is_some(), "the scales of an .spz lie on a grid");
        assert_ne!(file.layout().shape.storage, Storage::U8, "{storage}");
        let (scene, nodes) = file.pages().split_at(file.header().scene_pages());
        let largest = |pages: &[Page]| pages.iter().map(|page| page.largest_scale).fold(0.0, f32::max);
        assert!(largest(nodes) > 3.0 * largest(scene), "{storage}: {} {}", largest(nodes), largest(scene));
        // So it is in the layout of every preset that draws levels.
        let exact = of_file(Path::new(&out), &Options { splats: 1, ..Options::EXACT });
        assert_ne!(exact.layout().shape.storage, Storage::U8, "{storage}");
    }
}

#[test]
fn all_ways_write_the_same_levels() {
    let folder = tempfile::tempdir().unwrap();
    let gaussians = synthetic::cactus(20_000).unwrap().gaussians;
    let names = ["source", "whole.smalto", "again.smalto", "blocks.smalto", "order.smalto"];
    let [source, whole, again, parts, ordered] = names.map(|name| folder.path().join(name));
    fs::write(&source, "source").unwrap();
    write_whole(&job(&whole, LEVELS), &scene_of(gaussians.clone())).unwrap();
    write_whole(&job(&again, LEVELS), &scene_of(gaussians.clone())).unwrap();
    let blocks = super::writing::in_blocks(&gaussians, 7777);
    write_blocks(&job(&parts, Settings { memory: 2 << 20, ..LEVELS }), &source, &blocks, "").unwrap();
    let expected = fs::read(&whole).unwrap();
    assert!(fs::read(&again).unwrap() == expected, "a second run");
    assert!(fs::read(&parts).unwrap() == expected, "in blocks");
    let all = |take: &mut Take| {
        take(gaussians.clone(), gaussians.len())?;
        Ok(smalto::scene::Scene::empty("test"))
    };
    write_in_order(&job(&ordered, LEVELS), &all).unwrap();
    assert!(bits(&read(&ordered)) == bits(&gaussians));
}

#[test]
fn an_interrupted_build_ends_with_the_same_file() {
    let folder = tempfile::tempdir().unwrap();
    let gaussians = synthetic::cactus(20_000).unwrap().gaussians;
    let [source, whole, out] = ["source", "whole.smalto", "out.smalto"].map(|name| folder.path().join(name));
    fs::write(&source, "source").unwrap();
    let settings = Settings { memory: 2 << 20, ..LEVELS };
    write_whole(&job(&whole, LEVELS), &scene_of(gaussians.clone())).unwrap();
    let blocks = super::writing::in_blocks(&gaussians, 7777);
    let mut interrupted = 0;
    for questions in 0.. {
        // The blocks of levels ask, too: the last interruptions are among them.
        let asked = AtomicUsize::new(0);
        let is_cancelled = || asked.fetch_add(1, Ordering::Relaxed) >= questions;
        let cancelled = Job { is_cancelled: &is_cancelled, ..job(&out, settings) };
        match write_blocks(&cancelled, &source, &blocks, "") {
            Err(problem) => assert!(problem.is::<Cancelled>(), "{problem:#}"),
            Ok(_) => break,
        }
        interrupted += 1;
        if interrupted % 3 == 0 {
            write_blocks(&job(&out, settings), &source, &blocks, "").unwrap();
            assert!(fs::read(&out).unwrap() == fs::read(&whole).unwrap(), "after {questions} questions");
            fs::remove_file(&out).unwrap();
        }
    }
    assert!(interrupted > 5, "{interrupted}");
}

#[test]
fn damage_of_levels_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.smalto");
    write_whole(&job(&out, LEVELS), &scene_of(synthetic::cactus(3 * PAGE).unwrap().gaussians)).unwrap();
    let whole = fs::read(&out).unwrap();
    let file = PageFile::open(&out).unwrap();
    let (parts, pages) = (file.header().levels.unwrap(), file.pages().len());
    let mut words = vec![0; pages * LEVEL_WORDS * PAGE];
    for place in (parts.words_at as usize..whole.len()).step_by(499) {
        let mut bytes = whole.clone();
        bytes[place] ^= 0x10;
        fs::write(&out, &bytes).unwrap();
        let outcome = PageFile::open(&out).and_then(|file| file.read_levels(0..pages, &mut words));
        let problem = outcome.expect_err("a byte of levels was changed");
        assert!(problem.is::<Unreadable>() && problem.to_string().contains("level"), "{place}: {problem:#}");
    }
    fs::write(&out, &whole).unwrap();
    PageFile::open(&out).unwrap().read_levels(0..pages, &mut words).unwrap();
}

#[test]
fn the_command_says_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let [out, plain] = ["a.smalto", "plain.smalto"].map(|name| path(&folder, name));
    let said = ok(&["lod", "cactus:3000", "-o", &out]);
    assert!(said.contains("3000 Gaussians"), "{said}");
    assert!(ok(&["info", &out]).contains("levels"));
    ok(&["convert", "cactus:3000", &plain]);
    let png = path(&folder, "a.png");
    let said = ok(&["render", &out, "--splats", "500", "--size", "64x48", "-o", &png]);
    assert!(said.contains("pages of the levels"), "{said}");
    let said = ok(&["render", &out, "--splats", "500", "--measure-levels", "--size", "64x48", "-o", &png]);
    assert!(said.contains("dB measured"), "{said}");
    let said = fails(2, &["render", &out, "--measure-levels", "--size", "64x48", "-o", &png]);
    assert!(said.contains("--measure-levels needs --splats"), "{said}");
    let bench = ["bench", &out, "--size", "32x24", "--warmup", "0", "--frames", "2", "--json", "-", "--splats", "500"];
    let report: Value = serde_json::from_str(&ok(&[&bench[..], &["--measure-levels"]].concat())).unwrap();
    let detail = &report["runs"][0]["detail"];
    assert!(detail["nodes"]["median"].as_f64().unwrap() <= 500.0, "{detail}");
    assert!(detail["measured_psnr"]["min"].as_f64().unwrap() > 15.0, "{detail}");
    let said = fails(2, &["render", &plain, "--splats", "500", "--size", "64x48", "-o", &png]);
    assert!(said.contains("smalto lod"), "{said}");
    assert!(fails(2, &["lod", "cactus:3000", "-o", &path(&folder, "a.ply")]).contains(".smalto"));
    fails(2, &["lod", "cactus:3000", "-o", &out, "--storage", "u8"]);
    fails(2, &["lod", &out, "-o", &out]);
}
