//! Files are written by `files` alone, which writes them whole or not at all.

use crate::{code, is_test, program, sources};

/// What makes, writes, moves or removes a file.
const WORDS: [&str; 8] = [
    "File::create",
    "OpenOptions",
    "fs::write(",
    "fs::copy(",
    "fs::rename(",
    "fs::remove_file(",
    "fs::remove_dir_all(",
    "tempfile::",
];

/// Files that may: the record of a run, which is appended to, the textures that a new `meta.json` no longer names, and
/// the temporary copy of a scene from a pipe.
const EXCEPTIONS: [&str; 3] = ["cli/render/resume.rs", "formats/sog/folder.rs", "cli/scenes/piped.rs"];

/// The places outside of `files` and of tests where these sources write files, one line each.
fn violations(sources: &[(String, String)]) -> Vec<String> {
    let mut found = Vec::new();
    for (name, text) in sources.iter().filter(|(name, _)| !is_test(name)) {
        let code = code(text);
        let program = program(&code);
        let is_home = name.starts_with("files/") || EXCEPTIONS.contains(&name.as_str());
        for word in WORDS.iter().filter(|word| !is_home && program.contains(*word)) {
            found.push(format!("{name}: `{word}` outside of files"));
        }
    }
    found
}

#[test]
fn files_are_written_by_one_module() {
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
        violations(&source("cli/a.rs", "#[cfg(test)]\nmod tests { fs::write(path, text); }")),
        Vec::<String>::new()
    );
}
