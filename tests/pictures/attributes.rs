//! Attributes of Gaussians shown in false colour, against the f64 reference.

use crate::common::listed::Listed;
use crate::common::{Gpu, ROUNDING};
use glam::{DMat3, DQuat, DVec3};
use smalto::camera::Camera;
use smalto::options::{Options, Storage};
use smalto::pixels::Pixels;
use smalto::reference::{self};
use smalto::render::{Attribute, Look};
use smalto::scene::{Gaussians, harmonics};

use super::inspect::{Case, captured_case, cases, inspect, look, still_of};

const ATTRIBUTES: [Attribute; 10] = [
    Attribute::Depth,
    Attribute::Normal,
    Attribute::Opacity,
    Attribute::Size,
    Attribute::Anisotropy,
    Attribute::BaseColour,
    Attribute::Identity,
    Attribute::Level,
    Attribute::PredictedError,
    Attribute::Lag,
];

fn attribute(attribute: Attribute, scene: &Gaussians, id: u32, camera: &Camera) -> DVec3 {
    let i = id as usize;
    let scale = scene.scales()[i].map(f64::from);
    let (longest, shortest) = (scale.into_iter().fold(0.0, f64::max), scale.into_iter().fold(f64::MAX, f64::min));
    let mean = DVec3::from(scene.means()[i].map(f64::from));
    match attribute {
        Attribute::Depth => DVec3::splat(camera.view(mean).z),
        Attribute::Normal => {
            let [w, x, y, z] = scene.rotations()[i].map(f64::from);
            let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
            let normal = axes.col(scale.iter().position(|s| *s == shortest).unwrap());
            0.5 - 0.5 * normal * normal.dot(mean - camera.position).signum()
        }
        Attribute::Opacity => DVec3::splat(scene.opacities()[i].into()),
        Attribute::Size => DVec3::splat(longest.log2()),
        Attribute::Anisotropy => DVec3::splat((longest / shortest).log2()),
        Attribute::BaseColour => (0.5 + harmonics::C0 * DVec3::from(scene.sh(i)[0].map(f64::from))).max(DVec3::ZERO),
        Attribute::Identity => {
            let state = id.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
            let bytes = ((word >> 22) ^ word).to_le_bytes();
            0.2 + 0.8 / 255.0 * DVec3::new(bytes[0].into(), bytes[1].into(), bytes[2].into())
        }
        // What is read whole has no nodes.
        Attribute::Level | Attribute::Lag => DVec3::ZERO,
        Attribute::PredictedError => DVec3::splat(-12.0),
    }
}

/// The reference's pixels, each splat in its Gaussian's attribute, and whether each is free of doubt; and the largest
/// attribute.
fn recoloured(mut lists: Listed, shown: Attribute, scene: &Gaussians, camera: &Camera) -> (Vec<reference::Pixel>, f64) {
    let certain = lists.blend();
    for (splat, id) in lists.splats.iter_mut().zip(&lists.gaussians) {
        splat.colour = attribute(shown, scene, *id, camera);
    }
    let largest = lists.splats.iter().map(|s| s.colour.abs().max_element()).fold(0.0, f64::max);
    let of_both =
        |(pixel, certain): (reference::Pixel, reference::Pixel)| reference::Pixel { doubt: certain.doubt, ..pixel };
    (lists.blend().into_iter().zip(certain).map(of_both).collect(), largest)
}

/// Largest and mean difference, alpha included, over the largest attribute; the largest where there is no doubt.
fn difference(pixels: &Pixels, (exact, scale): &(Vec<reference::Pixel>, f64)) -> [f64; 2] {
    let (mut largest, mut sum) = (0.0_f64, 0.0);
    for (pixel, exact) in pixels.rgba.iter().zip(exact) {
        let alpha = (f64::from(pixel[3]) - (1.0 - exact.transmittance)).abs();
        let error = (0..3).map(|i| (f64::from(pixel[i]) - exact.colour[i]).abs() / scale).fold(alpha, f64::max);
        sum += error;
        largest = largest.max(if exact.doubt > 0.0 { 0.0 } else { error });
    }
    [largest, sum / exact.len() as f64]
}

#[test]
fn attributes_are_shown_in_false_colour() {
    check_attributes(&cases());
}

#[test]
#[ignore = "needs the captured scenes (SMALTO_TEST_SCENES)"]
fn attributes_are_shown_in_false_colour_in_a_captured_scene() {
    check_attributes(&captured_case());
}

fn check_attributes(cases: &[Case]) {
    let gpu = Gpu::new();
    let stored = |storage| Options { sh_storage: storage, shape_storage: storage, ..Options::EXACT };
    let floats = Options { portable: true, ..stored(Storage::F32) };
    // What is kept in fewer bits has other ellipses too.
    let settings = [
        (Options::EXACT, ROUNDING, ROUNDING),
        (floats, ROUNDING, ROUNDING),
        (stored(Storage::F16), f64::MAX, 3e-4),
        (stored(Storage::U8), f64::MAX, 1e-2),
    ];
    for (scene, camera) in cases {
        let expected = ATTRIBUTES.map(|a| recoloured(Listed::of(scene, camera), a, scene, camera));
        for (options, most, most_in_mean) in settings {
            let mut still = still_of(&gpu, scene, &options);
            for (i, shown) in ATTRIBUTES.into_iter().enumerate() {
                let pixels = inspect(&mut still, camera, look(Look::Attribute(shown))).pixels;
                let [largest, mean] = difference(&pixels, &expected[i]);
                println!("{shown:?} in {:?}: {largest:.1e}, {mean:.1e}", options.shape_storage);
                assert!(largest <= most && mean <= most_in_mean, "{shown:?}: {largest:e}, {mean:e}");
                let [largest, mean] = difference(&pixels, &expected[(i + 1) % 7]);
                assert!(largest > 0.1 && mean > 0.03, "{shown:?} is told from another: {largest}, {mean}");
            }
        }
    }
}
