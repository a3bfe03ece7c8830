//! The help window: actions of the mouse and the keys.

use egui::{Align2, Context, Grid, ScrollArea, Window};

use crate::viewer::model::{ACTIONS, Viewer};

const MOUSE: [(&str, &str); 6] = [
    ("left drag", "turn around the pivot"),
    ("middle drag, or Shift and left drag", "pan"),
    ("right drag", "look around"),
    ("wheel", "move nearer or farther"),
    ("double click", "turn around what is under the cursor"),
    ("drop a file", "open a scene, a camera file, or a picture to compare with"),
];

/// Least width of the window for two columns of help, in points.
const WIDE: f32 = 900.0;

pub(super) fn show(viewer: &mut Viewer, context: &Context) {
    let mut is_open = viewer.panels.shows_help;
    let window = Window::new("Mouse and keys").open(&mut is_open).anchor(Align2::CENTER_CENTER, [0.0, 0.0]);
    let columns = if context.content_rect().width() < WIDE { 1 } else { 2 };
    window.resizable(false).show(context, |ui| {
        ScrollArea::vertical().show(ui, |ui| {
            Grid::new(("help", columns)).num_columns(2 * columns).striped(true).show(ui, |ui| {
                let mouse = MOUSE.map(|(what, does)| (what.to_owned(), does));
                let keys = ACTIONS.iter().map(|(action, _, _, does)| (viewer.setup.bindings.text(*action), *does));
                let all: Vec<_> = mouse.into_iter().chain(keys).collect();
                let rows = all.len().div_ceil(columns);
                for row in 0..rows {
                    for (key, does) in all.iter().skip(row).step_by(rows) {
                        ui.monospace(key);
                        ui.label(*does);
                    }
                    ui.end_row();
                }
            });
        });
    });
    viewer.panels.shows_help = is_open;
}
