//! Procedural scenes that surround the camera, seen from their middle on both paths.

use glam::DVec3;
use smalto::camera::path;
use smalto::pixels::Pixels;
use smalto::procedural::Procedural;
use smalto::scene::Focus;

use crate::common::agree::agrees;

/// Four views of a turn in the middle of a scene, each held against the reference.
fn looks_around(name: &str) -> Vec<Pixels> {
    let scene = Procedural::parse(name).unwrap().unwrap().make().unwrap().gaussians;
    let focus = Focus::of(&scene);
    let views = path::turn(DVec3::from(focus.centre), focus.radius, [72, 48], 4);
    views.iter().map(|view| agrees(name, &scene, view)).collect()
}

/// The mean colour and alpha of some rows of a picture.
fn mean_of(pixels: &Pixels, rows: std::ops::Range<usize>) -> [f32; 4] {
    let width = pixels.size[0] as usize;
    let some = &pixels.rgba[rows.start * width..rows.end * width];
    std::array::from_fn(|i| some.iter().map(|pixel| pixel[i]).sum::<f32>() / some.len() as f32)
}

#[test]
fn a_room_surrounds_the_camera() {
    for (number, view) in looks_around("room:30000").iter().enumerate() {
        let alpha = mean_of(view, 0..48)[3];
        assert!(alpha > 0.97, "view {number}: one looks through the walls, alpha {alpha}");
    }
}

#[test]
fn a_plain_has_a_horizon() {
    for (number, view) in looks_around("plain:30000").iter().enumerate() {
        let (above, below) = (mean_of(view, 0..12), mean_of(view, 36..48));
        assert!(above[3] > 0.9 && below[3] > 0.9, "view {number}: {above:?}, {below:?}");
        assert!(above[2] > above[0], "view {number}: the sky is blue: {above:?}");
        assert!(below[1] > below[2], "view {number}: the ground is not: {below:?}");
    }
}
