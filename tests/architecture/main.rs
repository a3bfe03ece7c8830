//! Who may know whom, and how long a file may be.

use std::fs;
use std::path::{Path, PathBuf};

/// Every module of the crate and the modules it may use.
const EDGES: [(&str, &[&str]); 16] = [
    ("memory", &[]),
    ("files", &[]),
    ("scene", &["memory", "files"]),
    ("camera", &["files"]),
    ("options", &[]),
    ("pixels", &["files"]),
    ("metrics", &["pixels"]),
    ("gpu", &["memory"]),
    ("reference", &["scene", "camera", "options", "pixels"]),
    ("render", &["memory", "gpu", "scene", "camera", "options", "pixels"]),
    ("bench", &["files", "gpu", "render", "scene", "camera", "options", "pixels"]),
    ("ladder", &["files", "bench", "gpu", "render", "reference", "scene", "camera", "options", "pixels", "metrics"]),
    ("trade", &["files", "bench", "gpu", "render", "reference", "scene", "camera", "options", "pixels", "metrics"]),
    ("viewer", &["memory", "gpu", "render", "reference", "scene", "camera", "options", "pixels", "bench", "trade"]),
    ("environment", &["gpu"]),
    (
        "cli",
        &[
            "memory",
            "files",
            "render",
            "reference",
            "gpu",
            "scene",
            "camera",
            "options",
            "pixels",
            "metrics",
            "environment",
            "bench",
            "ladder",
            "trade",
            "viewer",
        ],
    ),
];

/// Lines after which a file should be split.
const LONGEST: usize = 400;

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
    found
}

fn sources() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let named =
        |path: PathBuf| (path.strip_prefix(&root).unwrap().display().to_string(), fs::read_to_string(&path).unwrap());
    files(&root, "rs").into_iter().map(named).collect()
}

/// The modules that a source uses from the crate.
fn used(text: &str) -> Vec<String> {
    let code = text.lines().map(|line| line.split("//").next().unwrap_or("")).collect::<Vec<_>>().join("\n");
    let after = code.split("crate::").skip(1).filter(|rest| !rest.is_empty());
    after.map(|rest| rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()).collect()
}

/// What is wrong with these sources, one line each.
fn violations(sources: &[(String, String)]) -> Vec<String> {
    let mut found = Vec::new();
    for (name, text) in sources {
        let module = name.split(['/', '.']).next().unwrap();
        for (word, homes) in [("unsafe ", &["gpu", "memory"][..]), ("ash::", &["gpu"]), ("vk::", &["gpu"])] {
            let has_word = text.lines().any(|l| !l.trim_start().starts_with("//") && l.contains(word));
            if has_word && !homes.contains(&module) {
                found.push(format!("{name}: {word} outside of {}", homes.join(" and ")));
            }
        }
        if ["main", "lib"].contains(&module) {
            continue;
        }
        let Some((_, allowed)) = EDGES.iter().find(|(m, _)| *m == module) else {
            found.push(format!("{name}: module {module} is not in the table"));
            continue;
        };
        for target in used(text).iter().filter(|t| *t != module && !allowed.contains(&t.as_str())) {
            found.push(format!("{name}: {module} may not use {target}"));
        }
    }
    found
}

#[test]
fn modules_know_only_whom_they_may() {
    assert_eq!(violations(&sources()), Vec::<String>::new());
}

#[test]
fn a_forbidden_edge_is_found() {
    let source = |name: &str, text: &str| vec![(name.to_owned(), text.to_owned())];
    assert_eq!(
        violations(&source("scene/ply.rs", "use crate::render::PortablePipeline;")),
        ["scene/ply.rs: scene may not use render"]
    );
    assert_eq!(
        violations(&source("render/a.rs", "let x = unsafe { y() };")),
        ["render/a.rs: unsafe  outside of gpu and memory"]
    );
    assert_eq!(violations(&source("render/a.rs", "use ash::vk;")), ["render/a.rs: ash:: outside of gpu"]);
    assert_eq!(violations(&source("fresh.rs", "")), ["fresh.rs: module fresh is not in the table"]);
}

#[test]
fn files_are_short_enough_to_read() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let all =
        [("src", "rs"), ("glsl", "comp"), ("glsl", "glsl")].map(|(folder, ending)| files(&root.join(folder), ending));
    for path in all.iter().flatten() {
        let lines = fs::read_to_string(path).unwrap().lines().count();
        assert!(lines <= LONGEST, "{} has {lines} lines", path.display());
    }
}

#[test]
fn every_file_says_first_what_it_is() {
    for (name, text) in sources() {
        assert!(text.starts_with("//! "), "{name}");
    }
    for path in files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("glsl"), "comp") {
        let text = fs::read_to_string(&path).unwrap();
        assert!(
            text.contains("\n// One ") && text.contains("// Before:") && text.contains("After:"),
            "{}",
            path.display()
        );
    }
}
