//! The program, run as its users run it.

use std::process::{Command, Output};

pub fn smalto(arguments: &[&str]) -> Output {
    run(arguments, |_| {})
}

pub fn run(arguments: &[&str], prepare: impl FnOnce(&mut Command)) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_smalto"));
    command.args(arguments).env("SMALTO_VALIDATION", "1").env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR"));
    prepare(&mut command);
    command.output().expect("the program starts")
}

/// Puts a command with its variables under these limits of `ulimit`.
pub fn limit(command: &mut Command, limits: &str) {
    let mut limited = Command::new("bash");
    limited.args(["-c", &format!("ulimit {limits} && exec \"$0\" \"$@\"")]);
    limited.arg(command.get_program()).args(command.get_args());
    for (name, value) in command.get_envs() {
        match value {
            Some(value) => limited.env(name, value),
            None => limited.env_remove(name),
        };
    }
    *command = limited;
}

/// Succeeds, and returns what it printed.
pub fn ok(arguments: &[&str]) -> String {
    let output = smalto(arguments);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {error}");
    String::from_utf8(output.stdout).unwrap()
}

/// Fails with this exit code; returns its sentence.
pub fn fails(code: i32, arguments: &[&str]) -> String {
    failed(smalto(arguments), code, arguments)
}

/// As [`fails`], within these limits of `ulimit`. Processor time (`-t`, seconds) hardly depends on what else runs.
pub fn fails_within(limits: &str, code: i32, arguments: &[&str]) -> String {
    failed(run(arguments, |command| limit(command, limits)), code, arguments)
}

fn failed(output: Output, code: i32, arguments: &[&str]) -> String {
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {error}");
    assert!(!error.contains("panicked"), "{error}");
    error
}

pub fn path(folder: &tempfile::TempDir, name: &str) -> String {
    folder.path().join(name).display().to_string()
}

/// What the program prints to stderr with these arguments, which it must not refuse.
pub fn notes(arguments: &[&str]) -> String {
    let output = smalto(arguments);
    let notes = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{arguments:?}: {notes}");
    notes
}
