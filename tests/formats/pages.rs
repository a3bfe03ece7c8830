//! Page files: what is written is what was read, whatever the way, and damage is found.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DQuat, DVec3};
use smalto::options::{Options, Storage};
use smalto::scene::{self, Cancelled, Gaussians, Procedural, Reading, Scene, Transform, Unreadable, Watch, synthetic};
use smalto::storage::convert::{Blocks, Finished, Job, Settings, Take, write_blocks, write_in_order, write_whole};
use smalto::storage::{self, PADDING, PAGE, PageFile, Pages, Statistics};

use crate::common::program::{fails, ok, path};

const PLUSH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/plush.ply");

const EXACT: Settings = Settings { options: Settings::LOSSLESS, memory: 64 << 20 };

fn watch() -> Watch<'static> {
    Watch { progress: &|_| {}, partial: &|_| {}, is_cancelled: &|| false }
}

fn job(output: &Path, settings: Settings) -> Job<'_> {
    Job { output, settings, title: "test".to_owned(), progress: &|_| {}, is_cancelled: &|| false }
}

fn read(path: impl AsRef<Path>) -> Gaussians {
    storage::read(&Reading::default(), path.as_ref(), &watch()).unwrap().gaussians
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

/// A scene that comes in blocks of this size.
fn in_blocks(gaussians: &Gaussians, block: usize) -> impl Fn(&mut Take) -> anyhow::Result<Scene> + Sync {
    move |take: &mut Take| {
        for first in (0..gaussians.len()).step_by(block) {
            let indices: Vec<u32> = (first..gaussians.len().min(first + block)).map(|i| i as u32).collect();
            take(gaussians.selected(&indices)?, gaussians.len())?;
        }
        Ok(Scene::empty("test"))
    }
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
        let expected = scene::read(&file, &|_| {}).unwrap();
        let found = storage::read(&Reading::default(), out.as_ref(), &watch()).unwrap();
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
    let gaussians = synthetic::cactus(5000).unwrap().gaussians;
    let out = folder.path().join("a.smalto");
    write_whole(&job(&out, EXACT), &scene_of(gaussians.clone())).unwrap();
    let u8s = Options { sh_storage: Storage::U8, shape_storage: Storage::U8, sh_degree: 2, ..Options::BALANCED };
    for options in [Settings::LOSSLESS, Options::EXACT, Options::BALANCED, Options::FAST, Options::PREVIEW, u8s] {
        let (file, memory) = (of_file(&out, &options), of_memory(&gaussians, &options));
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
        write_whole(&job(&out, Settings { options, ..EXACT }), &scene_of(gaussians.clone())).unwrap();
        assert!(words(&of_file(&out, &options)) == words(&of_memory(&gaussians, &options)), "{options:?}");
        let other = of_file(&out, &Options::EXACT);
        assert!(other.notice().is_some(), "{options:?}");
    }
}

#[test]
fn pages_hold_each_gaussian_once_near_its_neighbours() {
    let gaussians = synthetic::cactus(4 * PAGE + 100).unwrap().gaussians;
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
fn every_way_of_writing_gives_the_same_file() {
    let folder = tempfile::tempdir().unwrap();
    let gaussians = synthetic::cactus(30_000).unwrap().gaussians;
    let source = folder.path().join("source");
    fs::write(&source, "as if").unwrap();
    let [whole, small] = ["whole.smalto", "small.smalto"].map(|name| folder.path().join(name));
    for options in [Settings::LOSSLESS, Options::BALANCED] {
        let settings = Settings { options, ..EXACT };
        write_whole(&job(&whole, settings), &scene_of(gaussians.clone())).unwrap();
        for (block, memory) in [(1 << 16, 1 << 30), (777, 4 << 20), (4096, 1 << 20)] {
            let blocks = in_blocks(&gaussians, block);
            let job = job(&small, Settings { memory, ..settings });
            let finished = write_blocks(&job, &source, &blocks, "").unwrap();
            assert_eq!(finished.buckets > 5, memory < 1 << 30, "{} buckets", finished.buckets);
            assert!(fs::read(&whole).unwrap() == fs::read(&small).unwrap(), "blocks of {block}, {memory} bytes");
        }
    }
}

#[test]
fn blocks_that_lie_apart_are_written_as_they_come() {
    let folder = tempfile::tempdir().unwrap();
    let gaussians = synthetic::cactus(20_000).unwrap().gaussians;
    let out = folder.path().join("a.smalto");
    for (block, options) in [(3000, Settings::LOSSLESS), (4096, Options::BALANCED), (500, Options::BALANCED)] {
        let blocks = in_blocks(&gaussians, block);
        write_in_order(&job(&out, Settings { options, ..EXACT }), &blocks).unwrap();
        let file = PageFile::open(&out).unwrap();
        assert_eq!(file.pages().len(), 20);
        assert_eq!(file.header().statistics, Statistics::of(&gaussians));
        let found = read(&out);
        if options == Settings::LOSSLESS {
            assert!(bits(&found) == bits(&gaussians));
        }
        assert_eq!(found.means(), gaussians.means());
    }
}

/// A job that is cancelled after some questions.
fn interrupted(output: &Path, source: &Path, blocks: &Blocks, questions: usize) -> anyhow::Result<Finished> {
    let asked = std::cell::Cell::new(0);
    let is_cancelled = || {
        asked.set(asked.get() + 1);
        asked.get() > questions
    };
    let settings = Settings { memory: 2 << 20, ..EXACT };
    let job = Job { is_cancelled: &is_cancelled, ..job(output, settings) };
    write_blocks(&job, source, blocks, "")
}

#[test]
fn an_interrupted_conversion_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let gaussians = synthetic::cactus(20_000).unwrap().gaussians;
    let [source, whole, out] = ["source", "whole.smalto", "out.smalto"].map(|name| folder.path().join(name));
    fs::write(&source, "as if").unwrap();
    write_whole(&job(&whole, EXACT), &scene_of(gaussians.clone())).unwrap();
    let blocks = in_blocks(&gaussians, 5000);
    // Four blocks in each of two passes, then three buckets.
    let error = interrupted(&out, &source, &blocks, 8 + 3).err().unwrap();
    assert!(error.is::<Cancelled>() && !out.exists());
    let finished = interrupted(&out, &source, &blocks, usize::MAX).unwrap();
    assert_eq!(finished.resumed, 3, "of {}", finished.buckets);
    assert!(fs::read(&whole).unwrap() == fs::read(&out).unwrap());
    // Another source begins anew, and so does one that was interrupted before all were in buckets.
    for (questions, source_text) in [(8 + 3, "as of another time"), (6, "as of another time")] {
        interrupted(&out, &source, &blocks, questions).err().unwrap();
        fs::write(&source, source_text).unwrap();
        assert_eq!(interrupted(&out, &source, &blocks, usize::MAX).unwrap().resumed, 0);
        assert!(fs::read(&whole).unwrap() == fs::read(&out).unwrap());
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3, "nothing is left");
}

#[test]
fn every_flipped_byte_is_found_or_harmless() {
    let folder = tempfile::tempdir().unwrap();
    let gaussians = synthetic::cactus(PAGE + 100).unwrap().gaussians;
    let out = folder.path().join("a.smalto");
    write_whole(&job(&out, EXACT), &scene_of(gaussians.clone())).unwrap();
    let whole = fs::read(&out).unwrap();
    let header = PageFile::open(&out).unwrap().header().clone();
    let table_end = storage::HEADER + header.pages() * 48;
    let mut found = 0;
    let places = (0..table_end).step_by(7).chain((table_end..whole.len()).step_by(997));
    for place in places {
        let mut bytes = whole.clone();
        bytes[place] ^= 0x10;
        fs::write(&out, &bytes).unwrap();
        match storage::read(&Reading::default(), &out, &watch()) {
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
fn damage_of_a_page_is_named_by_page_and_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let gaussians = synthetic::cactus(3 * PAGE).unwrap().gaussians;
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
    let gaussians = synthetic::cactus(PAGE).unwrap().gaussians;
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
fn the_commands_read_page_files() {
    let folder = tempfile::tempdir().unwrap();
    let [out, again] = ["a.smalto", "again.ply"].map(|name| path(&folder, name));
    let said = ok(&["convert", PLUSH, &out, "--memory", "1"]);
    assert!(said.contains("pages of PLY"), "{said}");
    ok(&["convert", &out, &again]);
    assert!(read(&again) == read(PLUSH));
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
fn a_killed_conversion_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let [source, whole, out] = ["a.ply", "whole.smalto", "out.smalto"].map(|name| path(&folder, name));
    ok(&["convert", "cactus:60000", &source]);
    ok(&["convert", &source, &whole]);
    let convert = || {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_smalto"));
        command.args(["convert", &source, &out, "--memory", "1"]).stderr(std::process::Stdio::piped());
        command.stdout(std::process::Stdio::null()).spawn().unwrap()
    };
    let mut killed = convert();
    let state = folder.path().join(".out.smalto.unfinished/state.json");
    let done = |text: String| serde_json::from_str::<serde_json::Value>(&text).ok()?["done"].as_u64();
    while fs::read_to_string(&state).ok().and_then(done).is_none_or(|done| done < 2) {
        assert!(killed.try_wait().unwrap().is_none(), "it ended before it was killed");
        std::thread::sleep(std::time::Duration::from_micros(200));
    }
    killed.kill().unwrap();
    killed.wait().unwrap();
    assert!(!Path::new(&out).exists());
    let output = convert().wait_with_output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && said.contains("buckets were sorted by an earlier run"), "{said}");
    assert!(fs::read(&whole).unwrap() == fs::read(&out).unwrap());
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
