//! Scene files that are read again when they change.

use std::path::Path;
use std::time::{Duration, Instant};

use glam::DVec2;
use smalto::formats::{SceneFile, write_file};
use smalto::procedural::cactus;
use smalto::viewer::{Change, Offscreen, Setup};

use super::frames::{SIZE, open, setup};
use crate::common::Gpu;

fn write(file: &Path, count: usize) {
    let gaussians = cactus(count).unwrap().gaussians;
    write_file(file, SceneFile::of(file).unwrap(), &gaussians, false, &|_| {}).unwrap();
}

/// A window that follows a file of 500 Gaussians.
fn followed(gpu: &Gpu, file: &Path) -> Offscreen {
    write(file, 500);
    let name = file.display().to_string();
    open(gpu, Setup { watches_files: true, ..setup(&[&name]) })
}

/// The number of Gaussians of the scene that is open.
fn count(offscreen: &mut Offscreen) -> usize {
    offscreen.viewer().scenes.layers[0].scene.as_ref().unwrap().count()
}

/// Draws frames until something is so.
fn wait(offscreen: &mut Offscreen, is_so: impl Fn(&mut Offscreen) -> bool) {
    let end = Instant::now() + Duration::from_secs(30);
    while !is_so(offscreen) {
        assert!(Instant::now() < end, "it does not come");
        offscreen.frame(Vec::new()).unwrap();
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn says(offscreen: &mut Offscreen, text: &str) -> bool {
    offscreen.viewer().messages.shown().iter().any(|message| message.text.contains(text))
}

#[test]
fn a_file_that_changes_is_read_again_and_the_view_stays() {
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let file = folder.path().join("training.ply");
    let mut offscreen = followed(&gpu, &file);
    offscreen.viewer().view.navigator.orbit(DVec2::new(120.0, 30.0), SIZE);
    offscreen.settle().unwrap();
    let view = offscreen.viewer().view.camera();

    write(&file, 900);
    wait(&mut offscreen, |offscreen| count(offscreen) == 900);
    offscreen.settle().unwrap();
    let drawn = offscreen.session.pair.first.as_ref().unwrap();
    assert_eq!(drawn.gaussians.as_ref().unwrap().len(), 900);
    assert!(offscreen.viewer().view.camera() == view, "nothing moves");

    // A file that cannot be read leaves what is there, and the next one comes.
    std::fs::write(&file, "ply\nformat ascii 1.0\n").unwrap();
    wait(&mut offscreen, |offscreen| says(offscreen, "the scene before it stays"));
    assert_eq!(count(&mut offscreen), 900);
    write(&file, 700);
    wait(&mut offscreen, |offscreen| count(offscreen) == 700);
}

/// An edit is of the Gaussians that it was made with: none of them is exchanged under it, and none is undone to others.
#[test]
fn an_edited_scene_stays() {
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let file = folder.path().join("training.ply");
    let mut offscreen = followed(&gpu, &file);
    let edit = |offscreen: &mut Offscreen| {
        offscreen.viewer().change(Change::SelectAll);
        offscreen.viewer().record_undo_step();
        offscreen.settle().unwrap();
    };
    edit(&mut offscreen);
    offscreen.viewer().undo(false);
    offscreen.settle().unwrap();
    assert!(offscreen.viewer().scenes.layers[0].edit.is_none());
    write(&file, 900);
    wait(&mut offscreen, |offscreen| count(offscreen) == 900);
    offscreen.viewer().undo(true);
    assert!(offscreen.viewer().scenes.layers[0].edit.is_none(), "the edit was of other Gaussians");

    edit(&mut offscreen);
    write(&file, 700);
    wait(&mut offscreen, |offscreen| says(offscreen, "when nothing is selected or edited any more"));
    assert_eq!(count(&mut offscreen), 900);
    offscreen.viewer().change(Change::SelectNone);
    wait(&mut offscreen, |offscreen| count(offscreen) == 700);
}
