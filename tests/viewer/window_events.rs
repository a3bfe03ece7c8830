//! Events and messages of the window: each event once, and messages where they can be read.
#![cfg(target_os = "linux")]

use crate::common::Turn;
use crate::common::desktop::Desktop;
use crate::common::program::{ok, path};
use crate::common::window::Viewer;

/// Of a scene that is drawn while it is read, the first frame and the first whole one are told, and the scene once.
#[test]
fn each_fact_is_told_once() {
    let _turn = Turn::take();
    let folder = tempfile::tempdir().unwrap();
    let file = path(&folder, "many.ply");
    ok(&["convert", "cactus:200000", &file]);
    let desktop = Desktop::open(true);
    let mut viewer = Viewer::open(&desktop, &[&file, "--size", "320x200", "--no-panels", "--look", "alpha"], |_| {});
    assert_eq!(viewer.next("scene")["gaussians"], 200_000);
    let mut first = viewer.next("first-frame");
    let mut told = 1;
    while first["is_whole"] != true {
        first = viewer.next("first-frame");
        told += 1;
    }
    viewer.settle();
    assert!(told <= 2 && viewer.count("first-frame") == told, "{told} frames");
    assert_eq!((viewer.count("scene"), viewer.count("look")), (1, 1));
    viewer.quit();
}

/// A script can wait until all pages of a picture are there.
#[test]
fn pages_are_told() {
    let _turn = Turn::take();
    let folder = tempfile::tempdir().unwrap();
    let file = path(&folder, "levels.smalto");
    ok(&["lod", "cactus:30000", "-o", &file]);
    let desktop = Desktop::open(true);
    let mut viewer = Viewer::open(&desktop, &[&file, "--size", "320x200", "--no-panels"], |_| {});
    let mut told = viewer.next("residency");
    while told["is_settled"] != true || told["missing"] != 0 {
        told = viewer.next("residency");
    }
    assert_eq!(told["coming"], 0, "{told}");
    while viewer.next("first-frame")["is_whole"] != true {}
    assert!(told["there"].as_u64() > Some(30) && told["there"].as_u64() <= told["fitting"].as_u64(), "{told}");
    viewer.settle();
    viewer.quit();
}

/// A message that comes while nothing moves is laid out where it can be read.
#[test]
fn a_message_lies_in_the_window() {
    let _turn = Turn::take();
    let folder = tempfile::tempdir().unwrap();
    let desktop = Desktop::open(true);
    let arguments = ["cactus:1000", "--size", "700x450", "--no-panels"];
    let mut viewer = Viewer::open(&desktop, &arguments, |command| {
        command.current_dir(folder.path());
    });
    viewer.next("first-frame");
    viewer.point([350, 200]);
    viewer.settle();
    let before = viewer.shot();
    viewer.press(F12);
    let written = viewer.next("written");
    let text = written["text"].as_str().unwrap();
    assert!(text.starts_with(&std::fs::canonicalize(folder.path()).unwrap().join("view.png").display().to_string()));
    viewer.settle();
    let after = viewer.shot();
    // The box stands above the lower edge, with its shadow below, and is as high as a line of text with its frame.
    let changed = |y: u32| (0..700).any(|x| before.at([x, y]) != after.at([x, y]));
    let rows: Vec<u32> = (0..450).filter(|y| changed(*y)).collect();
    assert!((380..415).contains(&rows[0]), "rows {} to {}", rows[0], rows[rows.len() - 1]);
    let text_rows = (rows[0]..438).filter(|y| (0..700).any(|x| after.at([x, *y]).iter().all(|c| *c > 180)));
    assert!(text_rows.count() >= 8, "the text is in the window");
    viewer.quit();
}

/// The keysym of F12.
const F12: u32 = 0xffc9;
