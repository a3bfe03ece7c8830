//! The stages of pruning against their twins on the CPU: what Gaussians contribute, what is kept, what may change.

use glam::DVec3;
use smalto::camera::Camera;
use smalto::gpu::{DispatchSize, Stage};
use smalto::options::Options;
use smalto::packing::Statistics;
use smalto::procedural::cactus;
use smalto::reference::{self, Contribution};
use smalto::render::shaders::prune::{Keep, KeepBindings, KeepPush};
use smalto::render::{Pruner, Share};
use smalto::rules::{ALPHA_MIN, Background, Rules};
use smalto::scene::Gaussians;

use crate::common::agree::{GREEN, RED, ahead, ball};
use crate::common::cloud::cloud;
use crate::common::free::build;
use crate::common::{Gpu, Random, again_in_subgroups_of_four, gaussians};

const RULES: &Rules = &Rules::TRAINED;

/// Relative error of a share by f32: of an alpha, and of a transmittance behind many splats.
const SHARE_ERROR: f64 = 1e-3;

/// Half a unit of the sums of shares.
const HALF_UNIT: f64 = 1.0 / (1 << 25) as f64;

fn pruner(gpu: &Gpu, scene: &Gaussians) -> Pruner {
    Pruner::new(&gpu.0, scene, &Statistics::of(scene), &Options::EXACT).unwrap()
}

fn shares(gpu: &Gpu, scene: &Gaussians, views: &[Camera]) -> Vec<Share> {
    let mut pruner = pruner(gpu, scene);
    views.iter().for_each(|view| pruner.note(view).unwrap());
    pruner.shares().unwrap()
}

/// The contributions to all views.
fn exact(scene: &Gaussians, views: &[Camera]) -> Vec<Contribution> {
    let mut all = vec![Contribution::default(); scene.len()];
    for view in views {
        for (all, one) in all.iter_mut().zip(reference::contributions(scene, view, RULES)) {
            *all = Contribution { largest: all.largest.max(one.largest), sum: all.sum + one.sum };
        }
    }
    all
}

/// Views from around the cactus.
fn views(size: [u32; 2], count: usize) -> Vec<Camera> {
    let from = |i: usize| {
        let angle = i as f64 * 2.4;
        DVec3::new(4.5 * angle.sin(), -2.5, -4.5 * angle.cos())
    };
    (0..count).map(|i| Camera::looking_at(from(i), DVec3::new(0.0, -1.2, 0.0), size, 0.9)).collect()
}

#[test]
fn contribute_matches_its_twin() {
    let gpu = Gpu::new();
    let sizes = [[64, 64], [61, 35], [128, 16], [33, 65]];
    for (count, size) in [1, 255, 257, 1025, 4096, 20_000].into_iter().zip(sizes.into_iter().cycle()) {
        let scene = cactus(count).unwrap().gaussians;
        let views = views(size, 3);
        let (found, exact) = (shares(&gpu, &scene, &views), exact(&scene, &views));
        // An alpha at the threshold may fall on either side, and changes the light of all that is behind it.
        let decided = f64::from(ALPHA_MIN);
        let mut doubtful = 0;
        for (found, exact) in found.iter().zip(&exact) {
            let error = (f64::from(found.largest) - exact.largest).abs();
            assert!(error <= SHARE_ERROR * exact.largest + decided, "{found:?} for {exact:?}");
            doubtful += usize::from(error > SHARE_ERROR * exact.largest + 1e-6);
            let pixels = (exact.sum / exact.largest.max(1e-9)).ceil().max(1.0);
            let tolerance = 0.01 * exact.sum + 3.0 * decided + 256.0 * pixels * HALF_UNIT;
            assert!((found.sum - exact.sum).abs() <= tolerance, "{found:?} for {exact:?}");
        }
        assert!(doubtful <= 1 + count / 200, "{doubtful} of {count} differ");
        let sum = |all: &mut dyn Iterator<Item = f64>| all.sum::<f64>();
        let [found, exact] =
            [sum(&mut found.iter().map(|share| share.sum)), sum(&mut exact.iter().map(|share| share.sum))];
        assert!((found / exact - 1.0).abs() < 1e-3, "{found} for {exact}");
    }
}

/// A list that takes several passes on lavapipe, whose loops end early.
#[test]
fn contribute_and_bound_take_lists_of_any_length() {
    let gpu = Gpu::new();
    let mut random = Random(3);
    let layers: Vec<_> = (0..70_000)
        .map(|i| {
            let place = [random.between(-0.3, 0.3), random.between(-0.3, 0.3), 2.0 + 1e-4 * f64::from(i)];
            (ball(place, 0.05, random.between(0.005, 0.02)), if i % 2 == 0 { RED } else { GREEN })
        })
        .collect();
    let (scene, camera) = (gaussians(&layers), ahead([16, 16], 20.0));
    let views = [camera.clone()];
    let (found, exact) = (shares(&gpu, &scene, &views), exact(&scene, &views));
    let largest = |all: &mut dyn Iterator<Item = f64>| all.filter(|share| *share > 0.0).count();
    let [seen, expected] = [
        largest(&mut found.iter().map(|share| share.largest.into())),
        largest(&mut exact.iter().map(|share| share.largest)),
    ];
    assert!(seen.abs_diff(expected) <= expected / 500 && expected > 1000, "{seen} for {expected}");
    for (found, exact) in found.iter().zip(&exact) {
        let error = (f64::from(found.largest) - exact.largest).abs();
        assert!(error <= 0.01 * exact.largest + f64::from(ALPHA_MIN), "{found:?} for {exact:?}");
    }
    let dropped: Vec<u32> = (0..scene.len() as u32).step_by(7).collect();
    within_bounds(&gpu, &scene, &camera, &dropped);
    bound_is_that_of_the_twin(&gpu, &scene, &camera, &dropped);
}

#[test]
fn shares_are_the_same_every_time() {
    let gpu = Gpu::new();
    let scene = cactus(5000).unwrap().gaussians;
    let views = views([96, 80], 3);
    let first = shares(&gpu, &scene, &views);
    let turned: Vec<Camera> = views.iter().rev().cloned().collect();
    assert!(first == shares(&gpu, &scene, &views) && first == shares(&gpu, &scene, &turned));
    assert!(first.iter().any(|share| share.largest > 0.1) && first.iter().any(|share| share.largest == 0.0));
}

/// What hides the rest of a pixel without being drawn has a share: without it, the rest would show.
#[test]
fn a_splat_that_ends_pixels_is_not_unseen() {
    let gpu = Gpu::new();
    let wall = |z: f64, opacity: f64| (ball([0.0, 0.0, z], 0.5 * z, opacity), RED);
    let scene = gaussians(&[wall(2.0, 0.999), wall(3.0, 0.999), wall(4.0, 0.5), wall(5.0, 0.5)]);
    let mut camera = ahead([1, 1], 100.0);
    camera.centre_px = glam::dvec2(0.5, 0.5);
    let views = [camera];
    let (found, exact) = (shares(&gpu, &scene, &views), exact(&scene, &views));
    for (found, exact, expected) in
        found.iter().zip(&exact).zip([0.99, 0.01, 0.0, 0.0]).map(|((found, exact), expected)| (found, exact, expected))
    {
        assert!((f64::from(found.largest) - expected).abs() < 1e-6 && (exact.largest - expected).abs() < 1e-6);
        assert!((found.sum - expected).abs() < 1e-6, "{found:?}");
    }
    within_bounds(&gpu, &scene, &views[0], &[1]);
    within_bounds(&gpu, &scene, &views[0], &[0]);
}

#[test]
fn keep_leaves_the_visible_that_are_kept() {
    let gpu = Gpu::new();
    let stage = Stage::<Keep>::new(&gpu.0, &()).unwrap();
    for chunks in [1, 7, 8, 9, 65] {
        let mut random = Random(chunks as u64);
        let mut words = || (0..32 * chunks).map(|_| random.bits() as u32).collect::<Vec<_>>();
        let (kept, visible) = (words(), words());
        let expected: Vec<u32> = kept.iter().zip(&visible).map(|(a, b)| a & b).collect();
        let counts: Vec<u32> =
            expected.chunks(32).map(|chunk| chunk.iter().map(|word| word.count_ones()).sum()).collect();
        let (kept, visible) = (gpu.upload("kept", &kept), gpu.upload("visible masks", &visible));
        let chunk_counts = gpu.upload("chunk counts", &vec![u32::MAX; chunks]);
        gpu.run(|cmd| {
            let bindings = KeepBindings { kept: &kept, visible_masks: &visible, chunk_counts: &chunk_counts };
            let words = DispatchSize::Invocations(32 * chunks as u64);
            cmd.dispatch(&stage, bindings, KeepPush { chunks: chunks as u32 }, words);
        });
        assert!(gpu.download(&visible) == expected && gpu.download(&chunk_counts) == counts, "{chunks} chunks");
    }
}

/// The picture without some Gaussians is that of a scene that never had them, bit for bit.
#[test]
fn a_pruned_picture_is_that_of_the_kept_gaussians() {
    let gpu = Gpu::new();
    let scene = build(&cloud(&mut Random(5), 3000, 2, 0.3), 2);
    let camera = crate::common::cloud::camera();
    let statistics = Statistics::of(&scene);
    let mut pruner = pruner(&gpu, &scene);
    for every in [2, 3, 50] {
        let (dropped, kept): (Vec<u32>, Vec<u32>) = (0..scene.len() as u32).partition(|index| index % every == 0);
        pruner.set_dropped(&dropped).unwrap();
        let selected = scene.selected(&kept).unwrap();
        let mut other = Pruner::new(&gpu.0, &selected, &statistics, &Options::EXACT).unwrap();
        assert!(pruner.pruned(&camera).unwrap() == other.whole(&camera).unwrap(), "without every {every}th");
    }
    pruner.set_dropped(&[]).unwrap();
    assert!(pruner.pruned(&camera).unwrap() == pruner.whole(&camera).unwrap());
}

/// Every pixel changes by no more than its bound.
fn within_bounds(gpu: &Gpu, scene: &Gaussians, camera: &Camera, dropped: &[u32]) {
    let mut pruner = pruner(gpu, scene);
    pruner.set_dropped(dropped).unwrap();
    let (whole, pruned) = (pruner.whole(camera).unwrap(), pruner.pruned(camera).unwrap());
    let bounds = pruner.bounds(camera).unwrap();
    for ((a, b), bound) in whole.rgba.iter().zip(&pruned.rgba).zip(&bounds.pixels.rgba) {
        let change = (0..3).map(|i| (a[i] - b[i]).abs()).fold(0.0, f32::max);
        assert!(change <= bound[0], "a change of {change:e} passes its bound {bound:?}");
    }
}

/// The shares of dropped splats and the brightest colours are those of the reference. Pixels where an alpha or a
/// transmittance is at a threshold may differ by the doubt of the reference.
fn bound_is_that_of_the_twin(gpu: &Gpu, scene: &Gaussians, camera: &Camera, dropped: &[u32]) {
    let mut pruner = pruner(gpu, scene);
    pruner.set_dropped(dropped).unwrap();
    let found = pruner.bounds(camera).unwrap();
    let is_kept = |index: u32| dropped.binary_search(&index).is_err();
    let exact = reference::changes(scene, camera, RULES, Background::BLACK, is_kept);
    let kept: Vec<u32> = (0..scene.len() as u32).filter(|index| is_kept(*index)).collect();
    let doubts = [scene, &scene.selected(&kept).unwrap()].map(|scene| {
        let pixels = reference::render(scene, camera, RULES, Background::BLACK).pixels;
        pixels.into_iter().map(|pixel| pixel.doubt).collect::<Vec<_>>()
    });
    for (place, (found, exact)) in found.pixels.rgba.iter().zip(&exact).enumerate() {
        let [bound, share, brightest, _] = found.map(f64::from);
        // A doubt is a change of a colour: of a share times its colour.
        let doubt = (doubts[0][place] + doubts[1][place]) / brightest.max(0.1);
        let tolerance = SHARE_ERROR * exact.share + 1e-5 + 2.0 * doubt;
        assert!((share - exact.share).abs() <= tolerance, "{found:?} for {exact:?}, doubt {doubt}");
        assert!(bound >= share * brightest, "{found:?}");
        if exact.share > 0.0 {
            assert!((brightest * exact.share - exact.bound).abs() <= 1e-4 * exact.bound, "{found:?} for {exact:?}");
        }
    }
}

#[test]
fn bound_matches_its_twin() {
    let gpu = Gpu::new();
    for (count, size) in [(1, [64, 64]), (257, [61, 35]), (4096, [128, 16]), (20_000, [96, 65])] {
        let scene = cactus(count).unwrap().gaussians;
        for (view, every) in views(size, 2).into_iter().zip([3, 40]) {
            let dropped: Vec<u32> = (0..count as u32).step_by(every).collect();
            bound_is_that_of_the_twin(&gpu, &scene, &view, &dropped);
        }
    }
}

/// A search for a pixel that passes its bound: random clouds, and walls that stop pixels elsewhere without what is
/// dropped.
#[test]
fn no_pixel_passes_its_bound() {
    let gpu = Gpu::new();
    for seed in 0..6 {
        let mut random = Random(seed);
        let scene = build(&cloud(&mut random, 600, 2, 0.3), 2);
        let dropped: Vec<u32> = (0..600).filter(|_| random.below(4) == 0).collect();
        within_bounds(&gpu, &scene, &crate::common::cloud::camera(), &dropped);
        let walls: Vec<_> = (0..40)
            .map(|i| {
                let place = [random.between(-1.0, 1.0), random.between(-1.0, 1.0), 2.0 + 0.1 * f64::from(i)];
                (
                    ball(place, random.between(0.1, 2.0), random.between(0.9, 0.9999)),
                    if i % 2 == 0 { RED } else { GREEN },
                )
            })
            .collect();
        let dropped: Vec<u32> = (0..40).filter(|_| random.below(3) == 0).collect();
        within_bounds(&gpu, &gaussians(&walls), &ahead([64, 48], 50.0), &dropped);
    }
}

#[test]
fn pruning_runs_in_subgroups_of_four() {
    again_in_subgroups_of_four(&["prune::contribute_matches", "prune::bound_matches", "prune::no_pixel"]);
}
