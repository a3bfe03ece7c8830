//! Shaders write a number that the host needs too once, in the declaration of a named constant.

use std::fs;

use crate::{code, files, root};

/// Numbers, and the declarations that alone may have them.
const NAMED: [(&str, &[&str]); 3] = [
    ("512.0", &["const float OUTLINES_STOP = "]),
    ("0.99", &["const float ALPHA_MAX = "]),
    ("264", &["const uint BIN_CHUNKS = "]),
];

/// Lines with one of the numbers that do not declare its constant.
fn bare_numbers(text: &str) -> Vec<String> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '.' || c == '_';
    let has = |line: &str, number: &str| line.split(|c| !is_part(c)).any(|word| word == number);
    let text = code(text);
    let bare = |line: &&str| {
        NAMED.iter().any(|(number, declarations)| {
            has(line, number) && !declarations.iter().any(|declaration| line.contains(declaration))
        })
    };
    text.lines().filter(bare).map(str::to_owned).collect()
}

#[test]
fn shaders_have_no_bare_numbers_of_the_host() {
    let folder = root().join("glsl");
    let mut found = Vec::new();
    for path in [files(&folder, "comp"), files(&folder, "glsl")].concat() {
        let bare = bare_numbers(&fs::read_to_string(&path).unwrap());
        found.extend(bare.iter().map(|line| format!("{}: {line}", path.display())));
    }
    assert_eq!(found, Vec::<String>::new());
}

#[test]
fn a_bare_number_is_found() {
    assert_eq!(bare_numbers("const uint BIN_CHUNKS = 264;  // 0.99\nuint a = 2640;\nfloat b = 0.995;").len(), 0);
    assert_eq!(bare_numbers("const float MOST = 0.99;\nx = float(code) / 512.0;\nuint c = 264 * bins;").len(), 3);
}
