//! The town: its facades are opaque, and its first view is one of a street in daylight.

use glam::DVec3;
use smalto::camera::{Camera, path};
use smalto::procedural::Procedural;
use smalto::procedural::TownPath;
use smalto::reference;
use smalto::rules::{Background, Rules};
use smalto::scene::Gaussians;

use crate::common::agree::agrees;

fn town(count: usize) -> (Procedural, Gaussians) {
    let town = Procedural::parse(&format!("town:{count}")).unwrap().unwrap();
    (town, town.make().unwrap().gaussians)
}

/// The Gaussians up to this distance to the side of an eye: the facade there and nothing behind it.
fn near(gaussians: &Gaussians, eye: DVec3, aside: DVec3, distance: f64) -> Gaussians {
    let is_near = |mean: &[f32; 3]| (0.0..distance).contains(&(DVec3::from(mean.map(f64::from)) - eye).dot(aside));
    let means = gaussians.means().iter().enumerate();
    let indices: Vec<u32> = means.filter(|(_, mean)| is_near(mean)).map(|(i, _)| i as u32).collect();
    gaussians.selected(&indices).unwrap()
}

/// The share of pixels of facades, seen from the street, through which less than 1e-4 of the light comes.
fn opaque_share(count: usize) -> f64 {
    let (procedural, gaussians) = town(count);
    // Without the stop of blending, which ends before transmittance falls below 1e-4.
    let rules = Rules::TRAINED.complete();
    let mut pixels = Vec::new();
    let views = procedural.views(TownPath::Street, 24).unwrap();
    // Between the first two crossings there are houses on both sides.
    let is_between = |eye: &DVec3| (-50.0..-12.0).contains(&eye.x) && eye.z.abs() < 8.0;
    for [eye, target] in views.into_iter().filter(|[eye, _]| is_between(eye)) {
        let ahead = (target - eye).normalize();
        for aside in [DVec3::new(-ahead.z, 0.0, ahead.x), DVec3::new(ahead.z, 0.0, -ahead.x)] {
            // Streets are up to 15 metres wide, and houses 11 deep.
            let facade = near(&gaussians, eye, aside, 11.5);
            let at = eye + 7.0 * aside - 4.0 * DVec3::Y;
            let camera = Camera::looking_upright([eye, at], -DVec3::Y, [32, 24], 0.6);
            let drawn = reference::render(&facade, &camera, &rules, Background::BLACK).pixels;
            pixels.extend(drawn.iter().map(|pixel| pixel.transmittance));
        }
    }
    assert!(pixels.len() >= 4 * 32 * 24, "some facades are seen");
    pixels.iter().filter(|light| **light < 1e-4).count() as f64 / pixels.len() as f64
}

#[test]
fn facades_let_no_light_through() {
    for count in [100_000, 600_000] {
        let share = opaque_share(count);
        println!("town:{count}: {share}");
        assert!(share > 0.98, "town:{count}: {share} of the pixels are opaque");
    }
}

#[test]
fn a_town_is_bright_and_closed_on_both_paths() {
    let (procedural, gaussians) = town(30_000);
    for name in [TownPath::Street, TownPath::Roof, TownPath::Air] {
        let views = path::looking(&procedural.views(name, 3).unwrap(), [72, 48]);
        for (number, view) in views.iter().enumerate() {
            let drawn = agrees("town", &gaussians, view);
            let mean = |i: usize| drawn.rgba.iter().map(|pixel| pixel[i]).sum::<f32>() / drawn.rgba.len() as f32;
            assert!(mean(3) > 0.97, "{} {number}: alpha {}", name.name(), mean(3));
            assert!(mean(1) > 0.15, "{} {number}: green {}", name.name(), mean(1));
        }
    }
}
