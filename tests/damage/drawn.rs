//! Damaged scenes that are still read, drawn by the GPU and compared with the reference.

use std::fs;

use smalto::options::Options;
use smalto::rules::Background;
use smalto::scene::{Bounds, Focus, Gaussians};
use smalto::{camera, reference};

use crate::change::{self, Change};
use crate::common::{Gpu, Random, compare};
use crate::subject::{self, Subject};
use crate::{kept, rounds};

/// Damaged scenes of every kind that are drawn.
const ROUNDS: usize = 3;
const SIZE: [u32; 2] = [48, 36];

/// Why a scene is not drawn: beyond this its camera or its colours leave the range of 32-bit floats.
fn is_drawable(gaussians: &Gaussians) -> bool {
    let Bounds { low, high } = Bounds::of(gaussians);
    let is_near = low.iter().chain(&high).all(|v| v.abs() < 1e30);
    let has_size = gaussians.scales().iter().flatten().all(|s| *s < 1e30);
    let is_dim = (0..gaussians.len()).all(|i| gaussians.sh(i).as_flattened().iter().all(|v| v.abs() < 1e3));
    is_near && has_size && is_dim && !gaussians.is_empty()
}

#[test]
fn damaged_scenes_are_drawn_as_the_reference_draws_them() {
    let folder = tempfile::tempdir().unwrap();
    let (mut drawn, mut refused) = (0, 0);
    for subject in subject::all(folder.path()) {
        if !std::ptr::fn_addr_eq(subject.reader, subject::scene as subject::Reader) {
            continue;
        }
        let mut random = Random(7 + subject.whole.len() as u64);
        for round in 0..rounds(ROUNDS) {
            let bytes = match subject.change {
                Change::Bytes => change::numbers(&subject.whole, &mut random),
                change => change.of(&subject.whole, &mut random),
            };
            fs::write(&subject.damaged, &bytes).unwrap();
            match subject::read_scene(&subject.opened) {
                Ok(scene) if is_drawable(&scene.gaussians) => {
                    agrees(&scene.gaussians, &subject, round, &bytes);
                    drawn += 1;
                }
                _ => refused += 1,
            }
        }
    }
    println!("{drawn} drawn, {refused} refused or out of range");
    assert!(drawn > refused / 4, "{drawn} drawn, {refused} refused: the damage is too strong to test pictures");
}

fn agrees(gaussians: &Gaussians, subject: &Subject, round: usize, bytes: &[u8]) {
    let Focus { centre, radius } = Focus::of(gaussians);
    let camera = &camera::path::orbit(centre.into(), radius, false, SIZE, 5)[round % 5];
    let exact = reference::render(gaussians, camera, &Options::EXACT.rules, Background::BLACK);
    let gpu = Gpu::new();
    for portable in [false, true] {
        let pixels = gpu.render(gaussians, camera, &Options { portable, ..Options::EXACT });
        let comparison = compare(&pixels, &exact);
        assert_eq!(comparison.unexplained, 0, "{comparison:?}, portable {portable}: {}", kept(subject, round, bytes));
    }
}
