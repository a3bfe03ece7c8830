//! The fast path: that it is taken, that it gives way, and that its pictures are the same in every run.

use crate::common::{Gpu, compare};
use glam::DVec3;
use smalto::camera::Camera;
use smalto::options::Options;
use smalto::procedural::cactus;
use smalto::reference;
use smalto::render::{BLOCK_FORMS, Capacity, FastPipeline, GpuScene, Renderer};
use smalto::rules::Background;

fn camera(size: [u32; 2]) -> Camera {
    Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), size, 0.9)
}

/// The stages of a frame that `options` draw.
fn stages(gpu: &Gpu, options: &Options, size: [u32; 2]) -> Vec<&'static str> {
    let scene = GpuScene::new(&gpu.0, &cactus(500).unwrap().gaussians, options).unwrap();
    let frame = Renderer::new(&gpu.0, options, &scene).unwrap().render(&camera(size), Background::BLACK).unwrap();
    frame.timings.iter().map(|timing| timing.name).collect()
}

#[test]
fn the_fast_path_draws_every_preset_that_allows_it() {
    let gpu = Gpu::new();
    for (name, options) in Options::PRESETS {
        let is_fast = stages(&gpu, &options, [64, 48]).contains(&"masks");
        assert_eq!(is_fast, !["portable", "inria", "khr"].contains(&name), "{name}");
    }
}

#[test]
#[ignore = "long: a picture of 31 megapixels"]
fn long_the_fast_path_gives_way_to_more_bins_than_a_workgroup_counts() {
    assert!(!stages(&Gpu::new(), &Options::EXACT, [1900, 16384]).contains(&"masks"));
}

/// A bin of several runs, so that they are sorted, merged and blended in pieces.
#[test]
fn every_run_draws_the_same_bits() {
    let gpu = Gpu::new();
    let gaussians = cactus(60_000).unwrap().gaussians;
    let camera = camera([96, 64]);
    for options in [Options::EXACT, Options::BALANCED] {
        let scene = GpuScene::new(&gpu.0, &gaussians, &options).unwrap();
        let mut still = Renderer::new(&gpu.0, &options, &scene).unwrap();
        let mut draw = || {
            let frame = still.render(&camera, Background::BLACK).unwrap();
            assert!(frame.totals.longest_list > 3 * 2048, "{} entries", frame.totals.longest_list);
            still.pixels().unwrap()
        };
        let first = draw();
        for run in 1..if gpu.0.capabilities().loop_limit.is_some() { 20 } else { 1000 } {
            assert!(draw() == first, "run {run}");
        }
        if options == Options::EXACT {
            let exact = reference::render(&gaussians, &camera, &options.rules, Background::BLACK);
            assert_eq!(compare(&first, &exact).unexplained, 0);
        }
    }
}

/// Every frame leaves the counters at 0: whatever was drawn before, also in too little room, the next picture is right.
#[test]
fn pictures_do_not_depend_on_those_before_them() {
    let gpu = Gpu::new();
    let gaussians = cactus(3000).unwrap().gaussians;
    let scene = GpuScene::new(&gpu.0, &gaussians, &Options::EXACT).unwrap();
    let room = Capacity { gaussians: 3000, visible: 3000, spans: 100, listed: 100, cells: 4 };
    let still = Renderer::new(&gpu.0, &Options::EXACT, &scene).unwrap();
    let mut still = still.with_capacity(room).unwrap();
    let mut attempts = 0;
    for size in [[64, 48], [300, 200], [96, 64], [1100, 1000], [64, 48], [300, 200]] {
        attempts += still.render(&camera(size), Background::BLACK).unwrap().attempts;
        let alone = gpu.render(&gaussians, &camera(size), &Options::EXACT);
        assert!(still.pixels().unwrap() == alone, "{size:?}");
    }
    assert!(attempts > 6, "some did not fit at first");
}

#[test]
fn small_pictures_have_rings_and_crowded_ones_low_blocks() {
    let gpu = Gpu::new();
    let scene = GpuScene::new(&gpu.0, &cactus(1).unwrap().gaussians, &Options::EXACT).unwrap();
    let pipeline = FastPipeline::new(&gpu.0, &Options::EXACT, scene.layout()).unwrap().unwrap();
    for (size, gaussians, height, has_ring) in [
        ([720, 720], 1000, 4, true),
        ([720, 720], 1_940_000, 4, true),
        ([1920, 1080], 6_000_000, 4, false),
        ([1920, 1080], 4_000_000, 8, false),
        ([3840, 2160], 4_000_000, 16, false),
    ] {
        let form = BLOCK_FORMS[pipeline.grid(size, gaussians).form_index];
        assert_eq!((form.height, form.has_ring), (height, has_ring), "{size:?}, {gaussians} Gaussians");
    }
}

/// Blocks are 4, 8 or 16 pixels high.
#[test]
fn pictures_of_every_size_agree_with_the_reference() {
    let gpu = Gpu::new();
    let gaussians = cactus(3000).unwrap().gaussians;
    for size in [[300, 200], [1100, 1000], [2100, 2000]] {
        let exact = reference::render(&gaussians, &camera(size), &Options::EXACT.rules, Background::BLACK);
        let comparison = compare(&gpu.render(&gaussians, &camera(size), &Options::EXACT), &exact);
        assert_eq!(comparison.unexplained, 0, "{size:?}: {comparison:?}");
    }
}

/// Thousands of splats on a few pixels: lists that are merged once, and others that are merged twice.
#[test]
fn long_lists_agree_with_the_reference() {
    let gpu = Gpu::new();
    for (count, size, entries) in [
        (33_000, [300, 200], 25_000..32_768),
        (33_000, [1100, 1000], 25_000..32_768),
        (40_000, [1100, 1000], 32_768..40_000),
        (40_000, [2100, 2000], 32_768..40_000),
    ] {
        let gaussians = cactus(count).unwrap().gaussians;
        let camera = Camera::looking_at(DVec3::new(0.0, -1.0, -120.0), DVec3::new(0.0, -1.0, 0.0), size, 0.9);
        let scene = GpuScene::new(&gpu.0, &gaussians, &Options::EXACT).unwrap();
        let mut still = Renderer::new(&gpu.0, &Options::EXACT, &scene).unwrap();
        let frame = still.render(&camera, Background::BLACK).unwrap();
        assert!(frame.timings.iter().any(|timing| timing.name == "masks"), "{size:?} is not on the fast path");
        // Where loops end early, the longest lists are cut into slabs.
        let is_cut = frame.parts.is_some_and(|parts| parts.slabs > 1);
        let longest = frame.totals.longest_list;
        assert!(is_cut || entries.contains(&longest), "{size:?}: {longest} entries");
        let exact = reference::render(&gaussians, &camera, &Options::EXACT.rules, Background::BLACK);
        let comparison = compare(&still.pixels().unwrap(), &exact);
        // Means far away are known to 1e-4 px, which is more doubt about thresholds than is made allowance for.
        assert!(comparison.psnr > 100.0 && comparison.max_error < 1.0 / 255.0, "{size:?}: {comparison:?}");
    }
}
