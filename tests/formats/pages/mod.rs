//! Page files: every way of writing gives the same file, a file holds its scene, and damage is found.

mod damage;
mod levels;
mod writing;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use glam::{DQuat, DVec3};
use smalto::formats::Reading;
use smalto::options::{Options, Storage};
use smalto::packing::Statistics;
use smalto::pagefile::write::{Job, Settings, write_whole};
use smalto::pagefile::{PADDING, PAGE, PageFile, Pages};
use smalto::procedural::{Procedural, cactus};
use smalto::scene::{Gaussians, Scene, Transform, Watch};

use crate::common::free::{build, of_degree_4};
use crate::common::program::{fails, ok, path};
use smalto::formats;
use smalto::pagefile;

const PLUSH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/plush.ply");

const EXACT: Settings = Settings { options: Settings::LOSSLESS, memory: 64 << 20, has_levels: false, fit_rounds: 0 };

fn watch() -> Watch<'static> {
    Watch::NONE
}

fn job(output: &Path, settings: Settings) -> Job<'_> {
    Job::new(output, settings, "test")
}

fn read(path: impl AsRef<Path>) -> Gaussians {
    pagefile::read(&Reading::default(), path.as_ref(), &watch()).unwrap().gaussians
}

/// The bits of all values. Zeros of both signs are one for spherical harmonics, whose higher degrees are not stored
/// where they are 0.
fn bits(gaussians: &Gaussians) -> Vec<u32> {
    let floats = gaussians.means().as_flattened().iter().chain(gaussians.scales().as_flattened());
    let floats = floats.chain(gaussians.rotations().as_flattened()).chain(gaussians.opacities()).copied();
    floats.chain(gaussians.all_sh().as_flattened().iter().map(|value| value + 0.0)).map(f32::to_bits).collect()
}

fn scene_of(gaussians: Gaussians) -> Scene {
    Scene { gaussians, ..Scene::empty("test") }
}

/// All words of all pages.
fn words(pages: &Pages) -> (Vec<u32>, Vec<u32>) {
    let count = pages.pages().len();
    let mut geometry = vec![0; count * pages.geometry_words()];
    let mut colours = vec![0; count * pages.colour_words()];
    pages.read_geometry(0..count, &mut geometry).unwrap();
    pages.read_colours(0..count, &mut colours).unwrap();
    (geometry, colours)
}

fn of_file(path: &Path, options: &Options) -> Pages {
    Pages::of_file(Arc::new(PageFile::open(path).unwrap()), options)
}

fn of_memory(gaussians: &Gaussians, options: &Options) -> Pages {
    Pages::of_gaussians(Arc::new(gaussians.clone()), Statistics::of(gaussians), options)
}

#[test]
fn every_format_is_given_back_bit_by_bit() {
    let folder = tempfile::tempdir().unwrap();
    let mut files: Vec<PathBuf> = fs::read_dir(Path::new(PLUSH).parent().unwrap())
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.is_file() && path.extension().is_some_and(|ending| ending != "csv" && ending != "md"))
        .collect();
    files.sort();
    assert!(files.len() > 20, "{} files", files.len());
    for file in files {
        let out = path(&folder, "a.smalto");
        ok(&["convert", file.to_str().unwrap(), &out]);
        let expected = formats::read(&file).unwrap();
        let found = pagefile::read(&Reading::default(), out.as_ref(), &watch()).unwrap();
        assert!(bits(&found.gaussians) == bits(&expected.gaussians), "{}", file.display());
        assert_eq!((found.report, found.is_antialiased), (expected.report, expected.is_antialiased));
        assert_eq!(found.gaussians.sh_degree(), expected.gaussians.sh_degree(), "{}", file.display());
        let stored = PageFile::open(out.as_ref()).unwrap().header().statistics.clone();
        assert_eq!(stored, Statistics::of(&expected.gaussians), "{}", file.display());
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing else is left");
}

#[test]
fn words_are_the_same_from_a_file_and_from_memory() {
    let folder = tempfile::tempdir().unwrap();
    for gaussians in [cactus(5000).unwrap().gaussians, build(&of_degree_4(2500), 4)] {
        words_are_the_same(&folder.path().join("a.smalto"), &gaussians);
    }
}

fn words_are_the_same(out: &Path, gaussians: &Gaussians) {
    write_whole(&job(out, EXACT), &scene_of(gaussians.clone())).unwrap();
    let u8s = Options { sh_storage: Storage::U8, shape_storage: Storage::U8, sh_degree: 2, ..Options::BALANCED };
    for options in [Settings::LOSSLESS, Options::EXACT, Options::BALANCED, Options::FAST, Options::PREVIEW, u8s] {
        let (file, memory) = (of_file(out, &options), of_memory(gaussians, &options));
        assert_eq!(file.layout(), memory.layout());
        assert!(words(&file) == words(&memory), "{options:?}");
        for (page, exact) in file.pages().iter().zip(memory.pages()) {
            assert_eq!((page.low, page.high, page.count), (exact.low, exact.high, exact.count));
            let is_bound = page.reach >= exact.reach
                && page.largest_scale >= exact.largest_scale
                && page.highest_opacity >= exact.highest_opacity;
            assert!(is_bound, "{options:?}: {page:?} for {exact:?}");
        }
        assert_eq!(file.notice(), None);
    }
    // A file with loss has the words of the layout that it was written for.
    for options in [Options::BALANCED, Options::FAST, u8s] {
        write_whole(&job(out, Settings { options, ..EXACT }), &scene_of(gaussians.clone())).unwrap();
        assert!(words(&of_file(out, &options)) == words(&of_memory(gaussians, &options)), "{options:?}");
        let other = of_file(out, &Options::EXACT);
        assert!(other.notice().is_some(), "{options:?}");
    }
}

#[test]
fn threads_read_pages_at_the_same_time() {
    let folder = tempfile::tempdir().unwrap();
    let gaussians = cactus(10 * PAGE).unwrap().gaussians;
    let out = folder.path().join("a.smalto");
    write_whole(&job(&out, EXACT), &scene_of(gaussians)).unwrap();
    let pages = of_file(&out, &Options::BALANCED);
    let (geometry, colours) = words(&pages);
    std::thread::scope(|threads| {
        for thread in 0..4 {
            let (pages, geometry, colours) = (pages.clone(), &geometry, &colours);
            threads.spawn(move || {
                let each = [pages.geometry_words(), pages.colour_words()];
                for page in (0..40).map(|i| (i * 7 + thread) % 10) {
                    let [mut shapes, mut sh] = each.map(|words| vec![0; words]);
                    pages.read_geometry(page..page + 1, &mut shapes).unwrap();
                    pages.read_colours(page..page + 1, &mut sh).unwrap();
                    assert!(shapes == geometry[page * each[0]..][..each[0]]);
                    assert!(sh == colours[page * each[1]..][..each[1]]);
                }
            });
        }
    });
}

#[test]
fn pages_hold_each_gaussian_once_near_its_neighbours() {
    let gaussians = cactus(4 * PAGE + 100).unwrap().gaussians;
    let pages = of_memory(&gaussians, &Options::EXACT);
    assert_eq!(pages.pages().iter().map(|page| page.count).collect::<Vec<_>>(), [1024, 1024, 1024, 1024, 100]);
    let (geometry, _) = words(&pages);
    let mut found = Vec::new();
    for (page, words) in pages.pages().iter().zip(geometry.chunks_exact(pages.geometry_words())) {
        let ids = &words[words.len() - PAGE..];
        for (k, id) in ids.iter().enumerate() {
            let bounds = &words[4 * k..][..4];
            if *id == PADDING {
                assert_eq!(f32::from_bits(bounds[3]), -1.0, "padding is never drawn");
                continue;
            }
            let mean = gaussians.means()[*id as usize];
            assert_eq!(mean.map(f32::to_bits), bounds[..3]);
            assert!((0..3).all(|axis| (page.low[axis]..=page.high[axis]).contains(&mean[axis])));
            assert!(f32::from_bits(bounds[3] & 0xffff_0000) <= page.reach);
            found.push(*id);
        }
    }
    found.sort_unstable();
    assert_eq!(found, (0..gaussians.len() as u32).collect::<Vec<_>>());
}

#[test]
fn the_commands_read_page_files() {
    let folder = tempfile::tempdir().unwrap();
    let [out, again] = ["a.smalto", "again.ply"].map(|name| path(&folder, name));
    let said = ok(&["convert", PLUSH, &out, "--host-memory", "1MiB"]);
    assert!(said.contains("pages of PLY"), "{said}");
    ok(&["convert", &out, &again]);
    assert!(read(&again) == read(PLUSH));
    let piped =
        Command::new(env!("CARGO_BIN_EXE_smalto")).args(["info", "-"]).stdin(fs::File::open(&out).unwrap()).output();
    assert!(String::from_utf8(piped.unwrap().stdout).unwrap().starts_with("-: pages of PLY"));
    ok(&["convert", PLUSH, &out, "--storage", "balanced", "--min-opacity", "0.5", "--up", "y"]);
    let kept = read(&out);
    assert!(kept.len() < read(PLUSH).len() && kept.opacities().iter().all(|opacity| *opacity > 0.499));
    let error = fails(1, &["convert", PLUSH, "/dev/null", "--format", "smalto"]);
    assert!(error.contains("it is no regular file"), "{error}");
    let error = fails(2, &["convert", PLUSH, &again, "--storage", "fast"]);
    assert!(error.contains("--storage needs a .smalto file"), "{error}");
    let error = fails(1, &["convert", PLUSH, &out, "--no-clobber"]);
    assert!(error.contains("--no-clobber keeps what exists"), "{error}");
}

/// A stray Gaussian does not keep the others from being sorted.
#[test]
fn a_stray_gaussian_leaves_pages_small() {
    let ball = Procedural::parse("many-small:20480").unwrap().unwrap();
    let gaussians = ball.make().unwrap().gaussians;
    let far = gaussians.selected(&[0]).unwrap();
    let far = far.transformed(&Transform::new(DQuat::IDENTITY, DVec3::splat(1e9), 1.0).unwrap()).unwrap();
    let both = Gaussians::joined([&gaussians, &far].into_iter()).unwrap();
    let volume = |gaussians: &Gaussians| {
        let pages = of_memory(gaussians, &Options::EXACT);
        let mut all: Vec<f32> =
            pages.pages().iter().map(|page| (0..3).map(|i| page.high[i] - page.low[i]).product()).collect();
        all.sort_by(f32::total_cmp);
        all[all.len() / 2]
    };
    let (near, with_far) = (volume(&gaussians), volume(&both));
    assert!(with_far < 2.0 * near, "{with_far} for {near}");
}

#[test]
fn info_describes_a_page_file_without_its_pages() {
    let folder = tempfile::tempdir().unwrap();
    let out = path(&folder, "a.smalto");
    ok(&["convert", PLUSH, &out]);
    let of = |file: &str| -> serde_json::Value { serde_json::from_str(&ok(&["info", file, "--json", "-"])).unwrap() };
    let (pages, whole) = (of(&out), of(PLUSH));
    for field in ["gaussians", "sh_degree", "tally", "low", "high", "centre", "radius", "is_antialiased"] {
        assert_eq!(pages[field], whole[field], "{field}");
    }
    for field in ["sh_bounds", "sh_storage", "shape_storage", "brightest", "gpu_bytes", "depth_bits"] {
        assert_eq!(pages["required"][field], whole["required"][field], "{field}");
    }
    assert_eq!(pages["pages"]["bytes"], fs::metadata(&out).unwrap().len());
    assert!(ok(&["info", &out]).contains("pages       1 of 1024 Gaussians"));
}
