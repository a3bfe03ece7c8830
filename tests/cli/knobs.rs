//! The table of knobs, and the help texts and documents that list them.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use smalto::formats::read;
use smalto::measure::trade;
use smalto::options::{Group, KNOBS, Kind, Knob, Options, Value};
use smalto::scene::Requirements;

use crate::common::program::{fails, ok};

#[test]
fn every_knob_keeps_the_values_that_it_is_set_to() {
    for knob in &KNOBS {
        assert!(std::ptr::eq(Knob::named(knob.name).unwrap(), knob));
        for value in knob.steps {
            let turned = knob.turned(&Options::EXACT, *value);
            assert_eq!((knob.get)(&turned), *value, "{}", knob.name);
            assert_eq!(knob.turned(&turned, (knob.get)(&Options::EXACT)), Options::EXACT, "{} alone", knob.name);
        }
        let exact = (knob.get)(&Options::EXACT);
        assert!(!knob.is_searched || knob.steps[0] == exact, "a search begins at the exact value of {}", knob.name);
    }
}

#[test]
fn every_knob_reads_its_values_and_nothing_else() {
    let parse = |name: &str, text: &str| Knob::named(name).unwrap().parse(text);
    assert_eq!(parse("stop", "0.25"), Ok(Value::Number(0.25)));
    assert_eq!(parse("key-bits", "8"), Ok(Value::Count(8)));
    assert_eq!(parse("sh-storage", "u8"), Ok(Value::Name("u8")));
    assert_eq!(parse("order", "per-pixel"), Ok(Value::Name("per-pixel")));
    assert_eq!(parse("antialiased", "true"), Ok(Value::Flag(true)));
    assert_eq!(parse("stop", "1.5").unwrap_err(), "expected a number from 0 to 1");
    assert_eq!(parse("scale", "0").unwrap_err(), "expected a number above 0, at most 1");
    assert_eq!(parse("near", "inf").unwrap_err(), "expected a number above 0");
    assert_eq!(parse("near", "nan").unwrap_err(), "expected a number above 0");
    assert_eq!(parse("key-bits", "33").unwrap_err(), "expected a whole number from 8 to 32");
    assert_eq!(parse("sh-storage", "u4").unwrap_err(), "expected lossless, f32, f16, u8");
    assert_eq!(parse("antialiased", "maybe").unwrap_err(), "expected true or false");
}

#[test]
fn every_knob_is_a_flag_with_its_values() {
    for command in ["render", "view", "bench", "trade"] {
        // Help texts are wrapped.
        let help = ok(&[command, "--help"]).split_whitespace().collect::<Vec<_>>().join(" ");
        for knob in KNOBS.iter().filter(|knob| knob.group != Group::Path) {
            let flag = format!("--{} <{}>", knob.name, knob.value_name);
            let (_, after) = help.split_once(&flag).unwrap_or_else(|| panic!("{command} --help lacks {flag}"));
            if let Kind::Name(names) = knob.kind {
                let listed = format!("[possible values: {}]", names().join(", "));
                assert!(after.contains(&listed), "{command} --help: {flag}");
            }
        }
    }
    let error = fails(2, &["render", "--key-bits", "7"]);
    assert!(error.contains("--key-bits 7: expected a whole number from 8 to 32"), "{error}");
}

/// docs/accuracy.md has a row for every preset and every step of every knob, measured on scenes whose files hold bytes.
#[test]
fn the_document_on_accuracy_lists_every_step_of_every_knob() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let scene = read(root.join("tests/fixtures/plush.v4.spz")).unwrap();
    let steps = trade::knobs(&Options::EXACT, &Requirements::of(&scene.gaussians));
    let presets = Options::PRESETS.iter().map(|(name, _)| (*name).to_owned()).filter(|name| name != "portable");
    let expected: BTreeSet<String> = steps.into_iter().map(|(title, _)| title).chain(presets).collect();
    let text = fs::read_to_string(root.join("docs/accuracy.md")).unwrap();
    let (_, section) = text.split_once("\n## Every knob alone\n").expect("there is the section");
    let rows = section.lines().skip_while(|line| !line.starts_with('|')).take_while(|line| line.starts_with('|'));
    let titles = rows.skip(2).map(|row| row.split('|').nth(1).unwrap_or("").trim().to_owned());
    assert_eq!(titles.collect::<BTreeSet<_>>(), expected);
}
