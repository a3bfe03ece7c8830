//! The `smalto` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    smalto::cli::run()
}
