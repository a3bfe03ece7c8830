//! The ways to write page files, also interrupted ones.

use std::fs;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use smalto::options::Options;
use smalto::packing::Statistics;
use smalto::pagefile::PageFile;
use smalto::pagefile::write::{Blocks, Finished, Job, Settings, Take, write_blocks, write_in_order, write_whole};
use smalto::procedural::{Procedural, cactus};
use smalto::scene::{Cancelled, Gaussians, Scene};

use super::{EXACT, bits, job, read, scene_of};
use crate::common::program::{ok, path};

/// A scene that comes in blocks of this size.
pub fn in_blocks(gaussians: &Gaussians, block: usize) -> impl Fn(&mut Take) -> anyhow::Result<Scene> + Sync {
    move |take: &mut Take| {
        for first in (0..gaussians.len()).step_by(block) {
            let indices: Vec<u32> = (first..gaussians.len().min(first + block)).map(|i| i as u32).collect();
            take(gaussians.selected(&indices)?, gaussians.len())?;
        }
        Ok(Scene::empty("test"))
    }
}

#[test]
fn every_way_of_writing_gives_the_same_file() {
    let folder = tempfile::tempdir().unwrap();
    let gaussians = cactus(30_000).unwrap().gaussians;
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
    let gaussians = cactus(20_000).unwrap().gaussians;
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
    let asked = AtomicUsize::new(0);
    let is_cancelled = || asked.fetch_add(1, Ordering::Relaxed) >= questions;
    let settings = Settings { memory: 2 << 20, ..EXACT };
    let job = Job { is_cancelled: &is_cancelled, ..job(output, settings) };
    write_blocks(&job, source, blocks, "")
}

#[test]
fn an_interrupted_conversion_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let gaussians = cactus(20_000).unwrap().gaussians;
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
    // Another source begins anew, also one of the same length and time, and so does one that was interrupted before
    // all were in buckets. The same content at another time is the same source.
    let cases = [(8 + 3, "as of another time", 0), (8 + 3, "AS OF ANOTHER TIME", 0), (8 + 3, "AS OF ANOTHER TIME", 3)];
    for (questions, text, resumed) in cases.into_iter().chain([(6, "AS OF ANOTHER TIME", 0)]) {
        interrupted(&out, &source, &blocks, questions).err().unwrap();
        let modified = fs::metadata(&source).unwrap().modified().unwrap();
        fs::write(&source, text).unwrap();
        let time = if resumed == 0 { modified } else { modified + std::time::Duration::from_secs(9) };
        fs::File::options().write(true).open(&source).unwrap().set_modified(time).unwrap();
        assert_eq!(interrupted(&out, &source, &blocks, usize::MAX).unwrap().resumed, resumed);
        assert!(fs::read(&whole).unwrap() == fs::read(&out).unwrap());
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3, "nothing is left");
}

#[test]
fn levels_go_on_where_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let gaussians = cactus(70_000).unwrap().gaussians;
    let [source, whole, out] = ["source", "whole.smalto", "out.smalto"].map(|name| folder.path().join(name));
    fs::write(&source, "as if").unwrap();
    let settings = Settings { has_levels: true, ..EXACT };
    write_whole(&job(&whole, settings), &scene_of(gaussians.clone())).unwrap();
    let blocks = in_blocks(&gaussians, 70_000);
    let kept = |name: &str| folder.path().join(".out.smalto.unfinished").join(name);
    let run = |is_cancelled: &(dyn Fn() -> bool + Sync)| {
        write_blocks(&Job { is_cancelled, ..job(&out, settings) }, &source, &blocks, "")
    };
    // Once some of the 18 blocks on the ground are written.
    let error = run(&|| (0..18).filter(|block| kept(&format!("top.{block}")).is_file()).count() >= 5).err().unwrap();
    assert!(error.is::<Cancelled>() && !out.exists());
    // A block that was not done may be half written.
    let lost = (0..18).find(|block| kept(&format!("top.{block}")).is_file()).unwrap();
    fs::remove_file(kept(&format!("top.{lost}"))).unwrap();
    let file = PageFile::open(&whole).unwrap();
    let page = 4 * file.words().geometry();
    let pages = fs::OpenOptions::new().write(true).open(kept("pages")).unwrap();
    pages.write_all_at(&vec![7; 2 * page], file.header().geometry_at + (4 * lost * page) as u64).unwrap();
    let finished = run(&|| false).unwrap();
    assert!((4..18).contains(&finished.resumed_levels), "{}", finished.resumed_levels);
    assert!(fs::read(&whole).unwrap() == fs::read(&out).unwrap());
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3, "nothing is left");
}

#[test]
fn a_killed_conversion_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let [source, whole, out] = ["a.ply", "whole.smalto", "out.smalto"].map(|name| path(&folder, name));
    ok(&["convert", "cactus:60000", &source]);
    ok(&["convert", &source, &whole]);
    let convert = || {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_smalto"));
        command.args(["convert", &source, &out, "--host-memory", "1MiB"]).stderr(std::process::Stdio::piped());
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

/// Prints how many Gaussians are written in a second.
#[test]
#[ignore = "needs minutes and a free machine"]
fn speed_of_writing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.smalto");
    let count = 1 << 20;
    let scene = Procedural::parse(&format!("many-small:{count}")).unwrap().unwrap().make().unwrap().gaussians;
    let blocks = |take: &mut Take| {
        (0..4).try_for_each(|_| take(scene.clone(), 4 * count))?;
        Ok(Scene::empty("test"))
    };
    for options in [Settings::LOSSLESS, Options::BALANCED] {
        let started = std::time::Instant::now();
        write_in_order(&job(&out, Settings { options, ..EXACT }), &blocks).unwrap();
        let each = started.elapsed().as_secs_f64() / (4 * count) as f64 * 1e9;
        println!("{each:.0} ns a Gaussian on {} threads", rayon::current_num_threads());
    }
}
