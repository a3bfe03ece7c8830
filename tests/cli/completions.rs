//! Completions of shells and manual pages.

use std::fs;

use crate::common::program::{fails, ok, path};

/// The commands of `smalto --help`, without `help`.
pub fn commands() -> Vec<String> {
    let help = ok(&["--help"]);
    let (_, listed) = help.split_once("\nCommands:\n").expect("help lists the commands");
    let lines = listed.lines().take_while(|line| !line.is_empty());
    let names = lines.filter_map(|line| line.strip_prefix("  ")?.split(' ').next().filter(|name| !name.is_empty()));
    let names: Vec<_> = names.filter(|name| *name != "help").map(str::to_owned).collect();
    assert!(names.len() > 10 && names.contains(&"render".to_owned()), "{names:?}");
    names
}

#[test]
fn completions_of_every_shell_have_every_command() {
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let text = ok(&["completions", shell]);
        for command in commands() {
            assert!(text.contains(&command), "{shell}: {command}");
        }
        assert!(text.contains("max-error"), "{shell}: options are completed too");
    }
}

#[test]
fn completions_of_an_unknown_shell_are_refused() {
    let error = fails(2, &["completions", "sh"]);
    assert!(error.contains("<SHELL> sh: expected bash, elvish, fish, powershell, zsh"), "{error}");
    assert!(fails(2, &["completions"]).contains("missing: <SHELL>"));
}

#[test]
fn every_command_has_a_manual_page() {
    let folder = tempfile::tempdir().unwrap();
    let pages = path(&folder, "man1");
    // Twice: pages that are there are replaced.
    for _ in 0..2 {
        ok(&["man", &pages]);
    }
    let mut expected: Vec<_> = commands().iter().map(|command| format!("smalto-{command}.1")).collect();
    expected.push("smalto.1".to_owned());
    expected.sort();
    let mut found: Vec<_> =
        fs::read_dir(&pages).unwrap().map(|file| file.unwrap().file_name().into_string().unwrap()).collect();
    found.sort();
    assert_eq!(found, expected);
    for name in found {
        let text = fs::read_to_string(folder.path().join("man1").join(&name)).unwrap();
        for part in [".TH ", ".SH NAME", ".SH SYNOPSIS", ".SH DESCRIPTION"] {
            assert!(text.contains(part), "{name}: {part}");
        }
    }
}

#[test]
fn manual_pages_need_the_folder_above_theirs() {
    let folder = tempfile::tempdir().unwrap();
    let missing = path(&folder, "none");
    let error = fails(2, &["man", &format!("{missing}/man1")]);
    assert!(error.contains(&format!("there is no folder {missing}")), "{error}");
    assert_eq!(error.lines().count(), 1, "{error}");
    let file = path(&folder, "file");
    fs::write(&file, "kept").unwrap();
    assert!(fails(1, &["man", &file]).contains("cannot make the folder"));
    assert_eq!(fs::read_to_string(&file).unwrap(), "kept");
}
