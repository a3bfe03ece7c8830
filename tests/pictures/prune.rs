//! The bound on what a picture changes by without some Gaussians, against the change in f64.

use glam::DVec3;
use smalto::camera::Camera;
use smalto::procedural::cactus;
use smalto::reference::{self, contributions};
use smalto::rules::{Background, Rules};
use smalto::scene::Gaussians;

use crate::common::agree::{GREEN, RED, ahead, ball};
use crate::common::cloud::{camera, cloud};
use crate::common::free::build;
use crate::common::{Random, gaussians};

/// Rounding of f64 over a list.
const ROUNDING: f64 = 1e-12;

/// The largest change of a pixel, after every pixel is compared with its bound; and the part of the bounds that is
/// reached at best.
fn within_bounds(name: &str, scene: &Gaussians, camera: &Camera, rules: &Rules, dropped: &[u32]) -> [f64; 2] {
    let is_kept = |index: u32| dropped.binary_search(&index).is_err();
    let kept: Vec<u32> = (0..scene.len() as u32).filter(|index| is_kept(*index)).collect();
    let mut found = [0.0_f64; 2];
    for background in [Background::BLACK, Background::Colour([1.0, 0.5, 0.0])] {
        let whole = reference::render(scene, camera, rules, background);
        let pruned = reference::render(&scene.selected(&kept).unwrap(), camera, rules, background);
        let bounds = reference::changes(scene, camera, rules, background, is_kept);
        for ((a, b), bound) in whole.pixels.iter().zip(&pruned.pixels).zip(&bounds) {
            let change = (0..3).map(|i| (a.colour[i] - b.colour[i]).abs()).fold(0.0, f64::max);
            assert!(change <= bound.bound + ROUNDING, "{name}: a change of {change:e} passes {bound:?}");
            found = [found[0].max(change), found[1].max(change / bound.bound.max(1e-9))];
        }
    }
    found
}

#[test]
fn no_change_passes_its_bound() {
    let mut reached: f64 = 0.0;
    for seed in 0..12 {
        let mut random = Random(seed);
        let scene = build(&cloud(&mut random, 400, 2, 0.3), 2);
        let dropped: Vec<u32> = (0..400).filter(|_| random.below(2 + seed as u32) == 0).collect();
        for rules in [Rules::TRAINED, Rules::KHR, Rules { antialiased: true, ..Rules::GSPLAT }] {
            let [change, part] = within_bounds("cloud", &scene, &camera(), &rules, &dropped);
            assert!(change > 1e-3, "something changes");
            reached = reached.max(part);
        }
    }
    assert!(reached > 0.9, "the bound is not loose: at best {reached} of it are reached");
}

/// Walls stop pixels early. Without some of them, pixels stop elsewhere, and what was hidden shows.
#[test]
fn no_change_passes_its_bound_where_pixels_stop_elsewhere() {
    let mut random = Random(9);
    for round in 0..40 {
        let walls: Vec<_> = (0..12)
            .map(|i| {
                let place = [random.between(-0.5, 0.5), random.between(-0.5, 0.5), 2.0 + 0.1 * f64::from(i)];
                let colour = if random.below(2) == 0 { RED } else { GREEN };
                (ball(place, random.between(0.3, 3.0), random.between(0.8, 0.99999)), colour)
            })
            .collect();
        let dropped: Vec<u32> = (0..12).filter(|_| random.below(3) == 0).collect();
        let name = format!("walls {round}");
        within_bounds(&name, &gaussians(&walls), &ahead([24, 16], 20.0), &Rules::TRAINED, &dropped);
    }
}

/// Gaussians without a share of any pixel can be left out, and nothing changes at all.
#[test]
fn what_has_no_share_is_not_missed() {
    let scene = cactus(4000).unwrap().gaussians;
    let camera = Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), [80, 60], 0.9);
    let found = contributions(&scene, &camera, &Rules::TRAINED);
    let unseen: Vec<u32> = (0..scene.len() as u32).filter(|index| found[*index as usize].largest == 0.0).collect();
    assert!(unseen.len() > 100 && unseen.len() < scene.len(), "{} are unseen", unseen.len());
    let [change, _] = within_bounds("unseen", &scene, &camera, &Rules::TRAINED, &unseen);
    assert_eq!(change, 0.0);
}

/// The shares of a pixel and the light that is left make up one, so all shares and what is left make up all pixels.
#[test]
fn shares_and_what_is_left_make_up_the_picture() {
    let scene = build(&cloud(&mut Random(2), 300, 0, 0.0), 0);
    let rules = Rules { transmittance_min: 0.0, ..Rules::TRAINED };
    let sum: f64 = contributions(&scene, &camera(), &rules).iter().map(|share| share.sum).sum();
    let picture = reference::render(&scene, &camera(), &rules, Background::BLACK);
    let left: f64 = picture.pixels.iter().map(|pixel| pixel.transmittance).sum();
    assert!((sum + left - picture.pixels.len() as f64).abs() < 1e-8 * sum, "{sum} and {left}");
}
