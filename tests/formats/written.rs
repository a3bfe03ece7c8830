//! Everything that is written, read by independent decoders: every Gaussian is finite, has a unit rotation, and is the
//! one that was to be written.

use std::io::Cursor;
use std::path::PathBuf;

use super::independent::{self, Decoded};
use crate::common::captured;
use crate::common::table::{fixture, read};
use smalto::formats::{self, SceneFile};
use smalto::procedural::Procedural;
use smalto::scene::{Bounds, Builder, Gaussians, Raw};

type Decoder = fn(&[u8]) -> Vec<Decoded>;

/// The formats with their decoders, and the largest angle in degrees by which their steps turn a rotation.
const FORMATS: [(SceneFile, Decoder, f64); 7] = [
    (SceneFile::Ply, independent::ply, 1e-3),
    (SceneFile::Glb, independent::glb, 1e-3),
    (SceneFile::Spz { version: 3 }, independent::spz, 0.3),
    (SceneFile::Spz { version: 4 }, independent::spz, 0.3),
    (SceneFile::CompressedPly, independent::compressed_ply, 0.3),
    (SceneFile::Sog, independent::sog, 1.1),
    (SceneFile::Splat, independent::splat, 1.0),
];

/// Largest difference of the logarithm of a scale: half a step of SPZ is 1/32; a codebook of 256 has wider steps where
/// few scales are.
const SCALE_STEP: f32 = 0.25;

/// Half the angle between two rotations is that between their quaternions. Not a number if one of them is.
fn angle(a: [f32; 4], b: [f32; 4]) -> f64 {
    let [a, b] = [a, b].map(|q| glam::DQuat::from_array(q.map(f64::from)));
    let chord = (a - b).length().min((a + b).length());
    if chord.is_finite() { 4.0 * (chord / 2.0).min(1.0).asin().to_degrees() } else { f64::NAN }
}

/// Writes the scene in every format and compares what the independent decoder of the format reads.
fn every_format_is_decoded(name: &str, gaussians: &Gaussians) {
    for (format, decode, most) in FORMATS {
        let arranged = format.arranged(gaussians).unwrap();
        let mut file = Cursor::new(Vec::new());
        format.write(&arranged, false, &mut file).unwrap();
        let decoded = decode(&file.into_inner());
        assert_eq!(decoded.len(), arranged.len(), "{name} as {format:?}");
        let Bounds { low, high } = Bounds::of(&arranged);
        let extent = (0..3).map(|k| high[k] - low[k]).fold(0.0, f32::max);
        let mut worst = 0.0_f64;
        for (i, gaussian) in decoded.iter().enumerate() {
            let Decoded { mean, scale, rotation, opacity } = gaussian;
            let place = format!("Gaussian {i} of {name} as {format:?}, {:?}", arranged.rotations()[i]);
            let values = [&mean[..], scale, rotation, &[*opacity]].concat();
            assert!(values.iter().all(|v| v.is_finite()), "{place}: {values:?}");
            let length = rotation.iter().map(|v| v * v).sum::<f32>().sqrt();
            assert!((length - 1.0).abs() < 1e-5, "{place}: {rotation:?} has length {length}");
            let turned = angle(*rotation, arranged.rotations()[i]);
            assert!(turned < most, "{place}: {rotation:?} is turned by {turned} degrees");
            assert!((opacity - arranged.opacities()[i]).abs() <= 0.5 / 255.0 + 1e-5, "{place}: {opacity}");
            let far = (0..3).map(|k| (mean[k] - arranged.means()[i][k]).abs()).fold(0.0, f32::max);
            assert!(far <= 1e-3 * extent, "{place}: the mean moves by {far} of {extent}");
            for (stored, scale) in scale.iter().zip(arranged.scales()[i]) {
                // Smaller and larger ones are clamped.
                let is_near = !(1e-4..1e2).contains(&scale) || (stored / scale).ln().abs() < SCALE_STEP;
                assert!(is_near, "{place}: {stored} for a scale of {scale}");
            }
            worst = worst.max(turned);
        }
        println!("{name} as {format:?}: {} Gaussians, at most {worst:.4} degrees", decoded.len());
    }
}

/// Gaussians with these rotations, which need not be normalized.
fn with_rotations(rotations: &[[f64; 4]]) -> Gaussians {
    let mut builder = Builder::new(0, rotations.len()).unwrap();
    builder.extend(rotations.len(), |i, sh| {
        sh[0] = [0.25, 0.0, -0.25];
        let mean = [0, 7, 13].map(|shift| (i >> shift & 127) as f64);
        Raw { mean, log_scale: [-2.0, -3.0, -4.0], rotation: rotations[i], opacity_logit: 0.0 }
    });
    builder.finish().0
}

/// All signs and orders of components that are equal, nearly equal, or at the ends of their range.
#[test]
fn rotations_with_nearly_equal_components_are_written_for_every_reader() {
    let half = 0.5_f64.sqrt();
    let bases = [
        [0.600_66, -0.391_92, -0.000_69, 0.696_86],
        [half, half, 0.0, 0.0],
        [half, half, 1e-4, -1e-4],
        [0.5, 0.5, 0.5, 0.5],
        [0.5774, 0.5773, 0.5773, 0.0],
        [0.577_35, 0.577_35, 0.577_35, 1e-3],
        [1.0, 0.0, 0.0, 0.0],
        [1.0, 1e-3, -1e-3, 1e-30],
    ];
    let mut rotations = Vec::new();
    for base in bases {
        // Steps of a quarter of the finest that a format has, around the components.
        for nudge in 0..625_u32 {
            let nudges = [1, 5, 25, 125].map(|place| f64::from(nudge / place % 5) - 2.0);
            let signs = [1, 2, 4, 8].map(|bit| if nudge & bit == 0 { 1.0 } else { -1.0 });
            let q: [f64; 4] = std::array::from_fn(|i| signs[i] * (base[i] + 0.000_35 * nudges[i]));
            rotations.extend((0..4).map(|turn| std::array::from_fn(|i| q[(i + turn) % 4])));
        }
    }
    every_format_is_decoded("nearly equal components", &with_rotations(&rotations));
}

#[test]
fn random_rotations_are_written_for_every_reader() {
    let mut random = crate::common::Random(7);
    let rotations: Vec<_> = (0..100_000).map(|_| [(); 4].map(|()| random.between(-1.0, 1.0))).collect();
    every_format_is_decoded("random rotations", &with_rotations(&rotations));
}

#[test]
fn every_fixture_is_written_for_every_reader() {
    let mut count = 0;
    for entry in std::fs::read_dir(fixture("")).unwrap() {
        let path: PathBuf = entry.unwrap().path();
        let ending = path.extension().unwrap_or_default().to_string_lossy().into_owned();
        if formats::FORMATS.iter().any(|format| format.name == ending) {
            every_format_is_decoded(&path.file_name().unwrap().to_string_lossy(), &read(&path).gaussians);
            count += 1;
        }
    }
    assert!(count > 30, "{count} fixtures");
    let cactus = Procedural::parse("cactus:20000").unwrap().unwrap().make().unwrap();
    every_format_is_decoded("cactus", &cactus.gaussians);
}

#[test]
#[ignore = "needs the captured scenes (SMALTO_TEST_SCENES)"]
fn captured_scenes_are_written_for_every_reader() {
    for name in ["biker.spz", "biker.compressed.ply", "playbot.sog", "plush-215k.spz"] {
        every_format_is_decoded(name, &read(&captured(name)).gaussians);
    }
}
