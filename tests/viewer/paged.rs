//! Several scenes in pages of one cache, and scenes at places of a list.

use std::path::PathBuf;

use smalto::options::Options;
use smalto::pagefile::write::{Job, Settings, write_whole};
use smalto::pixels::Pixels;
use smalto::procedural::Procedural;
use smalto::scene::SceneInstances;
use smalto::viewer::{Offscreen, Setup};

use super::frames::{open, setup, shown};
use crate::common::Gpu;
use crate::common::program::{ok, path};

fn max_error(a: &Pixels, b: &Pixels) -> f32 {
    let apart = |(a, b): (&[f32; 4], &[f32; 4])| (0..3).map(|i| (a[i] - b[i]).abs()).fold(0.0, f32::max);
    a.rgba.iter().zip(&b.rgba).map(apart).fold(0.0, f32::max)
}

/// A page file with levels of detail.
fn with_levels(folder: &std::path::Path, scene: &str) -> String {
    let output = folder.join(format!("{}.smalto", scene.replace(':', "-")));
    let settings = Settings { has_levels: true, ..Settings::default() };
    let job = Job::new(&output, settings, "test");
    write_whole(&job, &Procedural::parse(scene).unwrap().unwrap().make().unwrap()).unwrap();
    output.display().to_string()
}

fn exact(scenes: &[&str]) -> Setup {
    Setup { options: Options::EXACT, ..setup(scenes) }
}

/// Moves the second scene, and makes it smaller.
fn place(offscreen: &mut Offscreen) {
    let placement = &mut offscreen.viewer().scenes.layers[1].placement;
    (placement.translation, placement.rotation, placement.scale) = ([0.8, -0.3, 0.2], [10.0, 40.0, -5.0], 0.7);
    offscreen.settle().unwrap();
}

/// Two page files, of which one is open twice, and a scene in memory are drawn as the same scenes in memory are:
/// whole, placed, coarse, and with Gaussians of the one in memory deleted.
#[test]
fn streamed_scenes_and_others_share_a_window() {
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let names = ["cactus:9000", "few-large:300", "cactus:9000", "cactus:6000"];
    let files = names[..3].iter().map(|name| with_levels(folder.path(), name)).collect::<Vec<_>>();
    let scenes = [files[0].as_str(), files[1].as_str(), files[2].as_str(), names[3]];
    let mut paged = open(&gpu, exact(&scenes));
    let mut whole = open(&gpu, exact(&names));
    let view = whole.viewer().view.camera();
    // A file that is open twice at one place would hide that.
    for offscreen in [&mut paged, &mut whole] {
        offscreen.viewer().view.snap(&view);
        offscreen.viewer().scenes.layers[2].placement.translation = [-1.5, 0.0, 0.4];
        offscreen.viewer().scenes.layers[3].placement.translation = [1.6, 0.2, 0.9];
        offscreen.settle().unwrap();
    }
    let residency = paged.session.residency().unwrap();
    assert!(residency.missing == 0 && residency.is_settled() && residency.resident > 8, "{residency:?}");
    // Placed Gaussians are moved before or after rounding.
    let apart = max_error(&shown(&mut paged), &shown(&mut whole));
    assert!(apart <= 2.0 / 255.0, "{apart}");
    place(&mut paged);
    place(&mut whole);
    let apart = max_error(&shown(&mut paged), &shown(&mut whole));
    assert!(apart <= 2.0 / 255.0, "placed: {apart}");
    let fine = shown(&mut paged);
    // With fewer nodes each of the files is coarser, and none disappears.
    paged.viewer().options.splats = 2000;
    paged.settle().unwrap();
    let totals = paged.session.pair.first.as_ref().unwrap().frame.totals;
    let apart = max_error(&shown(&mut paged), &fine);
    assert!(apart > 0.05 && (5000..9000).contains(&totals.visible), "{apart}, {} visible", totals.visible);
    assert_eq!(gpu.0.validation_messages(), Vec::<String>::new());
}

/// With a splat budget, the levels of a streamed SOG are streamed like those of a page file that keeps them.
#[test]
fn levels_of_a_streamed_sog_are_streamed() {
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let [streamed, kept] = ["s/lod-meta.json", "kept.smalto"].map(|name| path(&folder, name));
    ok(&["lod", "cactus:40000", "-o", &streamed]);
    ok(&["lod", &streamed, "--keep-levels", "-o", &kept]);
    let of = |scene: &str, splats: u32| Setup { options: Options { splats, ..Options::EXACT }, ..setup(&[scene]) };
    let [mut own, mut expected] = [&streamed, &kept].map(|scene| open(&gpu, of(scene, 6000)));
    let residency = own.session.residency().unwrap();
    assert!(residency.missing == 0 && residency.is_settled() && residency.resident > 8, "{residency:?}");
    assert_eq!(max_error(&shown(&mut own), &shown(&mut expected)), 0.0);
    let whole = open(&gpu, of(&streamed, 0));
    assert!(whole.session.residency().is_none(), "without a limit, the finest level is in memory");
    assert_eq!(gpu.0.validation_messages(), Vec::<String>::new());
}

/// A scene at the places of a list is drawn as its copies are, and once again without the list.
#[test]
fn a_scene_is_drawn_at_places() {
    let (gpu, folder) = (Gpu::new(), tempfile::tempdir().unwrap());
    let list = folder.path().join("places.json");
    let text = r#"{"places": [{"position": [0, 0, 0]},
        {"position": [0.8, -0.3, 0.2], "rotation": [0.9, 0.1, 0.3, -0.2], "scale": 0.7}]}"#;
    std::fs::write(&list, text).unwrap();
    let places = SceneInstances::read(&list).unwrap();
    let mut placed = open(&gpu, Setup { places: Some((list.clone(), places.clone())), ..exact(&["cactus:3000"]) });
    let mut copies = open(&gpu, exact(&["cactus:3000", "cactus:3000"]));
    let transform = &places.all()[1];
    let (y, x, z) = transform.rotation().to_euler(glam::EulerRot::YXZ);
    let placement = &mut copies.viewer().scenes.layers[1].placement;
    placement.translation = transform.translation().to_array();
    (placement.rotation, placement.scale) = ([x, y, z].map(f64::to_degrees), transform.scale());
    let view = placed.viewer().view.camera();
    copies.viewer().view.snap(&view);
    copies.settle().unwrap();
    let apart = max_error(&shown(&mut placed), &shown(&mut copies));
    assert!(apart <= 2.0 / 255.0, "{apart}");
    // The project keeps the list.
    let project = folder.path().join("placed.project.json");
    placed.viewer().save_project(&project);
    let mut again = open(&gpu, setup(&[project.to_str().unwrap()]));
    assert_eq!(again.viewer().scenes.layers[0].places.as_ref().map(|(_, places)| places.all().len()), Some(2));
    assert!(shown(&mut again) == shown(&mut placed));
    // A list that is dropped replaces the one before; without a list the scene is drawn once.
    std::fs::write(&list, r#"{"places": [{"position": [5, 0, 0]}]}"#).unwrap();
    placed.viewer().drop_file(&PathBuf::from(&list));
    placed.settle().unwrap();
    assert!(max_error(&shown(&mut placed), &shown(&mut copies)) > 0.1);
    placed.viewer().scenes.layers[0].places = None;
    copies.viewer().scenes.layers[1].is_shown[0] = false;
    placed.viewer().messages = Default::default();
    placed.viewer().pictures.are_stale = true;
    placed.settle().unwrap();
    copies.settle().unwrap();
    assert!(shown(&mut placed) == shown(&mut copies));
}
