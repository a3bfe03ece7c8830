//! The ladder of optimizations: `smalto bench --ladder`, with the arguments given behind `--`.

use std::process::ExitCode;

fn main() -> ExitCode {
    // Cargo tells benches that they are run as such.
    let arguments = std::env::args().skip(1).filter(|argument| argument != "--bench");
    smalto::cli::run_from(["smalto", "bench", "--ladder"].map(str::to_owned).into_iter().chain(arguments))
}
