//! The stages of the portable path in whole frames: what each wrote, against its twin on the CPU.

use std::sync::LazyLock;

use glam::{DMat2, DVec3, dvec2};
use smalto::camera::Camera;
use smalto::options::Options;
use smalto::procedural::cactus;
use smalto::reference::{self, Tiling};
use smalto::render::*;
use smalto::rules::{ALPHA_MIN, Rules, TILE};
use smalto::scene::Gaussians;

use crate::common::{Captured, Gpu, compare};

const RULES: &Rules = &Rules::TRAINED;

/// Scenes whose counts lie on the boundaries, and the views they are drawn from.
fn views() -> Vec<(usize, Camera)> {
    let from = |size| Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), size, 0.9);
    let counts = [1, 255, 256, 257, 1023, 1024, 1025, 4096, 20_000];
    counts
        .iter()
        .zip([[64, 64], [61, 35], [128, 16], [33, 65]].iter().cycle())
        .map(|(n, size)| (*n, from(*size)))
        .collect()
}

struct Case {
    gaussians: Gaussians,
    camera: Camera,
    captured: Captured,
}

/// Frames of the portable path with all their buffers. All tests of this file read the same.
static CASES: LazyLock<Vec<Case>> = LazyLock::new(|| {
    let gpu = Gpu::new();
    let case = |(count, camera)| {
        let gaussians = cactus(count).unwrap().gaussians;
        let captured = gpu.capture(&gaussians, &camera, &Options { portable: true, ..Options::EXACT });
        Case { gaussians, camera, captured }
    };
    views().into_iter().map(case).collect()
});

impl Case {
    fn visible(&self) -> Vec<u32> {
        self.captured.buffer("gaussian from splat")[..self.captured.frame.totals.visible_kept as usize].to_vec()
    }

    /// The tiles of each visible splat, as the spans say.
    fn tiles(&self) -> Vec<Vec<u32>> {
        let tiles_x = self.camera.size_px[0].div_ceil(TILE);
        let spans: Vec<u32> = self.captured.buffer("spans");
        let ranges: Vec<[u32; 2]> = self.captured.buffer("span ranges");
        let tiles_of = |[first, rows]: [u32; 2]| {
            let row = |i: u32| {
                let span = spans[(first + i) as usize];
                (span & 0xffff..span >> 16).map(move |x| ((rows & 0xffff) + i) * tiles_x + x)
            };
            (0..rows >> 16).flat_map(row).collect()
        };
        ranges[..self.visible().len()].iter().map(|r| tiles_of(*r)).collect()
    }

    /// Splats by depth: the values of whichever pair of buffers the sort ended in.
    fn order(&self) -> Vec<u32> {
        let kept = self.visible().len();
        let pairs = [("depth keys", "depth values"), ("depth keys 2", "depth values 2")];
        let is_sorted = |(keys, _): &&(&str, &str)| self.captured.buffer::<u32>(keys)[..kept].is_sorted();
        let (_, values) = pairs.iter().find(is_sorted).expect("one pair is sorted");
        self.captured.buffer::<u32>(values)[..kept].to_vec()
    }
}

#[test]
fn cull_keeps_every_gaussian_that_shows() {
    for case in &*CASES {
        let visible = case.visible();
        assert!(visible.is_sorted(), "compaction keeps the order");
        let exact = reference::cull(&case.gaussians, &case.camera, RULES);
        // What lies between pixel centres touches a tile's box of centres, but no centre.
        let shows = |id: &u32| {
            touches_a_centre(&reference::project(&case.gaussians, *id, &case.camera, RULES), case.camera.size_px)
        };
        let missing: Vec<_> = exact.iter().filter(|id| shows(id) && visible.binary_search(id).is_err()).collect();
        assert!(missing.is_empty(), "{missing:?} are missing");
        for id in visible.iter().filter(|id| exact.binary_search(id).is_err()) {
            assert!(ball_meets_image(case, *id), "{id} is kept though it is far outside");
        }
    }
}

/// Whether the image of the ball around a Gaussian, which the cull tests, meets the image; with room for rounding.
fn ball_meets_image(case: &Case, id: u32) -> bool {
    let (gaussians, camera) = (&case.gaussians, &case.camera);
    let splat = reference::project(gaussians, id, camera, RULES);
    let longest = gaussians.scales()[id as usize].iter().fold(0.0_f64, |m, s| m.max((*s).into()));
    let deviations = splat.level(RULES).sqrt();
    let size = dvec2(camera.size_px[0].into(), camera.size_px[1].into());
    let slope = ((splat.mean_px - camera.centre_px) / camera.focal_px).abs().min(0.65 * size / camera.focal_px);
    let stretch = camera.focal_px / splat.depth * (1.0 + slope * slope).map(f64::sqrt);
    let reach = 1.02 * deviations * (stretch * longest + 0.55) + 0.1;
    (splat.mean_px + reach).cmpge(dvec2(0.0, 0.0)).all() && (splat.mean_px - reach).cmple(size).all()
}

/// Whether the splat's alpha reaches the threshold, with room for rounding, at the pixel centre nearest its mean.
fn touches_a_centre(splat: &reference::Splat, size: [u32; 2]) -> bool {
    let largest = dvec2(f64::from(size[0]), f64::from(size[1])) - 0.5;
    let nearest = ((splat.mean_px - 0.5).round() + 0.5).clamp(dvec2(0.5, 0.5), largest);
    splat.opacity * (-0.5 * splat.distance(nearest)).exp() > f64::from(ALPHA_MIN) * (1.0 + 1e-4)
}

#[test]
fn project_matches_its_twin() {
    for case in &*CASES {
        let splats: Vec<Splat> = case.captured.buffer("splats");
        for ((id, splat), tiles) in case.visible().into_iter().zip(splats).zip(case.tiles()) {
            if tiles.is_empty() {
                continue; // then the splat is not written
            }
            let exact = reference::project(&case.gaussians, id, &case.camera, RULES);
            let mean = dvec2(f64::from(splat.mean_px[0]), f64::from(splat.mean_px[1]));
            let reach = (exact.mean_px - case.camera.centre_px).abs().max_element() + case.camera.focal_px.x;
            assert!((mean - exact.mean_px).abs().max_element() <= 1e-6 * reach, "mean {mean} for {}", exact.mean_px);
            let relative = (conic(&splat) - exact.conic).to_cols_array().map(f64::abs);
            let scale = (exact.conic.x_axis.x * exact.conic.y_axis.y).sqrt().max(exact.conic.x_axis.y.abs());
            assert!(relative[1] <= 2e-5 * scale, "conic {:?} for {:?}", conic(&splat), exact.conic);
            assert!(relative[0] <= 2e-5 * exact.conic.x_axis.x && relative[3] <= 2e-5 * exact.conic.y_axis.y);
            for (channel, value) in splat.colour.iter().enumerate() {
                let expected = exact.colour.to_array()[channel];
                assert!((f64::from(*value) - expected).abs() <= 2e-6, "colour {value} for {expected}");
            }
            assert_eq!(f64::from(splat.opacity), exact.opacity);
        }
    }
}

/// The conic that a splat's factor stands for.
fn conic(splat: &Splat) -> DMat2 {
    let [l0, l1, l2] = splat.factor.map(f64::from);
    let to_e = 2.0 / std::f64::consts::LOG2_E;
    DMat2::from_cols_array(&[l0 * l0, l0 * l1, l0 * l1, l1 * l1 + l2 * l2].map(|v| v * to_e))
}

#[test]
fn project_finds_every_tile_and_hardly_more() {
    for case in &*CASES {
        let tiling = Tiling::of(case.camera.size_px);
        let (mut found, mut exact_tiles) = (0, 0);
        for (id, tiles) in case.visible().into_iter().zip(case.tiles()) {
            let exact = reference::project(&case.gaussians, id, &case.camera, RULES);
            let allowed = reference::tiles(&exact, tiling, RULES);
            assert!(tiles.is_sorted_by(|a, b| a < b));
            // No pixel of another tile reaches the threshold.
            for tile in allowed.iter().filter(|t| !tiles.contains(t)) {
                let (x, y) = (tile % tiling.counts[0] * TILE, tile / tiling.counts[0] * TILE);
                for (px, py) in (0..TILE * TILE).map(|i| (x + i % TILE, y + i / TILE)) {
                    let alpha =
                        exact.opacity * (-0.5 * exact.distance(dvec2(f64::from(px) + 0.5, f64::from(py) + 0.5))).exp();
                    assert!(
                        alpha < f64::from(ALPHA_MIN) * (1.0 + 1e-4),
                        "splat {id} misses tile {tile}: alpha {alpha}"
                    );
                }
            }
            found += tiles.len();
            exact_tiles += allowed.len();
        }
        assert!(found <= exact_tiles + exact_tiles / 20 + 2, "{found} tiles for {exact_tiles}");
        let totals = case.captured.frame.totals;
        assert_eq!((found as u32, 0), (totals.listed_low, totals.listed_high));
    }
}

#[test]
fn depths_are_sorted_like_the_exact_ones() {
    for case in &*CASES {
        let (visible, tiles) = (case.visible(), case.tiles());
        let depth =
            |splat: u32| reference::project(&case.gaussians, visible[splat as usize], &case.camera, RULES).depth as f32;
        let order: Vec<u32> = case.order().into_iter().filter(|s| !tiles[*s as usize].is_empty()).collect();
        let key = |splat: &u32| (depth(*splat).to_bits(), *splat);
        assert!(order.is_sorted_by_key(key), "by (f32 depth, index)");
    }
}

#[test]
fn duplicate_emits_each_splats_tiles_in_depth_order() {
    for case in &*CASES {
        let tiles = case.tiles();
        let expected: Vec<(u32, u32)> = case
            .order()
            .into_iter()
            .flat_map(|splat| tiles[splat as usize].iter().map(move |tile| (*tile, splat)))
            .collect();
        let total = case.captured.frame.totals.listed_kept as usize;
        assert_eq!(expected.len(), total);
        // Sorted by tile, stably, it is what the blend walks.
        let (keys, values): (Vec<u32>, Vec<u32>) = expected.into_iter().unzip();
        let tiling = Tiling::of(case.camera.size_px);
        let (keys, values) = reference::sort(&keys, &values, 0..tiling.key_bits());
        let ranges: Vec<[u32; 2]> = case.captured.buffer("ranges");
        assert_eq!(ranges[..tiling.tiles()], reference::ranges(&keys, tiling.tiles()));
        let lists: [Vec<u32>; 2] = ["instance values", "instance values 2"].map(|n| case.captured.buffer(n));
        assert!(lists.iter().any(|list| list[..total] == values), "the lists are complete and in order");
    }
}

#[test]
fn blend_matches_its_twin_on_the_same_lists() {
    for case in &*CASES {
        let tiling = Tiling::of(case.camera.size_px);
        let splats: Vec<Splat> = case.captured.buffer("splats");
        let exact = |s: &Splat| reference::Splat {
            mean_px: dvec2(f64::from(s.mean_px[0]), f64::from(s.mean_px[1])),
            covariance: conic(s).inverse(),
            conic: conic(s),
            opacity: f64::from(s.opacity),
            colour: DVec3::from(s.colour.map(f64::from)),
            distance_world: 0.0,
            depth: 1.0,
        };
        let splats: Vec<_> = splats[..case.visible().len()].iter().map(exact).collect();
        let tiles = case.tiles();
        let instances: Vec<(u32, u32)> =
            case.order().into_iter().flat_map(|s| tiles[s as usize].iter().map(move |t| (*t, s))).collect();
        let (keys, values): (Vec<u32>, Vec<u32>) = instances.into_iter().unzip();
        let (keys, values) = reference::sort(&keys, &values, 0..tiling.key_bits());
        let ranges = reference::ranges(&keys, tiling.tiles());
        let lists = reference::Lists { splats: &splats, ranges: &ranges, splat_ids: &values, rays: None };
        let pixels = reference::blend(&lists, tiling, DVec3::ZERO, RULES);
        let rendering = reference::Rendering { size_px: case.camera.size_px, pixels };
        let comparison = compare(&case.captured.pixels, &rendering);
        assert!(comparison.unexplained == 0 && comparison.psnr > 100.0, "{comparison:?}");
    }
}
