//! Selections, what is done with them, handles, and projects.

use egui::{Event, Key, Modifiers, PointerButton, pos2};
use glam::{DVec2, DVec3};
use smalto::camera::Camera;
use smalto::formats::SceneFile;
use smalto::options::Options;
use smalto::pixels::Pixels;
use smalto::reference;
use smalto::render::{Outline, SelectionMode};
use smalto::scene::Gaussians;
use smalto::viewer::{Change, CompareTarget, Counts, Offscreen, Property, Selection, Setup, Tab, Tool};

use super::frames::setup;
use super::interaction::{frame, key};
use crate::common::Gpu;

const WINDOW: [u32; 2] = [700, 240];

/// A window with the page of edits.
fn editing(gpu: &Gpu, scenes: &[&str]) -> Offscreen {
    let mut offscreen = Offscreen::new(Setup { hides_panels: false, ..setup(scenes) }, &gpu.0, WINDOW).unwrap();
    offscreen.viewer().panels.recent.tab = Tab::Edit;
    offscreen.settle().unwrap();
    offscreen
}

/// The Gaussians that are drawn.
fn gaussians(offscreen: &Offscreen) -> Gaussians {
    let edited = offscreen.session.pair.first.as_ref().unwrap().plan.edited();
    Gaussians::clone(&*edited.unwrap())
}

/// Moves along these places with the left button held.
fn stroke(offscreen: &mut Offscreen, way: &[[f32; 2]], modifiers: Modifiers) {
    let at = |place: [f32; 2]| pos2(place[0], place[1]);
    let button = |pos, pressed| Event::PointerButton { pos, button: PointerButton::Primary, pressed, modifiers };
    let (first, last) = (at(way[0]), at(way[way.len() - 1]));
    frame(offscreen, vec![Event::PointerMoved(first), button(first, true)]);
    frame(offscreen, way[1..].iter().map(|place| Event::PointerMoved(at(*place))).collect());
    frame(offscreen, vec![button(last, false)]);
    offscreen.settle().unwrap();
}

/// The indices of the Gaussians whose centres are seen where `is_inside` is true.
fn seen(gaussians: &Gaussians, view: &Camera, is_inside: &dyn Fn(DVec2) -> bool) -> Vec<u32> {
    let is_seen = |i: &u32| {
        let place = view.view(DVec3::from(gaussians.means()[*i as usize].map(f64::from)));
        place.z > 0.05 && is_inside(place.truncate() / place.z * view.focal_px + view.centre_px)
    };
    (0..gaussians.len() as u32).filter(is_seen).collect()
}

fn drawn(offscreen: &Offscreen) -> Pixels {
    offscreen.session.pair.first.as_ref().unwrap().renderer.pixels().unwrap()
}

fn press(offscreen: &mut Offscreen, which: Key, modifiers: Modifiers) {
    let release = Event::Key { key: which, physical_key: None, pressed: false, repeat: false, modifiers };
    frame(offscreen, vec![key(which, modifiers), release]);
    offscreen.settle().unwrap();
}

/// Selected with the mouse, deleted, undone, written: as the centres of the Gaussians say, bit for bit.
#[test]
fn what_is_selected_in_the_picture_is_deleted_and_comes_back() {
    let gpu = Gpu::new();
    let folder = tempfile::tempdir().unwrap();
    let mut offscreen = editing(&gpu, &["cactus:2000"]);
    let (all, view, first) = (gaussians(&offscreen), offscreen.viewer().view.camera(), drawn(&offscreen));
    let options = offscreen.viewer().options;
    let of = |offscreen: &mut Offscreen| offscreen.viewer().scenes.edit_counts();
    // Look turns the view, a tool does not.
    offscreen.viewer().editing.tool = Tool::Rectangle;
    stroke(&mut offscreen, &[[20.0, 30.0], [90.0, 100.0], [150.0, 180.0]], Modifiers::NONE);
    let rectangle = Outline::Rectangle(DVec2::new(150.0, 180.0), DVec2::new(20.0, 30.0));
    let inside = seen(&all, &view, &|place| rectangle.contains(place));
    assert!(offscreen.viewer().view.camera() == view && (50..1900).contains(&inside.len()), "{}", inside.len());
    assert_eq!(of(&mut offscreen), Counts { selected: inside.len(), hidden: 0, deleted: 0 });
    // It is shown in another colour, and written in its own.
    assert!(drawn(&offscreen) != first);
    offscreen.viewer().export.picture = folder.path().join("selected.png").display().to_string();
    press(&mut offscreen, Key::F12, Modifiers::NONE);
    let written = Pixels::read(&folder.path().join("selected.png")).unwrap();
    assert!(written.to_rgb8() == first.to_rgb8());
    // Shift adds what a lasso goes around, Ctrl takes away what a brush paints over.
    offscreen.viewer().editing.tool = Tool::Lasso;
    let corners = [[100.0, 20.0], [330.0, 40.0], [300.0, 220.0]];
    stroke(&mut offscreen, &corners, Modifiers::SHIFT);
    let lasso = Outline::Lasso(corners.map(|corner: [f32; 2]| DVec2::from(corner.map(f64::from))).to_vec());
    let either = seen(&all, &view, &|place| rectangle.contains(place) || lasso.contains(place));
    assert_eq!(of(&mut offscreen).selected, either.len());
    assert!(either.len() > inside.len());
    (offscreen.viewer().editing.tool, offscreen.viewer().editing.brush_px) = (Tool::Brush, 15.0);
    let way = [[100.0, 100.0], [160.0, 100.0]];
    stroke(&mut offscreen, &way, Modifiers::COMMAND);
    let brush = Outline::Brush(way.map(|place: [f32; 2]| DVec2::from(place.map(f64::from))).to_vec(), 15.0);
    let left = |place| (rectangle.contains(place) || lasso.contains(place)) && !brush.contains(place);
    let selected = seen(&all, &view, &left);
    assert_eq!(of(&mut offscreen).selected, selected.len());
    assert!(selected.len() < either.len());
    let generation = |offscreen: &Offscreen| offscreen.session.pair.first.as_ref().unwrap().generation;
    let made = generation(&offscreen);
    press(&mut offscreen, Key::Delete, Modifiers::NONE);
    assert_eq!(of(&mut offscreen), Counts { selected: 0, hidden: 0, deleted: selected.len() });
    let kept: Vec<u32> = (0..all.len() as u32).filter(|i| selected.binary_search(i).is_err()).collect();
    let rest = all.selected(&kept).unwrap();
    assert!(drawn(&offscreen) == gpu.render(&rest, &view, &options), "the rest is drawn as if it were all");
    let (_, left_out) = offscreen.viewer().command_line(smalto::viewer::Program::Render);
    assert!(left_out.contains(&"what is hidden or deleted".to_owned()), "{left_out:?}");
    // What is saved is what stayed, as `smalto convert` would write it.
    let file = folder.path().join("rest.ply");
    offscreen.viewer().save_scene(&file);
    offscreen.settle().unwrap();
    let mut bytes = Vec::new();
    SceneFile::Ply.write(&rest, false, &mut bytes).unwrap();
    assert!(std::fs::read(&file).unwrap() == bytes);
    // A format that rounds says what it changes; one that does not exist is refused.
    offscreen.viewer().save_scene(&folder.path().join("rest.spz"));
    offscreen.settle().unwrap();
    let said = offscreen.viewer().messages.shown().last().unwrap().text.clone();
    assert!(said.contains("the format changes position by up to"), "{said}");
    offscreen.viewer().save_scene(&folder.path().join("rest.xyz"));
    assert!(offscreen.settle().is_err());
    offscreen.viewer().messages.close_errors();
    for _ in 0..4 {
        press(&mut offscreen, Key::Z, Modifiers::COMMAND);
    }
    assert_eq!(of(&mut offscreen), Counts::default());
    assert!(drawn(&offscreen) == first, "every bit of the first picture");
    press(&mut offscreen, Key::Y, Modifiers::COMMAND);
    assert_eq!(of(&mut offscreen).selected, inside.len());
    assert_eq!(generation(&offscreen), made, "nothing is brought to the GPU again");
}

/// A number as messages write it.
fn in_words(number: usize) -> String {
    if number < 1000 { number.to_string() } else { format!("{},{:03}", number / 1000, number % 1000) }
}

/// Tools select while they are dragged, and go back where the drag is cancelled. Nothing is uploaded again.
#[test]
fn tools_select_while_they_are_dragged() {
    let gpu = Gpu::new();
    let mut offscreen = editing(&gpu, &["cactus:2000"]);
    let generation = |offscreen: &Offscreen| offscreen.session.pair.first.as_ref().unwrap().generation;
    let (first, before) = (generation(&offscreen), drawn(&offscreen));
    let counts = |offscreen: &mut Offscreen| {
        offscreen.settle().unwrap();
        offscreen.viewer().scenes.edit_counts()
    };
    let at = |place: [f32; 2]| pos2(place[0], place[1]);
    let button = |place: [f32; 2], pressed| Event::PointerButton {
        pos: at(place),
        button: PointerButton::Primary,
        pressed,
        modifiers: Modifiers::NONE,
    };
    for tool in [Tool::Rectangle, Tool::Lasso, Tool::Brush, Tool::Ball] {
        offscreen.viewer().editing.tool = tool;
        // From the body of the cactus on, which has centres around it.
        let way = [[180.5, 100.5], [200.0, 130.0], [230.0, 180.0], [280.0, 150.0]];
        frame(&mut offscreen, vec![Event::PointerMoved(at(way[0])), button(way[0], true)]);
        let mut seen = Vec::new();
        for place in &way[1..] {
            frame(&mut offscreen, vec![Event::PointerMoved(at(*place))]);
            seen.push(offscreen.viewer().scenes.edit_counts().selected);
        }
        assert!(seen[2] > seen[0] && seen[2] > 0, "{tool:?}: {seen:?}");
        assert!(drawn(&offscreen) != before, "{tool:?}: the selection is seen in the frame of the drag");
        frame(&mut offscreen, vec![key(Key::Escape, Modifiers::NONE)]);
        frame(&mut offscreen, vec![button(way[3], false)]);
        assert_eq!(counts(&mut offscreen), Counts::default(), "{tool:?} is cancelled");
        stroke(&mut offscreen, &way, Modifiers::NONE);
        let selected = counts(&mut offscreen).selected;
        assert_eq!(selected, seen[2], "{tool:?}: the same at once");
        assert!(drawn(&offscreen) != before);
        press(&mut offscreen, Key::Z, Modifiers::COMMAND);
        assert_eq!(counts(&mut offscreen), Counts::default(), "{tool:?}: one step");
        let said = offscreen.viewer().messages.shown().last().unwrap().text.clone();
        assert_eq!(said, format!("undone: selected Gaussians ({} to 0)", in_words(selected)));
        assert!(drawn(&offscreen) == before);
    }
    // A message makes a layout of two passes, the second of which comes between the end of a stroke and its last edit.
    let way = [[180.5, 100.5], [280.0, 150.0]];
    frame(&mut offscreen, vec![Event::PointerMoved(at(way[0])), button(way[0], true)]);
    frame(&mut offscreen, vec![Event::PointerMoved(at(way[1]))]);
    offscreen.viewer().messages.note("a message");
    frame(&mut offscreen, vec![button(way[1], false)]);
    assert!(counts(&mut offscreen).selected > 0);
    press(&mut offscreen, Key::Z, Modifiers::COMMAND);
    assert_eq!(counts(&mut offscreen), Counts::default(), "one step");
    let view = offscreen.viewer().view.camera();
    let all = gaussians(&offscreen);
    // A polygon is closed by its first corner.
    offscreen.viewer().editing.tool = Tool::Polygon;
    let corners = [[100.0, 60.0], [220.0, 70.0], [200.0, 200.0]];
    for place in corners.into_iter().chain([[102.0, 61.0]]) {
        stroke(&mut offscreen, &[place, place], Modifiers::NONE);
    }
    let polygon = Outline::Lasso(corners.map(|corner: [f32; 2]| DVec2::from(corner.map(f64::from))).to_vec());
    let inside = seen(&all, &view, &|place| polygon.contains(place)).len();
    let selected = counts(&mut offscreen).selected;
    assert!(inside > 20 && selected == inside, "{selected} of {inside}, {:?}", offscreen.viewer().editing.polygon);
    // A face of the box follows the pointer.
    let viewer = offscreen.viewer();
    viewer.editing.tool = Tool::Box;
    let corners = [DVec3::new(-0.6, -1.5, -0.6), DVec3::new(0.6, 0.2, 0.6)];
    viewer.editing.bounds = Some(corners);
    let (from, _) = view.projected(DVec3::new(0.6, -0.65, 0.0)).unwrap();
    let (to, _) = view.projected(DVec3::new(0.9, -0.65, 0.0)).unwrap();
    stroke(&mut offscreen, &[from.as_vec2().to_array(), to.as_vec2().to_array()], Modifiers::NONE);
    let [low, high] = offscreen.viewer().editing.bounds.unwrap();
    assert!((high.x - 0.9).abs() < 0.02 && low == corners[0] && high.y == corners[1].y, "{high}");
    let place = |i: &usize| DVec3::from(all.means()[*i].map(f64::from));
    let in_box = (0..all.len()).filter(|i| place(i).cmpge(low).all() && place(i).cmple(high).all()).count();
    assert!(in_box > 20 && counts(&mut offscreen).selected == in_box, "{in_box}");
    // The colour of the Gaussian that has the largest part of a pixel.
    offscreen.viewer().editing.tool = Tool::Colour;
    let explanation = offscreen.session.pair.first.as_mut().unwrap().renderer.explain([150, 120]).unwrap();
    let most = explanation.splats.iter().max_by(|a, b| a.share.total_cmp(&b.share)).unwrap().gaussian as usize;
    stroke(&mut offscreen, &[[150.5, 120.5], [150.5, 120.5]], Modifiers::NONE);
    let colour = |i: usize| all.sh(i)[0].map(|value| (0.5 + 0.2820948 * value).max(0.0));
    let is_alike = |i: &usize| {
        let apart = colour(*i).iter().zip(colour(most)).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        apart <= offscreen.session.viewer.editing.range[1]
    };
    let alike = (0..all.len()).filter(is_alike).count();
    let selected = counts(&mut offscreen).selected;
    assert!(alike > 5 && selected.abs_diff(alike) <= 1, "{selected} of {alike}");
    assert_eq!(generation(&offscreen), first, "nothing is brought to the GPU again");
}

/// What hides behind others or is too faint is left out, also where some Gaussians are hidden and a scene is moved.
#[test]
fn what_is_seen_is_selected() {
    let gpu = Gpu::new();
    let mut offscreen = editing(&gpu, &["cactus:3000", "few-large:60"]);
    offscreen.viewer().scenes.layers[1].placement.translation = [0.3, 0.0, 0.2];
    offscreen.viewer().pictures.are_stale = true;
    offscreen.settle().unwrap();
    let (view, options) = (offscreen.viewer().view.camera(), offscreen.viewer().options.untraded());
    let shares = |offscreen: &Offscreen| {
        let found = reference::contributions(&gaussians(offscreen), &view, &options.rules);
        found.into_iter().map(|share| share.largest).collect::<Vec<_>>()
    };
    // Those that lie within rounding of a limit may be selected or not.
    let between = |shares: &[f64], low: f64, high: f64| {
        let count = |low: f64, high: f64| shares.iter().filter(|share| (low..=high).contains(share)).count();
        count(low * 1.01, high * 0.99)..=count(low * 0.99, high * 1.01)
    };
    let selected = |offscreen: &mut Offscreen| {
        offscreen.settle().unwrap();
        offscreen.viewer().scenes.edit_counts().selected
    };
    let all = shares(&offscreen);
    offscreen.viewer().select(&Selection::Values(Property::Contribution, 0.02..=0.5), SelectionMode::Replace);
    let found = selected(&mut offscreen);
    assert!(between(&all, 0.02, 0.5).contains(&found) && (50..2900).contains(&found), "{found}");
    offscreen.viewer().change(Change::Hide);
    offscreen.settle().unwrap();

    offscreen.viewer().editing.only_visible = true;
    let everything = Selection::Box(DVec3::splat(-1e9), DVec3::splat(1e9));
    offscreen.viewer().select(&everything, SelectionMode::Replace);
    let left = shares(&offscreen);
    let found_now = selected(&mut offscreen);
    assert_eq!(left.len(), all.len() - found);
    let expected = between(&left, 1.0 / 255.0, 2.0);
    assert!(expected.contains(&found_now) && found_now < left.len(), "{found_now} of {expected:?}");
    // A preset whose scene culls more Gaussians finds nearly the same.
    for preset in [Options::FAST, Options::PREVIEW] {
        offscreen.viewer().options = preset;
        offscreen.settle().unwrap();
        offscreen.viewer().select(&everything, SelectionMode::Replace);
        let found = selected(&mut offscreen);
        assert!(found.abs_diff(found_now) < found_now / 10, "{found}, not {found_now}");
    }
}

#[test]
fn gaussians_are_selected_by_place_and_value() {
    let gpu = Gpu::new();
    let mut offscreen = editing(&gpu, &["cactus:2000"]);
    let all = gaussians(&offscreen);
    let selected = |offscreen: &mut Offscreen| {
        offscreen.settle().unwrap();
        offscreen.viewer().scenes.edit_counts().selected
    };
    for (property, range) in
        [(Property::Opacity, 0.0..=0.5), (Property::Scale, 0.05..=9.0), (Property::Anisotropy, 2.0..=5.0)]
    {
        let expected = (0..all.len()).filter(|i| range.contains(&property.value(&all, *i))).count();
        offscreen.viewer().select(&Selection::Values(property, range.clone()), SelectionMode::Replace);
        assert_eq!(selected(&mut offscreen), expected, "{property:?}");
    }
    let place = |i: usize| DVec3::from(all.means()[i].map(f64::from));
    let (low, high) = (DVec3::new(-1.0, -9.0, -1.0), DVec3::new(1.0, 0.0, 9.0));
    let in_box = (0..all.len()).filter(|i| place(*i).cmpge(low).all() && place(*i).cmple(high).all()).count();
    offscreen.viewer().select(&Selection::Box(low, high), SelectionMode::Replace);
    assert_eq!(selected(&mut offscreen), in_box);
    assert!((10..1990).contains(&in_box), "{in_box}");
    // A crop keeps the box, and what is hidden comes back.
    offscreen.viewer().change(Change::Crop);
    offscreen.viewer().change(Change::Hide);
    offscreen.settle().unwrap();
    let why = offscreen.session.viewer.why_nothing_is_seen(&offscreen.session.pair);
    assert!(why.is_some_and(|why| why.starts_with("no Gaussian is left")), "nothing is drawn");
    press(&mut offscreen, Key::B, Modifiers::SHIFT);
    assert_eq!(gaussians(&offscreen).len(), in_box);
    offscreen.viewer().change(Change::SelectNone);
    // A ball around the point that a pixel shows.
    offscreen.settle().unwrap();
    let rest = gaussians(&offscreen);
    let still = drawn(&offscreen);
    let row = still.size[1] / 2;
    let covered = (0..still.size[0]).find(|x| still.at(*x, row)[3] > 0.95).expect("something is seen");
    let pixel = [covered, row];
    let depth = offscreen.session.pair.first.as_mut().unwrap().renderer.depth_at(pixel).unwrap().unwrap();
    let view = offscreen.viewer().view.camera();
    let centre = view.unprojected(DVec2::new(f64::from(covered) + 0.5, f64::from(row) + 0.5), depth.into());
    offscreen.viewer().editing.tool = Tool::Ball;
    // Messages lie over the picture.
    offscreen.viewer().messages = Default::default();
    frame(&mut offscreen, Vec::new());
    let from = [covered as f32 + 0.5, row as f32 + 0.5];
    stroke(&mut offscreen, &[from, [from[0] + 20.0, from[1]]], Modifiers::NONE);
    let radius = 20.0 * f64::from(depth) / view.focal_px.x;
    let place = |i: usize| DVec3::from(rest.means()[i].map(f64::from));
    let expected = (0..rest.len()).filter(|i| place(*i).distance(centre) <= radius).count();
    assert_eq!(selected(&mut offscreen), expected);
    assert!(expected > 0);
}

/// What is separated is placed, coloured, saved and undone like a scene, and what was not touched keeps its bits.
#[test]
fn what_is_selected_becomes_a_scene_of_its_own() {
    let gpu = Gpu::new();
    let folder = tempfile::tempdir().unwrap();
    let mut offscreen = editing(&gpu, &["cactus:1500"]);
    let (all, first) = (gaussians(&offscreen), drawn(&offscreen));
    let low = Selection::Box(DVec3::new(-1e6, -0.4, -1e6), DVec3::splat(1e6));
    offscreen.viewer().select(&low, SelectionMode::Replace);
    offscreen.settle().unwrap();
    let is_low = |i: &u32| all.means()[*i as usize][1] >= -0.4;
    let (part, rest): (Vec<u32>, Vec<u32>) = (0..all.len() as u32).partition(is_low);
    assert!(part.len() > 50 && rest.len() > 50);
    offscreen.viewer().separate(false);
    offscreen.settle().unwrap();
    let viewer = offscreen.viewer();
    assert_eq!((viewer.scenes.layers.len(), viewer.scenes.layers[1].name.as_str()), (2, "cactus, part 1"));
    assert_eq!(viewer.scenes.edit_counts(), Counts { selected: 0, hidden: 0, deleted: part.len() });
    let layer = &mut offscreen.viewer().scenes.layers[1];
    layer.placement.translation = [0.0, 0.0, 1.5];
    layer.placement.rotation = [0.0, 30.0, 0.0];
    layer.appearance =
        serde_json::from_str(r#"{"tint": [1.0, 0.5, 0.25], "saturation": 0.5, "opacity": 0.75}"#).unwrap();
    let transform = layer.placement.transform().unwrap();
    let moved = layer.appearance.applied(all.selected(&part).unwrap().transformed(&transform).unwrap());
    offscreen.viewer().pictures.are_stale = true;
    frame(&mut offscreen, Vec::new());
    offscreen.settle().unwrap();
    let expected = Gaussians::joined([&all.selected(&rest).unwrap(), &moved].into_iter()).unwrap();
    assert!(gaussians(&offscreen).means() == expected.means() && gaussians(&offscreen).all_sh() == expected.all_sh());
    assert!(moved.opacities().iter().zip(&part).all(|(own, i)| *own == 0.75 * all.opacities()[*i as usize]));
    let file = folder.path().join("both.ply");
    offscreen.viewer().save_scene(&file);
    offscreen.settle().unwrap();
    let mut bytes = Vec::new();
    SceneFile::Ply.write(&expected, false, &mut bytes).unwrap();
    assert!(std::fs::read(&file).unwrap() == bytes, "saved as they are drawn; what was not touched has its bits");
    let (_, left_out) = offscreen.viewer().command_line(smalto::viewer::Program::Render);
    assert!(left_out.iter().any(|what| what.contains("colours")), "{left_out:?}");
    // A project has the part.
    let project = folder.path().join("parts.project.json");
    offscreen.viewer().save_project(&project);
    let mut other = editing(&gpu, &[project.to_str().unwrap()]);
    assert_eq!(other.viewer().scenes.layers[1].name, "cactus, part 1");
    assert!(drawn(&other) == drawn(&offscreen), "every bit of the picture");
    // A part of a part.
    other.viewer().scenes.layers[0].is_shown = [false; 2];
    other.viewer().select(&Selection::Values(Property::Opacity, 0.0..=0.3), SelectionMode::Replace);
    other.settle().unwrap();
    let counted = other.viewer().scenes.edit_counts().selected;
    other.viewer().separate(true);
    other.viewer().scenes.layers[1].is_shown = [false; 2];
    other.viewer().pictures.are_stale = true;
    frame(&mut other, Vec::new());
    other.settle().unwrap();
    let faint: Vec<u32> = part.iter().copied().filter(|i| all.opacities()[*i as usize] <= 0.3).collect();
    assert_eq!((gaussians(&other).len(), counted), (faint.len(), faint.len()));
    other.viewer().save_project(&project);
    let mut third = editing(&gpu, &[project.to_str().unwrap()]);
    assert_eq!(gaussians(&third).means(), gaussians(&other).means());
    assert_eq!(third.viewer().scenes.layers.len(), 3);
    // Undone step by step, to the first picture.
    for _ in 0..4 {
        press(&mut offscreen, Key::Z, Modifiers::COMMAND);
    }
    assert_eq!(offscreen.viewer().scenes.edit_counts(), Counts::default());
    assert!(drawn(&offscreen) == first, "every bit of the first picture");
}

/// Handles move a scene with the pointer, and three marks level it.
#[test]
fn a_scene_is_placed_by_handles_and_levelled_by_marks() {
    let gpu = Gpu::new();
    let mut offscreen = editing(&gpu, &["cactus:500"]);
    offscreen.viewer().editing.tool = Tool::Place;
    let view = offscreen.viewer().view.camera();
    let gizmo = offscreen.viewer().gizmo().unwrap();
    let at = |point: DVec3| {
        let seen = view.view(point);
        (seen.truncate() / seen.z * view.focal_px + view.centre_px).as_vec2()
    };
    let (centre, end) = (at(gizmo.centre), at(gizmo.end(0)));
    let begin = centre + (end - centre) * 0.6;
    let to = begin + (end - centre) * 0.5;
    stroke(&mut offscreen, &[begin.to_array(), to.to_array()], Modifiers::NONE);
    let viewer = offscreen.viewer();
    let moved = viewer.scenes.layers[0].placement.translation;
    let due = 0.5 * (gizmo.end(0) - gizmo.centre).length();
    assert!((moved[0] - due).abs() < 0.02 * due && moved[1..] == [0.0; 2], "{moved:?}, not {due}");
    assert!(viewer.view.camera() == view);
    press(&mut offscreen, Key::Z, Modifiers::COMMAND);
    assert_eq!(offscreen.viewer().scenes.layers[0].placement, Default::default());
    // The ground is tilted, then level.
    let viewer = offscreen.viewer();
    let tilt = glam::DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.3);
    let ground = [DVec3::ZERO, DVec3::X, DVec3::Z].map(|place| DVec3::new(0.2, 0.1, 0.3) + tilt * place);
    ground.into_iter().for_each(|point| viewer.measure(point));
    viewer.level_by_points(false);
    let transform = viewer.scenes.layers[0].placement.transform().unwrap();
    let level = ground.map(|place| transform.point(place).y);
    assert!(level.iter().all(|y| (y - level[0]).abs() < 1e-9), "{level:?}");
    assert!(transform.point(ground[0]).distance(ground[0]) < 1e-9, "the first point stays");
}

#[test]
fn views_go_along_the_axes_and_are_flat() {
    let gpu = Gpu::new();
    let mut offscreen = editing(&gpu, &["cactus:500"]);
    let viewer = offscreen.viewer();
    let pivot = viewer.view.navigator.pivot();
    let distance = viewer.view.camera().position.distance(pivot);
    for from in [DVec3::X, DVec3::NEG_Z, DVec3::Y, DVec3::NEG_Y] {
        viewer.view.look_from(from);
        viewer.view.navigator.advance(10.0);
        let view = viewer.view.camera();
        assert!(view.forward().distance(-from) < 1e-6 && view.position.distance(pivot + from * distance) < 1e-6);
    }
    let before = viewer.view.camera();
    let size = |view: &Camera| view.focal_px.x / view.view(pivot).z;
    let degrees = viewer.view.navigator.field_of_view();
    viewer.toggle_flat();
    let flat = viewer.view.camera();
    assert!(viewer.view.is_flat() && (size(&flat) / size(&before) - 1.0).abs() < 1e-9);
    // What lies one picture's width behind the pivot looks hardly smaller.
    let width = f64::from(flat.size_px[0]) / size(&flat);
    let behind = flat.focal_px.x / flat.view(pivot + flat.forward() * width).z;
    assert!((0.996..1.0).contains(&(behind / size(&flat))));
    // 32-bit floats suffice so far away.
    viewer.compare_with_reference();
    offscreen.settle().unwrap();
    let apart = offscreen.viewer().comparison.pair_difference.clone().expect("the pictures were compared");
    assert!(apart.difference.psnr_db.is_none_or(|psnr| psnr > 60.0), "{:?}", apart.difference);
    let viewer = offscreen.viewer();
    viewer.comparison.target = CompareTarget::Nothing;
    viewer.toggle_flat();
    let after = viewer.view.camera();
    assert!((viewer.view.navigator.field_of_view() - degrees).abs() < 1e-9);
    assert!(after.position.distance(before.position) < 1e-6 * distance);
    // Guides are drawn over the picture, not into it.
    let shown = |offscreen: &mut Offscreen| (offscreen.settle().unwrap(), offscreen.screen().unwrap()).1;
    let (bare, picture) = (shown(&mut offscreen), drawn(&offscreen));
    offscreen.viewer().panels.recent.shows_guides = true;
    frame(&mut offscreen, Vec::new());
    assert!(shown(&mut offscreen) != bare && drawn(&offscreen) == picture);
}

/// A window that opens a project shows what the other one showed.
#[test]
fn a_project_brings_everything_back() {
    let gpu = Gpu::new();
    let folder = tempfile::tempdir().unwrap();
    let mut offscreen = editing(&gpu, &["cactus:1500", "few-large:50"]);
    let cameras = folder.path().join("cameras.json");
    let camera = Camera::looking_at(DVec3::new(1.0, -2.0, -5.0), DVec3::ZERO, [320, 240], 1.1);
    smalto::camera::write(&cameras, &[smalto::camera::NamedCamera::new("a".to_owned(), camera)]).unwrap();
    offscreen.viewer().drop_file(&cameras);
    offscreen.settle().unwrap();
    let viewer = offscreen.viewer();
    viewer.view.navigator.orbit(DVec2::new(31.0, 7.0), [300, 240]);
    viewer.add_key();
    viewer.view.navigator.orbit(DVec2::new(9.0, -4.0), [300, 240]);
    viewer.add_key();
    viewer.film.timeline.set_rest(1, true);
    viewer.scenes.layers[1].placement.translation = [0.5, -0.25, 0.125];
    viewer.options.stop = 0.01;
    viewer.view.background = smalto::rules::Background::Colour([0.25, 0.5, 0.75]);
    viewer.select(&Selection::Values(Property::Opacity, 0.0..=0.6), SelectionMode::Replace);
    offscreen.settle().unwrap();
    offscreen.viewer().change(Change::Delete);
    offscreen.settle().unwrap();
    let file = folder.path().join("two");
    offscreen.viewer().save_project(&file);
    let file = folder.path().join("two.project.json");
    let text = std::fs::read_to_string(&file).unwrap();
    assert!(text.contains("\"cameras\": \"cameras.json\""), "seen from its folder: {text}");
    // The same size, so that the picture is the same.
    let mut other = editing(&gpu, &[file.to_str().unwrap()]);
    let [one, two] = [&mut offscreen, &mut other].map(|offscreen| {
        let viewer = offscreen.viewer();
        (
            viewer.view.camera(),
            viewer.options,
            viewer.film.timeline.clone(),
            viewer.scenes.edit_counts(),
            viewer.cameras.list.clone(),
        )
    });
    assert!(one == two, "{one:?}\n{two:?}");
    assert!(one.3.deleted > 0 && drawn(&other) == drawn(&offscreen), "every bit of the picture");
    assert!(other.viewer().view.navigator.pivot().distance(offscreen.viewer().view.navigator.pivot()) < 1e-9);
    // What is no project, or is of another scene, says so and loses nothing.
    for (from, to, expected) in [
        ("smalto project 1", "smalto project 9", "of the format \"smalto project 9\""),
        ("\"stop\"", "\"stopp\"", "no option \"stopp\""),
        ("cactus:1500", "cactus:1400", "other Gaussians"),
        ("cactus:1500", "none.ply", "none.ply"),
    ] {
        std::fs::write(&file, text.replace(from, to)).unwrap();
        let layers = other.viewer().scenes.layers.len();
        other.viewer().drop_file(&file);
        let problem = other.settle().err().map(|problem| format!("{problem:#}")).unwrap_or_default();
        let said: String = other.viewer().messages.shown().iter().map(|message| message.text.as_str()).collect();
        assert!(problem.contains(expected) || said.contains(expected), "{from}: {problem}; {said}");
        assert!(layers == 2 || from != "smalto project 1");
        other.viewer().messages.close_errors();
        other.viewer().messages.failure = None;
    }
}
