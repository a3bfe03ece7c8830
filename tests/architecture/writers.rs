//! Files are written by `files` alone, which writes them whole or not at all, and read whole by it alone, which limits
//! their size. Threads are started by `threads` alone, where a thread that the system refuses is an error.

use crate::{code, is_test, program, sources};

/// What makes, writes, moves or removes a file, or reads a whole one.
const WORDS: [&str; 11] = [
    "File::create",
    "File::options",
    "OpenOptions",
    "fs::read(",
    "fs::read_to_string(",
    "fs::write(",
    "fs::copy(",
    "fs::rename(",
    "fs::remove_file(",
    "fs::remove_dir_all(",
    "tempfile::",
];

/// Files that may: a record that was begun in vain is removed, and so are the textures that a new `meta.json` no longer
/// names, and the socket of a window; files of the system and shaders are read.
const EXCEPTIONS: [(&str, &str); 6] = [
    ("cli/render/resume.rs", "fs::remove_file("),
    ("formats/sog/folder.rs", "fs::remove_file("),
    ("viewer/remote/control.rs", "fs::remove_file("),
    ("cli/interrupt.rs", "fs::read_to_string("),
    ("measure/bench/machine.rs", "fs::read_to_string("),
    ("gpu/glsl.rs", "fs::read_to_string("),
];

/// What starts threads, or pools of them.
const THREADS: [&str; 4] = ["thread::spawn", "thread::scope", "thread::Builder", "ThreadPoolBuilder"];

/// The places outside of `files`, `threads` and tests where these sources do so, one line each.
fn violations(sources: &[(String, String)]) -> Vec<String> {
    let mut found = Vec::new();
    for (name, text) in sources.iter().filter(|(name, _)| !is_test(name)) {
        let code = code(text);
        let program = program(&code);
        let is_excepted = |word: &str| EXCEPTIONS.contains(&(name.as_str(), word));
        for word in WORDS.iter().filter(|word| program.contains(*word) && !is_excepted(word)) {
            if !name.starts_with("files/") {
                found.push(format!("{name}: `{word}` outside of files"));
            }
        }
        for word in THREADS.iter().filter(|word| name != "threads.rs" && program.contains(*word)) {
            found.push(format!("{name}: `{word}` outside of threads"));
        }
    }
    found
}

#[test]
fn files_and_threads_have_one_module_each() {
    assert_eq!(violations(&sources()), Vec::<String>::new());
}

#[test]
fn a_writer_elsewhere_is_found() {
    let source = |name: &str, text: &str| vec![(name.to_owned(), text.to_owned())];
    assert_eq!(
        violations(&source("cli/a.rs", "std::fs::write(path, text)?;")),
        ["cli/a.rs: `fs::write(` outside of files"]
    );
    assert_eq!(
        violations(&source("cli/a.rs", "std::thread::spawn(|| 1);")),
        ["cli/a.rs: `thread::spawn` outside of threads"]
    );
    assert_eq!(
        violations(&source("cli/a.rs", "#[cfg(test)]\nmod tests { fs::write(path, text); }")),
        Vec::<String>::new()
    );
}
