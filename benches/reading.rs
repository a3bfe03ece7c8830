//! How fast scene files are read: `cargo bench --bench reading -- FILE...`. Seconds are the least of five runs, memory the most
//! that was held at once.

#[path = "../tests/common/peak.rs"]
mod peak;

use std::path::Path;
use std::time::Instant;

use peak::Peak;
use smalto::scene;

#[global_allocator]
static MEMORY: Peak = Peak::new();

const RUNS: usize = 5;

fn main() {
    for file in std::env::args().skip(1).filter(|argument| !argument.starts_with("--")) {
        let path = Path::new(&file);
        let (mut least, mut gaussians) = (f64::INFINITY, 0);
        let before = MEMORY.reset();
        for _ in 0..RUNS {
            let started = Instant::now();
            gaussians = match scene::read(path, &|_| {}) {
                Ok(scene) => scene.tally.read,
                Err(error) => return eprintln!("{error}"),
            };
            least = least.min(started.elapsed().as_secs_f64());
        }
        let megabytes = std::fs::metadata(path).map_or(0.0, |data| data.len() as f64 / 1e6);
        println!(
            "{}  {gaussians} Gaussians in {least:.3} s: {:.2} million/s, {:.0} MB/s, {} MB held at most",
            path.file_name().unwrap_or_default().to_string_lossy(),
            gaussians as f64 / least / 1e6,
            megabytes / least,
            (MEMORY.most() - before) >> 20
        );
    }
}
