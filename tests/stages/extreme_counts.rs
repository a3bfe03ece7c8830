//! Large counts of layers, tile entries and instances, and buffers that overflow.

use crate::common::agree::{GREEN, RED, agrees, ahead, ball, reference_of, render};
use crate::common::{Gpu, Random, again_in_subgroups_of_four, compare, free, gaussians};
use glam::DVec3;
use smalto::camera::Camera;
use smalto::options::Options;
use smalto::procedural::cactus;
use smalto::reference;
use smalto::render::{Capacity, GpuScene, PortableWorkspace, Renderer};
use smalto::rules::Background;
use smalto::scene::Raw;

#[test]
fn equal_depths_keep_the_order_of_the_file_in_every_run() {
    let mut random = Random(3);
    // 4,000 splats on 3 depths.
    let raws: Vec<_> = (0..4000)
        .map(|i| {
            let mean = [random.between(-2.0, 2.0), random.between(-2.0, 2.0), 4.0 + f64::from(i % 3)];
            (
                ball(mean, 0.1, random.between(0.05, 0.9)),
                [random.between(0.0, 1.0) as f32, random.between(0.0, 1.0) as f32, 0.5],
            )
        })
        .collect();
    let (scene, camera) = (gaussians(&raws), ahead([96, 96], 100.0));
    let first = agrees("ties", &scene, &camera);
    let gpu = Gpu::new();
    let scene = GpuScene::new(&gpu.0, &scene, &Options::EXACT).unwrap();
    let mut still = Renderer::new(&gpu.0, &Options::EXACT, &scene).unwrap();
    for run in 0..100 {
        still.render(&camera, Background::BLACK).unwrap();
        assert!(still.pixels().unwrap() == first, "run {run} draws the same bits");
    }
}

#[test]
fn thousands_of_faint_layers_agree() {
    let raws: Vec<_> =
        (0..5000).map(|i| (ball([0.0, 0.0, 5.0 + 0.001 * f64::from(i)], 20.0, 1.2 / 255.0), RED)).collect();
    agrees("layers", &gaussians(&raws), &ahead([40, 40], 50.0));
}

#[test]
fn thousands_of_layers_at_the_threshold_agree() {
    let threshold = f64::from(1.0_f32 / 255.0);
    let layers = |opacity: f64| {
        // So large that alpha is the opacity in every pixel.
        let layer = |i| (ball([0.0, 0.0, 5.0 + 0.001 * f64::from(i)], 1e4, opacity), RED);
        gaussians(&(0..5000).map(layer).collect::<Vec<_>>())
    };
    let camera = ahead([20, 20], 50.0);
    let pixels = agrees("just over", &layers(threshold * 1.0002), &camera);
    assert!(pixels.rgba.iter().all(|p| p[0] > 0.999), "together they are opaque");
    let pixels = render(&layers(threshold * 0.9998), &camera);
    assert!(pixels.rgba.iter().all(|p| *p == [0.0; 4]), "each of them is nothing, and so are all");
}

/// The transmittance of all of them, 1e-1000, is no float: pixels stop long before.
#[test]
fn hundreds_of_opaque_layers_agree() {
    for opacity in [0.9, 0.95, 0.99, 1.0 - 1e-9] {
        let layer = |i| {
            let colour = if i % 2 == 0 { RED } else { GREEN };
            (ball([0.02 * f64::from(i % 7), 0.0, 5.0 + 0.01 * f64::from(i)], 2.0, opacity), colour)
        };
        let raws: Vec<(Raw, _)> = (0..500).map(layer).collect();
        agrees(&format!("opacity {opacity}"), &gaussians(&raws), &ahead([40, 30], 20.0));
    }
}

/// One pixel stops at the second of a million; the other is reached by the last one alone.
#[test]
fn a_million_splats_in_one_tile_are_all_drawn() {
    const COUNT: usize = 1_000_000;
    let entry = |i: usize| {
        let z = 5.0 + 1e-6 * i as f64;
        if i + 1 == COUNT { (ball([0.1, 0.0, z], 0.01, 0.9), GREEN) } else { (ball([-0.1, 0.0, z], 0.002, 0.99), RED) }
    };
    let scene = gaussians(&(0..COUNT).map(entry).collect::<Vec<_>>());
    let camera = ahead([6, 1], 100.0);
    let gpu = Gpu::new();
    let gpu_scene = GpuScene::new(&gpu.0, &scene, &Options::EXACT).unwrap();
    let mut still = Renderer::new(&gpu.0, &Options::EXACT, &gpu_scene).unwrap();
    let frame = still.render(&camera, Background::BLACK).unwrap();
    // Where loops end early, the list is cut into slabs, whose entries are counted together.
    assert_eq!(frame.totals.listed_kept as usize, COUNT);
    assert!(frame.totals.longest_list as usize == COUNT || frame.parts.is_some_and(|parts| parts.slabs > 1));
    let pixels = still.pixels().unwrap();
    let comparison = compare(&pixels, &reference_of(&scene, &camera));
    assert_eq!(comparison.unexplained, 0, "{comparison:?}");
    assert!(pixels.at(1, 0)[0] > 0.9 && pixels.at(4, 0)[1] > 0.5, "{:?}", pixels.rgba);
}

/// More entries in one tile than llvmpipe lets a loop run: all must count.
#[test]
fn a_tile_list_longer_than_65535_is_drawn_completely() {
    // Most cover one corner; a faint one now and then covers the tile, so that each missing stretch is seen.
    let entry = |i: u32| {
        let z = 5.0 + 1e-5 * f64::from(i);
        if i % 400 == 399 {
            (ball([0.1, 0.1, z], 0.2, 0.02), GREEN)
        } else {
            (ball([-0.35, -0.35, z], 0.002, 0.5), RED)
        }
    };
    let mut raws: Vec<_> = (0..70_000).map(entry).collect();
    raws.push((ball([0.1, 0.1, 8.0], 0.2, 0.95), GREEN));
    let scene = gaussians(&raws);
    let camera = ahead([16, 16], 100.0);
    let gpu = Gpu::new();
    for portable in [false, true] {
        let options = Options { portable, ..Options::EXACT };
        let gpu_scene = GpuScene::new(&gpu.0, &scene, &Options::EXACT).unwrap();
        let mut still = Renderer::new(&gpu.0, &options, &gpu_scene).unwrap();
        let frame = still.render(&camera, Background::BLACK).unwrap();
        assert!(frame.totals.listed_kept > 65_535, "the list is long: {}", frame.totals.listed_kept);
        let is_cut = !portable && frame.parts.is_some_and(|parts| parts.slabs > 1);
        assert!(is_cut || frame.totals.longest_list > 65_535, "the list is long: {}", frame.totals.longest_list);
        let rendering = reference::render(&scene, &camera, &options.rules, Background::BLACK);
        let pixels = still.pixels().unwrap();
        assert_eq!(compare(&pixels, &rendering).unexplained, 0);
        assert!(pixels.at(10, 10)[1] > 0.9, "the last splat shows: {:?}", pixels.at(10, 10));
    }
}

#[test]
fn long_lists_agree_in_subgroups_of_four() {
    again_in_subgroups_of_four(&["a_tile_list_longer_than_65535_is_drawn_completely"]);
}

#[test]
fn buffers_that_overflow_grow_and_the_frame_is_repeated() {
    let gpu = Gpu::new();
    let scene = cactus(5000).unwrap().gaussians;
    let camera = Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), [160, 120], 0.9);
    let gpu_scene = GpuScene::new(&gpu.0, &scene, &Options::EXACT).unwrap();
    let roomy = gpu.render(&scene, &camera, &Options::EXACT);
    let enough = Capacity::guess(&gpu.0, 5000, 80);
    for (name, room) in [
        ("visible", Capacity { visible: 10, ..enough }),
        ("spans", Capacity { spans: 10, ..enough }),
        ("instances", Capacity { listed: 10, ..enough }),
        ("all", Capacity { visible: 1, spans: 1, listed: 1, ..enough }),
        ("nothing", Capacity::default()),
    ] {
        let still = Renderer::new(&gpu.0, &Options::EXACT, &gpu_scene).unwrap();
        let mut still = still.with_capacity(room).unwrap();
        let frame = still.render(&camera, Background::BLACK).unwrap();
        assert!(frame.attempts > 1, "{name}: did not fit at first");
        assert!(still.pixels().unwrap() == roomy, "{name}: the picture is complete");
        assert_eq!(still.render(&camera, Background::BLACK).unwrap().attempts, 1, "{name}: the room stays");
    }
}

#[test]
fn a_frame_that_overflowed_stays_incomplete_after_growth() {
    let gpu = Gpu::new();
    let gaussians = cactus(2000).unwrap().gaussians;
    let scene = GpuScene::new(&gpu.0, &gaussians, &Options::EXACT).unwrap();
    let camera = free::camera();
    let room = Capacity { gaussians: 2000, visible: 2000, spans: 9000, listed: 10, cells: 35 };
    let mut still = Renderer::new(&gpu.0, &Options::EXACT, &scene).unwrap().with_capacity(room).unwrap();
    let [first, second] = [(); 2].map(|()| still.start(&camera, Background::BLACK).unwrap());
    assert!(!still.finish(first).unwrap());
    assert!(!still.finish(second).unwrap(), "it was begun in the room of the first");
    let third = still.start(&camera, Background::BLACK).unwrap();
    assert!(still.finish(third).unwrap());
    assert!(still.pixels().unwrap() == gpu.render(&gaussians, &camera, &Options::EXACT));
}

/// Where the spare room is over a limit of the device, the room that is needed is enough.
#[test]
fn a_demand_of_exactly_the_limit_is_not_refused() {
    let gpu = Gpu::new();
    let most = gpu.0.capabilities().limits.storage_range.min(128 << 20) / 36;
    let mut work = PortableWorkspace::new(&gpu.0, Capacity::default()).unwrap();
    let demand = Capacity { gaussians: 1 << 23, visible: most, ..Capacity::default() };
    assert!(work.grow(&gpu.0, demand).unwrap());
    assert!(!work.grow(&gpu.0, demand).unwrap());
}
