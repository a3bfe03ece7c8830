//! No circles of imports between files: each can be read after the files that it uses.

use std::collections::{BTreeMap, BTreeSet};

use crate::imports::Crate;
use crate::sources;

/// The only circle: a device pools what is used again, and that knows the device.
const ALLOWED: [&[&str]; 1] = [&["gpu/buffer.rs", "gpu/device.rs", "gpu/submission.rs"]];

fn reached<'a>(from: &'a str, uses: &BTreeMap<&str, Vec<&'a str>>) -> BTreeSet<&'a str> {
    let (mut reached, mut open) = (BTreeSet::new(), vec![from]);
    while let Some(file) = open.pop() {
        open.extend(uses.get(file).into_iter().flatten().filter(|next| reached.insert(**next)));
    }
    reached
}

/// Groups of files that all use each other, directly or through others.
fn circles(sources: &[(String, String)]) -> Vec<Vec<String>> {
    let sources = Crate::new(sources);
    let mut uses: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for (from, to) in sources.edges() {
        uses.entry(from).or_default().push(to);
    }
    let reached: BTreeMap<&str, BTreeSet<&str>> = uses.keys().map(|file| (*file, reached(file, &uses))).collect();
    let mut found = BTreeSet::new();
    for (file, others) in reached.iter().filter(|(file, others)| others.contains(**file)) {
        let returns = |other: &&&str| reached.get(**other).is_some_and(|back| back.contains(file));
        found.insert(others.iter().filter(returns).map(|other| (*other).to_owned()).collect::<Vec<_>>());
    }
    found.into_iter().collect()
}

#[test]
fn files_do_not_import_each_other_in_circles() {
    let found = circles(&sources());
    let is_new = |circle: &&Vec<String>| {
        !ALLOWED.iter().any(|allowed| circle.iter().all(|file| allowed.contains(&file.as_str())))
    };
    let new: Vec<_> = found.iter().filter(is_new).collect();
    assert!(new.is_empty(), "{new:#?}");
}

fn found_in(sources: &[(&str, &str)]) -> Vec<Vec<String>> {
    let owned: Vec<_> = sources.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect();
    circles(&owned)
}

#[test]
fn a_circle_is_found() {
    let lib = ("lib.rs", "pub mod a;\npub mod b;\npub mod c;");
    let direct =
        [lib, ("a.rs", "use crate::b::{self, B};"), ("b.rs", "fn f() { crate::c::g() }"), ("c.rs", "use super::a::A;")];
    assert_eq!(found_in(&direct), [["a.rs", "b.rs", "c.rs"]]);
    let by_name = [lib, ("a.rs", "use crate::b;\nfn f() { b::g() }"), ("b.rs", "pub use crate::a::A;\nfn g(_: A) {}")];
    assert_eq!(found_in(&by_name), [["a.rs", "b.rs"]]);
    let through = [
        ("a/mod.rs", "mod x;\nmod y;\npub use x::X;\npub use y::*;"),
        ("a/x.rs", "use super::Y;\npub struct X(Y);"),
        ("a/y.rs", "use super::{\n    X,\n};\npub struct Y(X);"),
        ("lib.rs", "mod a;"),
    ];
    assert_eq!(found_in(&through), [["a/x.rs", "a/y.rs"]]);
}

#[test]
fn files_without_a_circle_have_none() {
    let reexported = [
        ("a/mod.rs", "mod x;\nmod y;\npub use x::X;\npub use y::Y;"),
        ("a/x.rs", "use super::Y;\npub struct X(Y);"),
        ("a/y.rs", "pub struct Y;\n#[cfg(test)]\nmod tests {\n    use super::super::X;\n}"),
        ("lib.rs", "pub mod a;\npub use a::X;"),
    ];
    assert_eq!(found_in(&reexported), Vec::<Vec<String>>::new());
    let below = [("a/mod.rs", "mod x;\nfn f() { x::g() }\npub struct A;"), ("a/x.rs", "use super::A;"), ("lib.rs", "")];
    assert_eq!(found_in(&below), Vec::<Vec<String>>::new());
    let modules = [
        ("a/mod.rs", "pub mod x;\npub mod y;"),
        ("a/x.rs", "use super::y;\nfn f() { y::g() }"),
        ("a/y.rs", "// x::f()"),
        ("lib.rs", ""),
    ];
    assert_eq!(found_in(&modules), Vec::<Vec<String>>::new());
}
