//! Page files with levels of detail: they hold the scene, are the same whatever the way, and damage is found.

use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use serde_json::Value;
use smalto::measure::metrics::psnr;
use smalto::options::{Options, Storage};
use smalto::pagefile::write::{Job, Settings, Take, write_blocks, write_in_order, write_whole};
use smalto::pagefile::{LEVEL_WORDS, PAGE, Page, PageFile};
use smalto::pixels::Pixels;
use smalto::procedural::cactus;
use smalto::scene::{Cancelled, Unreadable};

use super::{EXACT, bits, job, of_file, read, scene_of};
use crate::common::program::{fails, ok, path};

const LEVELS: Settings = Settings { has_levels: true, ..EXACT };

#[test]
fn a_file_with_levels_holds_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    for count in [1, PAGE, PAGE + 1, 9 * PAGE + 17] {
        let gaussians = cactus(count).unwrap().gaussians;
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
            // Options without a limit of levels use the pages of the scene alone.
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
    let gaussians = cactus(20_000).unwrap().gaussians;
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
    let gaussians = cactus(20_000).unwrap().gaussians;
    let [source, whole, out] = ["source", "whole.smalto", "out.smalto"].map(|name| folder.path().join(name));
    fs::write(&source, "source").unwrap();
    let settings = Settings { memory: 2 << 20, ..LEVELS };
    write_whole(&job(&whole, LEVELS), &scene_of(gaussians.clone())).unwrap();
    let blocks = super::writing::in_blocks(&gaussians, 7777);
    let mut interrupted = 0;
    for questions in 0.. {
        // Groups of levels are also interrupted: among the last interruptions.
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
    write_whole(&job(&out, LEVELS), &scene_of(cactus(3 * PAGE).unwrap().gaussians)).unwrap();
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
fn a_level_is_a_scene_of_any_format() {
    let folder = tempfile::tempdir().unwrap();
    let [levels, plain, out, direct] =
        ["a.smalto", "plain.ply", "out.ply", "direct.ply"].map(|name| path(&folder, name));
    let count = 9 * PAGE + 17;
    let source = format!("cactus:{count}");
    ok(&["lod", &source, "-o", &levels]);
    let level = |wish: &[&str], out: &str| -> usize {
        let report = ok(&[&["lod", &levels, "-o", out, "--json", "-"], wish].concat());
        serde_json::from_str::<Value>(&report).unwrap()["gaussians"].as_u64().unwrap() as usize
    };
    // The finest level is the scene; the same Gaussians in the order of the pages.
    ok(&["convert", &source, &plain]);
    assert_eq!(level(&["--level", "0"], &out), count);
    let sorted = |file: &str| {
        let gaussians = smalto::formats::read(Path::new(file)).unwrap().gaussians;
        let mut means: Vec<[u32; 3]> = gaussians.means().iter().map(|mean| mean.map(f32::to_bits)).collect();
        means.sort_unstable();
        means
    };
    assert!(sorted(&out) == sorted(&plain));
    let picture = |file: &str| {
        let png = path(&folder, "a.png");
        ok(&["render", file, "--eye", "0,-1,-4", "--target", "0,0,0", "--size", "96x64", "--antialiased", "true"]
            .into_iter()
            .chain(["-o", &png])
            .collect::<Vec<_>>());
        Pixels::read(Path::new(&png)).unwrap()
    };
    let exact = picture(&plain);
    let mut before = f64::INFINITY;
    for (number, least_psnr) in [(1, 30.0), (2, 26.0), (3, 22.0)] {
        let found = level(&["--level", &number.to_string()], &out);
        assert!(found <= count >> number && found > (count >> number) * 9 / 10, "level {number}: {found}");
        let psnr = psnr(&exact, &picture(&out));
        assert!(psnr > least_psnr && psnr < before, "level {number}: {psnr} dB");
        before = psnr;
    }
    let found = level(&["--splats", "1000"], &path(&folder, "a.spz"));
    assert!((900..=1000).contains(&found), "{found}");
    // Straight from the source, levels are made and removed.
    ok(&["lod", &source, "--level", "3", "-o", &direct]);
    assert!(fs::read(&direct).unwrap() == fs::read(&out).unwrap());
    let names = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let rest: Vec<String> = names.filter(|name| name.contains("levels")).collect();
    assert!(rest.is_empty(), "{rest:?}");
    // A level as pages has no levels, and may have other number formats.
    let pages = path(&folder, "level.smalto");
    level(&["--level", "2", "--storage", "balanced"], &pages);
    assert!(PageFile::open(Path::new(&pages)).unwrap().levels().is_none());

    for scene in [&levels, &source] {
        let said = fails(2, &["lod", scene, "--splats", "3", "-o", &out]);
        assert!(said.contains(&format!("{scene}: the coarsest level has")), "{said}");
    }
    for (wrong, why) in [
        (&["--level", "1", "--splats", "9"][..], "--splats"),
        (&["--level", "1", "--storage", "balanced"], "--storage needs a .smalto file"),
        (&["--format", "ply"], "--format needs --level or --splats"),
        (&["--level", "33"], "--level"),
        (&["--level", "1", "--fit-rounds", "1"], "has levels already, and --fit-rounds is for new ones: leave it out"),
        (&["--level", "1", "--device", "host"], "has levels already, and --device is for new ones: leave it out"),
    ] {
        let said = fails(2, &[&["lod", &levels, "-o", &out], wrong].concat());
        assert!(said.contains(why), "{said}");
    }
    let fitted = path(&folder, "fitted.ply");
    let [merged, fitted] = [("0", &out), ("2", &fitted)].map(|(rounds, out)| {
        let on_host = ["--fit-rounds", rounds, "--device", "host"];
        ok(&[&["lod", &source, "--level", "1", "-o", out][..], &on_host].concat());
        read(Path::new(out))
    });
    assert!(fitted.len() <= count / 2 && fitted.len() > (count / 2) * 9 / 10, "{}", fitted.len());
    assert!(merged.scales() != fitted.scales());
    for rounds in ["0", "1"] {
        let [on_device, on_host] = ["0", "host"].map(|device| {
            let file = path(&folder, "fitted.smalto");
            ok(&["lod", "cactus:2000", "--fit-rounds", rounds, "-o", &file, "--device", device]);
            fs::read(file).unwrap()
        });
        assert!(on_device == on_host, "a device makes the same bytes");
    }
    let said = fails(3, &["lod", &source, "--level", "1", "--device", "no such device", "-o", &out]);
    assert!(said.contains("no such device"), "{said}");
    let said = fails(2, &["lod", &source, "--level", "1", "-o", "-", "--format", "ply"]);
    assert!(said.contains("standard output"), "{said}");
}

/// Errors are moved towards the mean of their level, and still never fall from children to parents.
#[test]
fn errors_of_a_level_are_alike() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.smalto");
    // Streets of small Gaussians, walls and ground of large ones.
    let town = smalto::procedural::Procedural::parse("town:40000").unwrap().unwrap().make().unwrap();
    write_whole(&job(&out, LEVELS), &scene_of(town.gaussians)).unwrap();
    let file = PageFile::open(&out).unwrap();
    let (scene, levels) = (file.header().scene_pages(), file.levels().unwrap());
    let parents: Vec<u16> =
        levels[..scene].iter().map(|level| level.parent_errors[level.parent_errors.len() / 2]).collect();
    let [least, most] = [parents.iter().min(), parents.iter().max()].map(|code| f64::from(*code.unwrap()) / 512.0);
    assert!(most - least < 5.0 && most > least, "{} powers of two", most - least);
    for (page, level) in levels.iter().enumerate().filter(|(_, level)| (level.parent as usize) < levels.len()) {
        assert!(level.errors.iter().zip(level.parent_errors).all(|(own, parent)| *own <= parent), "page {page}");
    }
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
    assert!(said.contains("pages of the levels, error"), "{said}");
    let said = ok(&["render", &out, "--splats", "1", "--size", "64x48", "-o", &png]);
    assert!(said.contains("page of the levels, there are no coarser ones"), "{said}");
    let said = ok(&["render", &out, "--splats", "500", "--measure-levels", "--size", "64x48", "-o", &png]);
    assert!(said.contains("dB to all Gaussians"), "{said}");
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
