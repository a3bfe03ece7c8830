//! Files are short enough to read, their lines are wrapped, and their first line says what they are.

use std::fs;
use std::path::PathBuf;

use crate::{files, root, sources};

/// Lines after which a file should be split.
const LINES: usize = 600;

/// The longest line, in characters.
const COLUMNS: usize = 120;

/// Files with one of these endings in the folders of the checkout.
fn all(folders: &[&str], endings: &[&str]) -> Vec<PathBuf> {
    let pairs = folders.iter().flat_map(|folder| endings.iter().map(move |ending| (folder, ending)));
    let found: Vec<PathBuf> = pairs.flat_map(|(folder, ending)| files(&root().join(folder), ending)).collect();
    assert!(!found.is_empty());
    found
}

/// Numbers of the lines that are too long. Rows of Markdown tables and lines without spaces cannot be wrapped.
fn long_lines(text: &str, is_markdown: bool) -> Vec<usize> {
    let is_long = |line: &str| {
        let is_whole = is_markdown && (line.trim_start().starts_with('|') || !line.trim().contains(' '));
        line.chars().count() > COLUMNS && !is_whole
    };
    text.lines().enumerate().filter(|(_, line)| is_long(line)).map(|(i, _)| i + 1).collect()
}

#[test]
fn files_are_short_enough_to_read() {
    let long = |path: &PathBuf| {
        let lines = fs::read_to_string(path).unwrap().lines().count();
        (lines > LINES).then(|| format!("{}: {lines} lines", path.display()))
    };
    let found: Vec<String> =
        all(&["src", "glsl", "tests", "benches"], &["rs", "comp", "glsl"]).iter().filter_map(long).collect();
    assert_eq!(found, Vec::<String>::new());
}

#[test]
fn lines_are_at_most_120_columns() {
    let mut found = Vec::new();
    let mut paths = all(&["src", "glsl", "tests", "benches", "docs"], &["rs", "comp", "glsl", "md"]);
    paths.extend(["README.md", "build.rs"].map(|name| root().join(name)));
    for path in paths {
        let is_markdown = path.extension().is_some_and(|e| e == "md");
        for line in long_lines(&fs::read_to_string(&path).unwrap(), is_markdown) {
            found.push(format!("{}:{line}", path.strip_prefix(root()).unwrap().display()));
        }
    }
    assert!(found.is_empty(), "{} lines are too long:\n{}", found.len(), found.join("\n"));
}

#[test]
fn a_long_line_is_found() {
    let text = format!("{}\n{} {}\n| {} |", "é".repeat(COLUMNS), "a".repeat(60), "b".repeat(60), "c".repeat(200));
    assert_eq!(long_lines(&text, true), [2]);
    assert_eq!(long_lines(&text, false), [2, 3]);
}

#[test]
fn every_file_says_first_what_it_is() {
    for (name, text) in sources() {
        assert!(text.starts_with("//! "), "{name}");
    }
    for path in all(&["tests", "benches"], &["rs"]) {
        assert!(fs::read_to_string(&path).unwrap().starts_with("//! "), "{}", path.display());
    }
    for path in all(&["glsl"], &["comp"]) {
        let text = fs::read_to_string(&path).unwrap();
        let is_complete = text.contains("\n// One ") && text.contains("// Before:") && text.contains("After:");
        assert!(is_complete, "{}", path.display());
    }
}

/// A test that docs/robustness.md names as `file::test`, or `::test` after another of the same file.
#[test]
fn tests_that_the_docs_name_are_there() {
    let text = fs::read_to_string(root().join("docs/robustness.md")).unwrap();
    let is_name = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    let named: Vec<&str> =
        text.split("::").skip(2).map(|rest| &rest[..rest.find(|c| !is_name(c)).unwrap_or(rest.len())]).collect();
    assert!(named.len() > 40, "{named:?}");
    let code: String = all(&["src", "tests"], &["rs"]).iter().map(|path| fs::read_to_string(path).unwrap()).collect();
    for name in named {
        assert!(code.contains(&format!("fn {name}(")), "{name}");
    }
}

/// The words that have a row of the glossary twice.
fn repeated_words(document: &str) -> Vec<String> {
    let glossary =
        document.split("\n## ").find(|section| section.starts_with("Glossary\n")).expect("there is a glossary");
    let heads = glossary.lines().filter_map(|line| line.strip_prefix("- **")?.split("**").next());
    let mut words: Vec<&str> = heads.flat_map(|cell| cell.split([',', ';'])).map(str::trim).collect();
    words.sort_unstable();
    let pairs = words.windows(2).filter(|pair| pair[0] == pair[1]);
    pairs.map(|pair| pair[0].to_owned()).collect()
}

#[test]
fn the_glossary_has_one_row_for_each_word() {
    let text = fs::read_to_string(root().join("docs/architecture.md")).unwrap();
    assert_eq!(repeated_words(&text), Vec::<String>::new());
    assert_eq!(
        repeated_words("# A\n\n## Glossary\n\n- **a, b**: x\n- **c**: x\n- **b**: y\n\n## B\n- **c**: z"),
        ["b"]
    );
}
