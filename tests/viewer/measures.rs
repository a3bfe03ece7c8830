//! Measures that stay: in the project, in their unit, and as pairs that align two captures.

use glam::{DQuat, DVec3};
use smalto::viewer::{MeasureKind, Offscreen, Setup, Tab};

use super::frames::setup;
use crate::common::Gpu;

fn open(gpu: &Gpu, scenes: &[&str]) -> Offscreen {
    let setup = Setup { hides_panels: false, ..setup(scenes) };
    let mut offscreen = Offscreen::new(setup, &gpu.0, [700, 240]).unwrap();
    offscreen.viewer().panels.recent.tab = Tab::Inside;
    offscreen.settle().unwrap();
    offscreen
}

/// Two captures of one thing, of which one is turned, moved and scaled, lie on each other once pairs of points have
/// aligned them.
#[test]
fn captures_are_aligned_by_pairs_of_points() {
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, &["cactus:500", "few-large:300"]);
    let viewer = offscreen.viewer();
    let turn = DQuat::from_euler(glam::EulerRot::YXZ, 0.7, -0.3, 0.2);
    let there = |local: DVec3| DVec3::new(1.0, -0.5, 2.0) + 1.7 * (turn * local);
    viewer.editing.placed_layer = Some(viewer.scenes.layers[1].number);
    viewer.ruler.kind = MeasureKind::Pairs;
    let locals = [[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.0, 1.0, 0.3], [0.2, -0.4, 1.0]].map(DVec3::from);
    for local in &locals[..2] {
        viewer.measure(*local);
        viewer.measure(there(*local));
    }
    viewer.align_by_pairs();
    assert_eq!(viewer.scenes.layers[1].placement, Default::default(), "two pairs are too few");
    for local in &locals[2..] {
        viewer.measure(*local);
        viewer.measure(there(*local));
    }
    offscreen.settle().unwrap();
    let viewer = offscreen.viewer();
    viewer.record_undo_step();
    viewer.align_by_pairs();
    let placed = viewer.scenes.layers[1].placement.transform().unwrap();
    for local in locals {
        assert!(placed.point(local).distance(there(local)) < 1e-9, "{local}");
    }
    assert!(viewer.measures.all[0].root_mean_square().unwrap() < 1e-9, "the pairs show what is left");
    let said: Vec<_> = viewer.messages.shown().iter().map(|message| message.text.clone()).collect();
    assert!(said.iter().any(|text| text.contains("is aligned")), "{said:?}");
    viewer.undo(false);
    assert_eq!(viewer.scenes.layers[1].placement, Default::default());
    assert!(viewer.measures.all[0].root_mean_square().unwrap() > 1.0);
}

/// A scene is level, with its first point at the origin and the second one on the axis x.
#[test]
fn three_points_orient_a_scene() {
    let gpu = Gpu::new();
    let mut offscreen = open(&gpu, &["cactus:500"]);
    let viewer = offscreen.viewer();
    let tilt = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.3);
    let ground = [DVec3::ZERO, DVec3::new(0.4, 0.0, 0.9), DVec3::X].map(|at| DVec3::new(0.2, 0.1, 0.3) + tilt * at);
    ground.iter().for_each(|point| viewer.measure(*point));
    viewer.level_by_points(true);
    let placed = viewer.scenes.layers[0].placement.transform().unwrap();
    let [a, b, c] = ground.map(|point| placed.point(point));
    assert!(a.length() < 1e-9 && b.y.abs() < 1e-9 && b.z.abs() < 1e-9 && b.x > 0.9 && c.y.abs() < 1e-9, "{a} {b} {c}");
}

/// Measures and their unit are in the project, and undo goes back point by point.
#[test]
fn measures_stay_in_the_project_with_their_unit() {
    let gpu = Gpu::new();
    let folder = tempfile::tempdir().unwrap();
    let mut offscreen = open(&gpu, &["cactus:500"]);
    let viewer = offscreen.viewer();
    assert!(viewer.set_unit().is_err() && viewer.measures.unit.is_none(), "there is no length yet");
    viewer.measure(DVec3::ZERO);
    viewer.measure(DVec3::new(0.0, 0.0, 4.0));
    (viewer.ruler.known, viewer.ruler.unit) = (2.0, "m".to_owned());
    viewer.set_unit().unwrap();
    assert_eq!(viewer.measures.length(3.0), "1.5000 m");
    viewer.escape();
    offscreen.settle().unwrap();
    let viewer = offscreen.viewer();
    viewer.record_undo_step();
    viewer.ruler.kind = MeasureKind::Angle;
    viewer.measure(DVec3::X);
    let file = folder.path().join("measured.project.json");
    viewer.save_project(&file);
    let expected = viewer.measures.clone();
    assert_eq!(expected.all.iter().map(|one| one.points.len()).collect::<Vec<_>>(), [2, 1]);
    let mut other = open(&gpu, &[file.to_str().unwrap()]);
    assert!(other.viewer().measures == expected);
    let viewer = offscreen.viewer();
    viewer.undo(false);
    assert_eq!(viewer.measures.all.len(), 1);
    // What is no measure is refused.
    let text = std::fs::read_to_string(&file).unwrap().replace("\"per_world\": 0.5", "\"per_world\": -0.5");
    std::fs::write(&file, text).unwrap();
    other.viewer().drop_file(&file);
    let problem = other.settle().err().map(|problem| format!("{problem:#}")).unwrap_or_default();
    let said: String = other.viewer().messages.shown().iter().map(|message| message.text.as_str()).collect();
    assert!((problem + &said).contains("unit of length is not over 0"));
}
