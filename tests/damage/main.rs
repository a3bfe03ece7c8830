//! Every reader against damaged files: no panic, no endless loop, no memory that the file cannot account for, and one
//! sentence. What can still be read is drawn as the reference draws it.
//!
//! `SMALTO_DAMAGE=100000 cargo test --release --test damage` runs so many files of each kind instead of the few of the
//! suite.

mod change;
#[path = "../common/mod.rs"]
mod common;
mod drawn;
#[path = "../common/peak.rs"]
mod peak;
mod subject;

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use common::Random;
use peak::Peak;
use subject::Subject;

#[global_allocator]
static MEMORY: Peak = Peak::new();

/// Damaged files of every kind.
const ROUNDS: usize = 100;
/// Bytes that a reader may use for any file, and for each byte of the file: buffers, threads, decompression.
const MEMORY_AT_LEAST: usize = 192 << 20;
const MEMORY_EACH: usize = 4096;
const LONGEST: Duration = Duration::from_secs(5);

/// Files of each kind to damage: `SMALTO_DAMAGE`, or else this many.
fn rounds(otherwise: usize) -> usize {
    std::env::var("SMALTO_DAMAGE").ok().and_then(|n| n.parse().ok()).unwrap_or(otherwise)
}

/// Keeps a file that broke a rule; returns its path.
fn kept(subject: &Subject, round: usize, bytes: &[u8]) -> String {
    let name = subject.damaged.file_name().unwrap().to_string_lossy();
    let path: PathBuf = std::env::temp_dir().join(format!("smalto-damage-{round}-{name}"));
    fs::write(&path, bytes).unwrap();
    format!("{} ({})", path.display(), subject.name)
}

#[test]
fn damaged_files_of_every_kind_are_read_or_refused() {
    let rounds = rounds(ROUNDS);
    let folder = tempfile::tempdir().unwrap();
    let subjects = subject::all(folder.path());
    assert!(subjects.len() > 60, "{} kinds", subjects.len());
    for subject in subjects {
        fs::write(&subject.damaged, &subject.whole).unwrap();
        (subject.reader)(&subject.opened).unwrap_or_else(|error| panic!("{} undamaged: {error}", subject.name));
        let mut random = Random(subject.whole.len() as u64);
        let (mut read, mut largest, mut longest) = (0, 0, Duration::ZERO);
        for round in 0..rounds {
            let bytes = subject.change.of(&subject.whole, &mut random);
            fs::write(&subject.damaged, &bytes).unwrap();
            let (before, started) = (MEMORY.reset(), Instant::now());
            let result = catch_unwind(AssertUnwindSafe(|| (subject.reader)(&subject.opened)));
            let (used, took) = (MEMORY.most() - before, started.elapsed());
            let keep = || kept(&subject, round, &bytes);
            match result {
                Err(_) => panic!("a panic: {}", keep()),
                Ok(Ok(())) => read += 1,
                Ok(Err(text)) => assert!(!text.contains('\n') && text.len() < 4000, "'{text}': {}", keep()),
            }
            assert!(used < MEMORY_AT_LEAST + MEMORY_EACH * bytes.len(), "{used} bytes: {}", keep());
            assert!(took < LONGEST, "{took:?}: {}", keep());
            (largest, longest) = (largest.max(used), longest.max(took));
        }
        println!("{}: {rounds} files, {read} read, at most {} MB and {longest:?}", subject.name, largest >> 20);
    }
}
