//! The help window: actions of the mouse and the keys, by task.

use egui::{Align2, Context, Grid, ScrollArea, Ui, Window};

use crate::viewer::model::{ACTIONS, TASKS, Viewer};

const MOUSE: [(&str, &str); 6] = [
    ("left drag", "turn around the pivot"),
    ("middle drag, or Shift and left drag", "pan"),
    ("right drag", "look around"),
    ("wheel", "move nearer or farther"),
    ("double click", "turn around what is under the cursor"),
    ("drop a file", "open a scene, a project, cameras, a list of places, or a picture to compare with"),
];

/// Least width of a column of help, in points.
const COLUMN: f32 = 440.0;

/// A task, with its keys and what they do.
type Task = (&'static str, Vec<(String, &'static str)>);

pub(super) fn show(viewer: &mut Viewer, context: &Context) {
    let mut is_open = viewer.panels.shows_help;
    let window = Window::new("Mouse and keys").open(&mut is_open).anchor(Align2::CENTER_CENTER, [0.0, 0.0]);
    let columns = ((context.content_rect().width() / COLUMN) as usize).clamp(1, 3);
    window.resizable(false).default_width(COLUMN * columns as f32).show(context, |ui| {
        let height = context.content_rect().height() - 100.0;
        ScrollArea::vertical().max_height(height).show(ui, |ui| {
            ui.horizontal_top(|ui| {
                for column in columns_of(tasks(viewer), columns) {
                    ui.vertical(|ui| column.iter().for_each(|task| list(task, ui)));
                }
            });
        });
    });
    viewer.panels.shows_help = is_open;
}

fn tasks(viewer: &Viewer) -> Vec<Task> {
    let mouse = ("Mouse", MOUSE.map(|(what, does)| (what.to_owned(), does)).to_vec());
    let mut tasks = vec![mouse];
    for (action, _, _, does) in ACTIONS {
        if let Some((title, _)) = TASKS.iter().find(|(_, first)| *first == action) {
            tasks.push((title, Vec::new()));
        }
        if let Some((_, rows)) = tasks.last_mut() {
            rows.push((viewer.setup.bindings.text(action), does));
        }
    }
    tasks
}

/// The tasks in columns of about the same height.
fn columns_of(tasks: Vec<Task>, columns: usize) -> Vec<Vec<Task>> {
    let height = |(_, rows): &Task| rows.len() + 2;
    let all: usize = tasks.iter().map(height).sum();
    let mut split: Vec<Vec<Task>> = vec![Vec::new(); columns];
    let mut above = 0;
    for task in tasks {
        // A task is in the column in which its middle is.
        let column = (above + height(&task) / 2) * columns / all;
        above += height(&task);
        split[column.min(columns - 1)].push(task);
    }
    split
}

fn list((title, rows): &Task, ui: &mut Ui) {
    ui.strong(*title);
    Grid::new(title).num_columns(2).striped(true).show(ui, |ui| {
        for (key, does) in rows {
            ui.monospace(key);
            ui.label(*does);
            ui.end_row();
        }
    });
    ui.add_space(8.0);
}
