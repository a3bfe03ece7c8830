//! Each stage against its twin on the CPU, over the sizes where indices go wrong.

use std::ops::Range;

use crate::common::{Gpu, Random};
use glam::{DMat2, DVec3, dvec2};
use smalto::camera::Camera;
use smalto::gpu::{Access, DispatchSize, Stage};
use smalto::options::Options;
use smalto::rules::{ALPHA_MIN, Rules, TILE};
use smalto::reference::{self, Tiling};
use smalto::render::*;
use smalto::scene::{Gaussians, synthetic};

const RULES: &Rules = &Rules::TRAINED;

/// Around the subgroup (8, 32), the workgroup (256), the chunks (1024, 2048), and 16-bit counts.
const SIZES: [usize; 24] = [
    0, 1, 7, 8, 9, 31, 32, 33, 255, 256, 257, 1023, 1024, 1025, 2047, 2048, 2049, 4095, 4096, 4097, 65_535, 65_536,
    65_537, 300_000,
];

/// Sorts on the GPU; the results are those of `length` keys.
fn sort(gpu: &Gpu, subgroup: u32, keys: &[u32], values: Option<&[u32]>, bits: u32) -> (Vec<u32>, Vec<u32>) {
    let sort = RadixSort::new(&gpu.0, subgroup, 4).unwrap();
    let pairs = Pairs::new(&gpu.0, "test", keys.len()).unwrap();
    let scratch = SortScratch::new(&gpu.0, keys.len()).unwrap();
    let lengths = gpu.upload("lengths", &[u32::MAX, keys.len() as u32]);
    let groups = DispatchSize::Groups(keys.len().div_ceil(2048) as u64).groups(1);
    let groups = gpu.upload("groups", &[[0; 3], [groups[0], groups[1], 1]]);
    let mut result = 0;
    gpu.run(|cmd| {
        cmd.upload(&pairs.keys[0], 0, keys.len(), |m| m.copy_from_slice(keys)).unwrap();
        if let Some(values) = values {
            cmd.upload(&pairs.values[0], 0, values.len(), |m| m.copy_from_slice(values)).unwrap();
        }
        cmd.barrier(Access::COPY_WRITE, Access::SHADER | Access::INDIRECT);
        let range = SortRange { lengths: &lengths, length_index: 1, bits, values_are_indices: values.is_none() };
        result = sort.record(cmd, &pairs, &scratch, range, (&groups, 12));
    });
    (gpu.download(&pairs.keys[result]), gpu.download(&pairs.values[result]))
}

fn random_keys(count: usize, bits: Range<u32>, seed: u64) -> Vec<u32> {
    let mut random = Random(seed);
    (0..count)
        .map(|_| ((random.bits() as u32) & ((1_u64 << bits.end) - 1) as u32) >> bits.start << bits.start)
        .collect()
}

#[test]
fn sort_is_a_stable_sort_at_every_size() {
    let gpu = Gpu::new();
    for subgroup in [4, gpu.0.capabilities().subgroup_size[0]] {
        for size in SIZES {
            let keys = random_keys(size, 0..13, size as u64);
            let values = random_keys(size, 0..32, 99);
            let expected = reference::sort(&keys, &values, 0..13);
            assert!(sort(&gpu, subgroup, &keys, Some(&values), 13) == expected, "{size} keys, subgroup {subgroup}");
        }
    }
}

#[test]
fn sort_orders_by_any_number_of_bits() {
    let gpu = Gpu::new();
    let subgroup = gpu.0.capabilities().subgroup_size[0];
    let values: Vec<u32> = (0..5000).collect();
    for bits in [0, 1, 2, 6, 7, 8, 9, 14, 16, 17, 24, 27, 31, 32] {
        // Bits above are noise that must not matter.
        let keys = random_keys(5000, 0..32, u64::from(bits));
        let expected = reference::sort(&keys, &values, 0..bits);
        assert!(sort(&gpu, subgroup, &keys, Some(&values), bits) == expected, "{bits} bits");
        if bits > 0 {
            assert!(sort(&gpu, subgroup, &keys, None, bits) == expected, "{bits} bits, values are indices");
        }
    }
}

#[test]
fn sort_keeps_the_order_of_equal_keys() {
    let gpu = Gpu::new();
    let subgroup = gpu.0.capabilities().subgroup_size[0];
    let count = 10_000;
    let values: Vec<u32> = (0..count).collect();
    for (name, keys) in [
        ("equal", vec![0xffff_ffff; count as usize]),
        ("zero", vec![0; count as usize]),
        ("two", (0..count).map(|i| i % 2).collect()),
        ("ascending", values.clone()),
        ("descending", (0..count).rev().collect()),
        ("one late", (0..count).map(|i| u32::from(i == 4999)).collect()),
    ] {
        assert!(sort(&gpu, subgroup, &keys, Some(&values), 32) == reference::sort(&keys, &values, 0..32), "{name}");
    }
}

#[test]
fn ranges_mark_where_tiles_begin_and_end() {
    let gpu = Gpu::new();
    let stage = Stage::<Ranges>::new(&gpu.0, &()).unwrap();
    // One more than 65,535 workgroups, so that the dispatch is folded.
    for size in SIZES.into_iter().chain([65_536 * 256 + 1]) {
        let tiles = 1 + size / 100;
        let mut random = Random(size as u64);
        let mut keys: Vec<u32> = (0..size).map(|_| random.below(tiles as u32)).collect();
        keys.sort_unstable();
        let totals = gpu.upload("totals", &[Totals { listed_kept: size as u32, ..bytemuck::Zeroable::zeroed() }]);
        let tile_keys = gpu.upload("tile keys", &keys);
        let ranges = gpu.upload("ranges", &vec![[0, 0]; tiles]);
        gpu.run(|cmd| {
            let bindings = RangesBindings { totals: &totals, tile_keys: &tile_keys, ranges: &ranges };
            cmd.dispatch(&stage, bindings, (), DispatchSize::Invocations(size as u64));
        });
        assert!(gpu.download(&ranges) == reference::ranges(&keys, tiles), "{size} instances");
    }
}

#[test]
fn cull_offsets_are_an_exclusive_sum() {
    let gpu = Gpu::new();
    let stage = Stage::<CullOffsets>::new(&gpu.0, &()).unwrap();
    for size in SIZES {
        let mut random = Random(size as u64);
        let counts: Vec<u32> = (0..size).map(|_| random.below(1025)).collect();
        let expected = reference::scan(&counts);
        let sums = gpu.upload("sums", &counts);
        let totals = gpu.upload("totals", &[<Totals as bytemuck::Zeroable>::zeroed()]);
        let dispatches = gpu.upload("dispatches", &[<PortableDispatches as bytemuck::Zeroable>::zeroed()]);
        let visible_capacity = 1_000_000;
        gpu.run(|cmd| {
            let bindings = CullOffsetsBindings { sums: &sums, totals: &totals, dispatches: &dispatches };
            cmd.dispatch(
                &stage,
                bindings,
                CullOffsetsPush { chunks: size as u32, visible_capacity },
                DispatchSize::Groups(1),
            );
        });
        let sums: Vec<u64> = gpu.download(&sums).into_iter().map(u64::from).collect();
        let (total, totals) = (expected[size], gpu.download(&totals)[0]);
        assert!(sums == expected[..size], "{size} counts");
        assert_eq!(u64::from(totals.visible), total);
        let kept = total.min(visible_capacity.into());
        assert_eq!(u64::from(totals.visible_kept), kept);
        let groups = gpu.download(&dispatches)[0];
        let covered = |[x, y, _]: [u32; 3], chunk: u64| u64::from(x) * u64::from(y) * chunk;
        for (groups, chunk) in [(groups.over_visible, 256), (groups.sort_visible, 2048), (groups.scan_visible, 2048)] {
            assert!(covered(groups, chunk) >= kept && groups[0] <= 65_535, "{groups:?} cover {kept}");
        }
    }
}

#[test]
fn cull_compact_lists_the_set_bits_in_order() {
    let gpu = Gpu::new();
    let stage = Stage::<CullCompact>::new(&gpu.0, &()).unwrap();
    // The last is one more than 65,535 workgroups.
    for (chunks, capacity) in [(1, 1000), (2, 2048), (3, 10), (65_536, 1 << 20)] {
        let mut random = Random(chunks as u64);
        let masks: Vec<u32> =
            (0..chunks * 32).map(|_| (random.bits() & random.bits() & random.bits()) as u32).collect();
        let counts: Vec<u32> = masks.chunks(32).map(|m| m.iter().map(|w| w.count_ones()).sum()).collect();
        let offsets: Vec<u32> = reference::scan(&counts)[..chunks].iter().map(|o| *o as u32).collect();
        let bit = |i: &u32| masks[*i as usize / 32] >> (i % 32) & 1 == 1;
        let expected: Vec<u32> = (0..chunks as u32 * 1024).filter(bit).take(capacity).collect();
        let ids = gpu.upload("ids", &vec![u32::MAX; capacity]);
        let (visible_masks, chunk_offsets) = (gpu.upload("masks", &masks), gpu.upload("offsets", &offsets));
        gpu.run(|cmd| {
            let bindings = CullCompactBindings {
                visible_masks: &visible_masks,
                chunk_offsets: &chunk_offsets,
                gaussian_from_splat: &ids,
            };
            let push = CullCompactPush { chunks: chunks as u32, visible_capacity: capacity as u32 };
            cmd.dispatch(&stage, bindings, push, DispatchSize::Groups(chunks as u64));
        });
        assert!(gpu.download(&ids)[..expected.len()] == expected, "{chunks} chunks");
    }
}

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
    captured: crate::common::Captured,
}

/// Frames of the portable path with all their buffers.
fn cases() -> Vec<Case> {
    let gpu = Gpu::new();
    let mut cases = Vec::new();
    for portable in [true] {
        for (count, camera) in views() {
            let gaussians = synthetic::cactus(count).unwrap().gaussians;
            let options = Options { portable, ..Options::EXACT };
            let captured = gpu.capture(&gaussians, &camera, &options);
            cases.push(Case { gaussians, camera, captured });
        }
    }
    cases
}

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
    for case in cases() {
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
            assert!(ball_meets_image(&case, *id), "{id} is kept though it is far outside");
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
    for case in cases() {
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
    for case in cases() {
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
    for case in cases() {
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
    for case in cases() {
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
    for case in cases() {
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
        let comparison = crate::common::compare(&case.captured.pixels, &rendering);
        assert!(comparison.unexplained == 0 && comparison.psnr > 100.0, "{comparison:?}");
    }
}

#[test]
fn every_stage_agrees_in_subgroups_of_four() {
    crate::common::again_in_subgroups_of_four(&["portable::", "--skip", "subgroups_of_four"]);
}
