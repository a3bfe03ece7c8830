//! What the sources promise of themselves: who may know whom, who writes files, no circles, files that are short and
//! wrapped.

mod circles;
mod imports;
mod layers;
mod shader_numbers;
mod text;
mod writers;

use std::fs;
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// All files with this ending in a folder of the checkout and in the folders inside it.
fn files(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path, ending));
        } else if path.extension().is_some_and(|e| e == ending) {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// The Rust sources of the crate: paths below `src`, with `/` between folders, and their text.
fn sources() -> Vec<(String, String)> {
    let src = root().join("src");
    let named = |path: PathBuf| {
        let name = path.strip_prefix(&src).unwrap().display().to_string().replace('\\', "/");
        (name, fs::read_to_string(&path).unwrap())
    };
    files(&src, "rs").into_iter().map(named).collect()
}

/// True for files that are compiled for tests only.
fn is_test(name: &str) -> bool {
    name.ends_with("tests.rs") || name.ends_with("fixtures.rs")
}

/// The part of the code before its tests, which come last.
fn program(code: &str) -> &str {
    let begin = ["#[cfg(test)]\nmod ", "#[cfg(all(test"].iter().filter_map(|begin| code.find(begin)).min();
    &code[..begin.unwrap_or(code.len())]
}

/// The text without line comments.
fn code(text: &str) -> String {
    text.lines().map(|line| line.split("//").next().unwrap_or("")).collect::<Vec<_>>().join("\n")
}
