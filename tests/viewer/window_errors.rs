//! What goes wrong in the window: lost devices, little memory, files that cannot be opened.
#![cfg(target_os = "linux")]

use std::fs;
use std::process::Command;

use crate::common::Turn;
use crate::common::desktop::Desktop;
use crate::common::program::{limit, path};
use crate::common::window::{Viewer, view};

use super::window::{MIDDLE, SMALL, equals_render};

/// With a fault that is asked for, the viewer says it and goes on.
fn with_fault(fault: &str, said: &str) {
    let _turn = Turn::take();
    let desktop = Desktop::open(true);
    let plush = fs::canonicalize("tests/fixtures/plush.ply").unwrap().display().to_string();
    let arguments = [&SMALL[..], &["--near", "0.05"]].concat();
    let mut viewer = Viewer::open(&desktop, &arguments, |command| {
        command.env("SMALTO_FAULT", fault);
    });
    viewer.next("first-frame");
    viewer.settle();
    // Moving makes frames until it happens.
    for i in 0..10 {
        viewer.drag(1, MIDDLE, [260 + 5 * i, 170]);
        if viewer.count("message") > 0 {
            break;
        }
    }
    viewer.message(said);
    viewer.settle();
    let lit = viewer.shot().lit();
    match fault.starts_with("memory") {
        true => {
            // The scene is given up until something changes: here there is one more.
            viewer.desktop.drop_files(viewer.window, &[&plush]);
            while viewer.next("scene")["scenes"] != 2 {}
            viewer.settle();
            assert!(viewer.shot().lit() > 50_000);
        }
        false => assert!(lit > 50_000, "{lit} pixels are not black"),
    }
    let before = viewer.view();
    viewer.drag(1, MIDDLE, [300, 190]);
    assert_ne!(viewer.view(), before, "it is still of use");
    if fault.starts_with("surface") {
        equals_render(&mut viewer, "cactus:20000", "0.05");
    }
    viewer.quit();
}

#[test]
fn a_lost_device_is_opened_again() {
    with_fault("device@8", "opened again");
}

#[test]
fn a_lost_surface_is_opened_again() {
    with_fault("surface@8", "open again");
}

#[test]
fn too_little_memory_is_a_message() {
    with_fault("memory@8", "not enough memory");
}

/// 6 GB of address space for the program: it asks for 47, which some systems would promise.
fn limit_memory(command: &mut Command) {
    limit(command, "-v 6000000");
}

#[test]
fn files_that_cannot_be_opened_are_messages_in_the_window() {
    let _turn = Turn::take();
    let desktop = Desktop::open(true);
    let plush = fs::canonicalize("tests/fixtures/plush.ply").unwrap().display().to_string();
    let arguments = ["--size", "480x320", "--no-panels"];
    for (scene, said) in [("Cargo.toml", "Cargo.toml"), ("no/such.ply", "no/such.ply"), ("cactus:200000000", "cactus")]
    {
        let mut viewer = Viewer::open(&desktop, &[&[scene], &arguments[..]].concat(), limit_memory);
        let message = viewer.message(said);
        assert_eq!(message["is_error"], true, "{message}");
        // It lives, and shows another.
        viewer.desktop.drop_files(viewer.window, &[&plush]);
        assert_eq!(viewer.next("scene")["gaussians"], 61);
        viewer.settle();
        assert!(viewer.shot().lit() > 1000);
        viewer.quit();
    }
}

fn fails(code: i32, command: &mut Command) -> String {
    let output = command.output().expect("the program starts");
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{error}");
    assert!(!error.contains("panicked") && error.trim_end().lines().count() == 1, "{error}");
    error
}

#[test]
fn a_missing_display_and_wrong_arguments_are_one_sentence() {
    let _turn = Turn::take();
    let folder = tempfile::tempdir().unwrap();
    let error = fails(3, view(&["cactus:100"]).env_remove("DISPLAY"));
    assert!(error.contains("no window can be opened"), "{error}");
    let error = fails(3, view(&["cactus:100"]).env("DISPLAY", ":4711"));
    assert!(error.contains("no window can be opened"), "{error}");
    let keys = path(&folder, "keys.toml");
    fs::write(&keys, "[keys]\nforward = \"Nn\"\n").unwrap();
    let error = fails(2, &mut view(&["cactus:100", "--keys", &keys]));
    assert!(error.contains("keys.toml") && error.contains("Nn"), "{error}");
    let error = fails(2, view(&["cactus:100"]).env("SMALTO_FAULT", "nonsense"));
    assert!(error.contains("SMALTO_FAULT"), "{error}");
}
