//! The ladder of optimizations: runs `smalto bench --ladder` with the arguments after `--`.

use std::process::ExitCode;

fn main() -> ExitCode {
    // Cargo adds `--bench` to the arguments of benches.
    let arguments = std::env::args().skip(1).filter(|argument| argument != "--bench");
    smalto::cli::run_as_program(["smalto", "bench", "--ladder"].map(str::to_owned).into_iter().chain(arguments))
}
