//! Reading speed of scene files: `cargo bench --bench reading -- FILE...`. It prints the shortest time of five runs and
//! the peak of allocated memory.

#[path = "../tests/common/peak.rs"]
mod peak;

use std::path::Path;
use std::time::Instant;

use peak::Peak;
use smalto::formats;

#[global_allocator]
static MEMORY: Peak = Peak::new();

const RUNS: usize = 5;

fn main() {
    for file in std::env::args().skip(1).filter(|argument| !argument.starts_with("--")) {
        let path = Path::new(&file);
        let (mut shortest, mut gaussians) = (f64::INFINITY, 0);
        let before = MEMORY.reset();
        for _ in 0..RUNS {
            let started = Instant::now();
            gaussians = match formats::read(path) {
                Ok(scene) => scene.report.read,
                Err(error) => return eprintln!("{error}"),
            };
            shortest = shortest.min(started.elapsed().as_secs_f64());
        }
        let megabytes = std::fs::metadata(path).map_or(0.0, |data| data.len() as f64 / 1e6);
        println!(
            "{}  {gaussians} Gaussians in {shortest:.3} s: {:.2} million/s, {:.0} MB/s, at most {} MB allocated",
            path.file_name().unwrap_or_default().to_string_lossy(),
            gaussians as f64 / shortest / 1e6,
            megabytes / shortest,
            (MEMORY.most() - before) >> 20
        );
    }
}
