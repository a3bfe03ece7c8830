//! A search for scenes in which a preset breaks its promise to the reference.

use smalto::measure::metrics::Difference;
use smalto::options::{Options, Storage};
use smalto::packing::{Layout, Statistics};
use smalto::reference;
use smalto::rules::{Background, Rules};
use smalto::scene::Requirements;

use crate::common::agree::{ball, logit};
use crate::common::cloud::{camera, cloud};
use crate::common::free::{Free, build};
use crate::common::{Gpu, Random};

/// Scenes of every kind; `SMALTO_PROMISES=N` searches longer.
const ROUNDS: u32 = 2;

/// Changes a cloud of random Gaussians into a scene of this kind.
type Kind = (&'static str, fn(&mut Random, &mut Vec<Free>));

const KINDS: [Kind; 11] = [
    ("plain", |_, _| {}),
    ("a huge faint splat behind the camera", |random, all| {
        all[0].raw.mean = [0.0, 0.0, -random.between(1.0, 100.0)];
        huge(random, &mut all[0]);
    }),
    ("a huge faint splat in view", |random, all| huge(random, &mut all[0])),
    ("scales over 60 octaves", |random, all| {
        for one in all {
            let octaves = random.between(-50.0, 10.0);
            one.raw.log_scale = std::array::from_fn(|_| octaves * std::f64::consts::LN_2 + random.between(-1.0, 1.0));
            one.raw.opacity_logit = logit(random.between(0.01, 0.2));
        }
    }),
    ("needles", |random, all| {
        for one in all {
            let thin = random.between(-14.0, 0.0);
            one.raw.log_scale[random.below(3) as usize] += thin;
            one.raw.log_scale[random.below(3) as usize] += random.between(0.0, 2.0);
        }
    }),
    ("bright colours", |random, all| {
        let brightest = random.between(0.0, 6.0).exp();
        for one in all {
            one.sh[0] = one.sh[0].map(|v| (f64::from(v) * random.between(0.0, brightest)) as f32);
        }
    }),
    ("large harmonics that cancel", |random, all| {
        let most = random.between(0.0, 4.0).exp();
        for one in all {
            for coefficient in &mut one.sh[1..] {
                *coefficient = std::array::from_fn(|_| random.between(-most, most) as f32);
            }
        }
    }),
    ("faint layers", |random, all| {
        for one in all {
            one.raw.opacity_logit = logit(random.between(1.0 / 255.0, 0.02));
            one.raw.log_scale = one.raw.log_scale.map(|s| s + 1.5);
        }
    }),
    ("layers at the threshold", |random, all| {
        for one in all {
            one.raw.opacity_logit = logit((1.0 / 255.0) * random.between(0.99, 1.01));
            one.raw.log_scale = one.raw.log_scale.map(|s| s + 3.0);
        }
    }),
    ("nearly opaque", |random, all| {
        for one in all {
            one.raw.opacity_logit = random.between(3.0, 12.0);
        }
    }),
    ("depths over nine orders of magnitude", |random, all| {
        for one in all {
            let far = random.between(0.0, 20.0).exp();
            one.raw.mean = one.raw.mean.map(|v| v * far);
            one.raw.log_scale = one.raw.log_scale.map(|s| s + far.ln());
        }
    }),
];

fn huge(random: &mut Random, one: &mut Free) {
    one.raw.log_scale = [random.between(10.0, 80.0); 3];
    one.raw.opacity_logit = logit(random.between(0.005, 0.02));
}

/// Presets with their promises: the least PSNR in dB and the largest difference of an 8-bit value.
const PROMISES: [(&str, f64, u8); 4] =
    [("exact", 90.0, 3), ("balanced", 60.0, 3), ("fast", 50.0, u8::MAX), ("preview", 40.0, u8::MAX)];

/// Kinds in which `fast` and `preview` keep no promise: a fog of splats near their thresholds, and colours far above
/// white.
const OF_EXACT_AND_BALANCED: [&str; 4] =
    ["bright colours", "large harmonics that cancel", "faint layers", "layers at the threshold"];

/// What a promise does not cover, in dB: in f32, a splat at the threshold may fall on its other side, and rounding
/// grows with the brightest colour.
fn allowance(kind: &str, brightest: f64) -> f64 {
    let at_threshold = if kind == "layers at the threshold" { 5.0 } else { 0.0 };
    at_threshold + 20.0 * (brightest / 4.0).max(1.0).log10()
}

#[test]
fn presets_keep_their_promises_in_hostile_scenes() {
    let rounds = std::env::var("SMALTO_PROMISES").ok().and_then(|n| n.parse().ok()).unwrap_or(ROUNDS);
    let gpu = Gpu::new();
    let mut broken = Vec::new();
    for round in 0..rounds {
        for (number, (kind, change)) in KINDS.into_iter().enumerate() {
            let mut random = Random(u64::from(round) << 32 | number as u64);
            let degree = random.below(4);
            let count = 60 + random.below(400) as usize;
            let mut all = cloud(&mut random, count, degree, 0.3);
            change(&mut random, &mut all);
            let scene = build(&all, degree);
            let brightest = Requirements::of(&scene).brightest;
            let expected = reference::render(&scene, &camera(), &Rules::TRAINED, Background::BLACK).to_pixels();
            let presets = if OF_EXACT_AND_BALANCED.contains(&kind) { &PROMISES[..2] } else { &PROMISES };
            for (preset, least_db, most_steps) in presets {
                let pixels = gpu.render(&scene, &camera(), &Options::preset(preset).unwrap());
                let Difference { psnr_db, largest_step, .. } = Difference::between(&pixels, &expected);
                let db = psnr_db.unwrap_or(f64::INFINITY);
                if db < least_db - allowance(kind, brightest) || largest_step > *most_steps {
                    broken.push(format!("{kind}, round {round}: {preset} is {db:.1} dB, {largest_step} steps"));
                }
            }
        }
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn sixteen_bits_hold_scales_over_63_octaves() {
    for (octaves, storage) in [(28, Storage::F16), (36, Storage::F16), (63, Storage::F16), (65, Storage::F32)] {
        let ball = |log2: f64| Free { raw: ball([0.0, 0.0, 5.0], log2.exp2(), 0.123), sh: vec![[0.3; 3]] };
        let scene = build(&[ball(20.0), ball(20.0 - f64::from(octaves))], 0);
        let layout = Layout::of(&Statistics::of(&scene), &Options::BALANCED);
        assert_eq!(layout.shape.storage, storage, "{octaves} octaves");
    }
}
