//! The window under random input of a mouse and a keyboard: none is lost, and all is undone.
#![cfg(target_os = "linux")]

use std::fs;

use crate::common::desktop::{CONTROL, Desktop, ESCAPE, SHIFT};
use crate::common::window::Viewer;
use crate::common::{Random, Turn};

const DELETE: u32 = 0xffff;

/// Clicks and keys that add to the camera path are counted there, among drags, strokes and other keys. Undo goes back
/// to the first picture, byte by byte, and nothing is told by the validation layer.
#[test]
fn no_click_is_lost() {
    act_at_random(120);
}

#[test]
#[ignore = "long: two thousand clicks, drags and keys"]
fn long_no_click_is_lost() {
    act_at_random(2000);
}

fn act_at_random(actions: usize) {
    let _turn = Turn::take();
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("smalto")).unwrap();
    fs::write(folder.path().join("smalto/viewer.json"), r#"{"tab": "path"}"#).unwrap();
    // A window manager grabs clicks, and loses some of those that follow each other within milliseconds.
    let desktop = Desktop::open(false);
    let mut viewer = Viewer::open(&desktop, &["cactus:1000", "--size", "1000x420"], |command| {
        command.current_dir(folder.path()).env("XDG_STATE_HOME", folder.path());
    });
    while viewer.next("first-frame")["is_whole"] != true {}
    viewer.settle();
    viewer.press(ESCAPE);
    let picture = |viewer: &mut Viewer, name: &str| {
        viewer.press(0xffc9); // F12
        viewer.message("written");
        fs::read(folder.path().join(name)).unwrap()
    };
    let first = picture(&mut viewer, "view.png");
    // Where nothing but the picture is, and the button that adds a key.
    let mut random = Random(11);
    let place = |random: &mut Random| [60 + random.below(540) as i16, 10 + random.below(320) as i16];
    let add = [20, 366];
    let tap = |symbol: u32| [true, false].into_iter().for_each(|is_down| desktop.key(symbol, is_down));
    let with = |modifier: u32, symbol: u32| {
        desktop.key(modifier, true);
        tap(symbol);
        desktop.key(modifier, false);
    };
    let click = |button: u8| [true, false].into_iter().for_each(|is_down| desktop.button(button, is_down));
    let (mut keys, window) = (0, viewer.window);
    for _ in 0..actions {
        match random.below(8) {
            0 | 1 => {
                let button = 1 + random.below(3) as u8;
                desktop.point(window, place(&mut random));
                desktop.button(button, true);
                (0..3).for_each(|_| desktop.point(window, place(&mut random)));
                desktop.button(button, false);
            }
            2 => {
                tap(u32::from('i'));
                keys += 1;
            }
            3 => {
                desktop.point(window, add);
                click(1);
                keys += 1;
            }
            4 => tap(u32::from('1') + random.below(9)),
            5 => match random.below(6) {
                0 => with(CONTROL, u32::from('a')),
                1 => with(CONTROL, u32::from('i')),
                2 => with(SHIFT, u32::from('b')),
                3 => tap(DELETE),
                _ => tap(u32::from('b')),
            },
            6 => {
                desktop.point(window, place(&mut random));
                click(4 + random.below(2) as u8);
            }
            _ => {
                desktop.point(window, place(&mut random));
                tap([u32::from('c'), u32::from('r'), u32::from('x'), u32::from('m'), ESCAPE][random.below(5) as usize]);
            }
        }
    }
    viewer.settle();
    tap(u32::from('1'));
    tap(ESCAPE);
    tap(u32::from('i'));
    viewer.settle();
    with(CONTROL, u32::from('z'));
    let said = viewer.message("undone: the path");
    assert!(said["text"].as_str().unwrap().contains(&format!("{keys} keys, from {}", keys + 1)), "{said}, not {keys}");
    for _ in 0..2 * actions + 2 {
        with(CONTROL, u32::from('z'));
    }
    viewer.message("there is nothing to undo");
    viewer.settle();
    viewer.press(ESCAPE);
    assert!(picture(&mut viewer, "view-2.png") == first, "every byte of the first picture");
    viewer.quit();
}
