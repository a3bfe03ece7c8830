//! Every reader against damaged files: no panic, no endless loop, no memory that the file cannot account for, and one
//! sentence.
//!
//! `SMALTO_DAMAGE=100000 cargo test --release --test damage` runs so many files of each kind instead of the few of the
//! suite.

#[path = "../common/mod.rs"]
mod common;
#[path = "../common/peak.rs"]
mod peak;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use common::Random;
use peak::Peak;
use smalto::scene;

#[global_allocator]
static MEMORY: Peak = Peak::new();

/// Damaged files of every fixture.
const ROUNDS: usize = 150;
/// Bytes that a reader may use for any file, and for each byte of the file: buffers, threads, decompression.
const MEMORY_AT_LEAST: usize = 192 << 20;
const MEMORY_EACH: usize = 4096;
const LONGEST: Duration = Duration::from_secs(5);

fn fixtures() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let is_scene = |path: &PathBuf| {
        let endings = ["ply", "spz", "splat", "ksplat", "sog", "glb"];
        path.extension().is_some_and(|e| endings.iter().any(|ending| e == *ending))
    };
    let mut scenes: Vec<_> = files.filter(is_scene).collect();
    scenes.sort();
    scenes
}

/// Changes, cuts, doubles bytes or writes extreme numbers, mostly near the beginning, where headers are.
fn damaged(whole: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = whole.to_vec();
    for _ in 0..1 + random.below(6) {
        let reach = if random.below(2) == 0 { 256 } else { bytes.len() as u32 };
        let at = random.below(reach.min(bytes.len() as u32).max(1)) as usize;
        if bytes.is_empty() {
            break;
        }
        match random.below(8) {
            0 => bytes.truncate(at),
            1 => {
                let end = (at + 1 + random.below(64) as usize).min(bytes.len());
                let part = bytes[at..end].to_vec();
                bytes.splice(at..at, part);
            }
            2 => {
                let numbers = [0, 1, 0x7f, 0xff, 0x7fff, 0xffff, 0x7fff_ffff, u32::MAX, 1 << 30];
                let number = numbers[random.below(numbers.len() as u32) as usize].to_le_bytes();
                bytes[at..].iter_mut().zip(number).for_each(|(byte, value)| *byte = value);
            }
            3 => {
                let digits = b"9999999999";
                let length = 1 + random.below(9) as usize;
                bytes.splice(at..at, digits[..length].iter().copied());
            }
            4 => bytes[at] ^= 1 << random.below(8),
            _ => bytes[at] = random.below(256) as u8,
        }
    }
    bytes
}

#[test]
fn damaged_files_of_every_kind_are_read_or_refused() {
    let rounds = std::env::var("SMALTO_DAMAGE").ok().and_then(|n| n.parse().ok()).unwrap_or(ROUNDS);
    let folder = tempfile::tempdir().unwrap();
    let fixtures = fixtures();
    assert!(fixtures.len() > 20);
    for fixture in fixtures {
        let name = fixture.file_name().unwrap().to_string_lossy().into_owned();
        let whole = fs::read(&fixture).unwrap();
        let path = folder.path().join(&name);
        let mut random = Random(whole.len() as u64);
        let (mut read, mut largest, mut longest) = (0, 0, Duration::ZERO);
        for round in 0..rounds {
            let bytes = damaged(&whole, &mut random);
            fs::write(&path, &bytes).unwrap();
            let (before, started) = (MEMORY.reset(), Instant::now());
            let result = std::panic::catch_unwind(|| scene::read(&path, &|_| {}));
            let keep = || {
                let kept = std::env::temp_dir().join(format!("smalto-damage-{round}-{name}"));
                fs::write(&kept, &bytes).unwrap();
                kept.display().to_string()
            };
            match result {
                Err(_) => panic!("a panic: {}", keep()),
                Ok(Ok(_)) => read += 1,
                Ok(Err(error)) => {
                    let text = error.to_string();
                    assert!(!text.contains('\n') && text.len() < 1000, "'{text}': {}", keep());
                }
            }
            let (used, took) = (MEMORY.most() - before, started.elapsed());
            assert!(used < MEMORY_AT_LEAST + MEMORY_EACH * bytes.len(), "{used} bytes: {}", keep());
            assert!(took < LONGEST, "{took:?}: {}", keep());
            (largest, longest) = (largest.max(used), longest.max(took));
        }
        println!("{name}: {rounds} files, {read} read, at most {} MB and {longest:?}", largest >> 20);
    }
}
