//! The keys and what the mouse does, on the screen.

use egui::{Align2, Context, Grid, Window};

use super::super::keys::ACTIONS;
use super::super::state::Viewer;

const MOUSE: [(&str, &str); 6] = [
    ("left", "turn around the pivot"),
    ("middle, or Shift and left", "pan"),
    ("right", "look around"),
    ("wheel", "nearer and farther"),
    ("double click", "turn around what is there"),
    ("drop a file", "open a scene, cameras, or a picture to compare with"),
];

pub(super) fn show(viewer: &mut Viewer, context: &Context) {
    let mut is_open = viewer.panels.shows_help;
    let window = Window::new("Mouse and keys").open(&mut is_open).anchor(Align2::CENTER_CENTER, [0.0, 0.0]);
    window.resizable(false).show(context, |ui| {
        Grid::new("help").num_columns(4).striped(true).show(ui, |ui| {
            let mouse = MOUSE.map(|(what, does)| (what.to_owned(), does));
            let keys = ACTIONS.iter().map(|(action, _, _, does)| (viewer.setup.bindings.text(*action), *does));
            let all: Vec<_> = mouse.into_iter().chain(keys).collect();
            let half = all.len().div_ceil(2);
            for i in 0..half {
                for (key, does) in [all.get(i), all.get(half + i)].into_iter().flatten() {
                    ui.monospace(key);
                    ui.label(*does);
                }
                ui.end_row();
            }
        });
    });
    viewer.panels.shows_help = is_open;
}
