//! The JSON schemas in docs/schemas are those that the program writes.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use crate::common::program::{ok, path};

fn files(folder: &Path) -> BTreeMap<String, String> {
    let read =
        |entry: fs::DirEntry| (entry.file_name().into_string().unwrap(), fs::read_to_string(entry.path()).unwrap());
    fs::read_dir(folder).unwrap().map(|entry| read(entry.unwrap())).collect()
}

#[test]
fn documented_schemas_are_those_of_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let written = path(&folder, "schemas");
    ok(&["schemas", &written]);
    let current = files(Path::new(&written));
    let mut documented = files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/schemas"));
    // The schema of a bench: `tests/measure/ladder.rs` compares it.
    documented.remove("ladder.schema.json").expect("the schema of the ladder");
    assert!(current.keys().eq(documented.keys()), "{:?}\n{:?}", current.keys(), documented.keys());
    for (name, text) in &current {
        assert!(documented[name] == *text, "{name} is old: `smalto schemas docs/schemas` writes the new one");
    }
}
