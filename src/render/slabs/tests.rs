//! Frames in slabs show the bits of frames that are drawn at once.

use crate::camera::Camera;
use crate::gpu::{Device, DeviceChoice, Image, Validation};
use crate::options::Options;
use crate::render::capacity::Capacity;
use crate::render::fast::{FastPipeline, FastWorkspace};
use crate::render::frame::{Shot, Target};
use crate::render::{GpuScene, Renderer, read_pixels};
use crate::rules::Background;
use crate::scene::{Focus, Gaussians, synthetic};
use crate::storage::{Pages, Statistics};
use std::sync::Arc;

use super::Slabs;

fn compare(options: &Options, gaussians: &Gaussians, room: u64) -> u32 {
    let device = Device::open(&DeviceChoice::Best, Validation::IfInstalled).unwrap();
    let scene = GpuScene::new(&device, gaussians, options).unwrap();
    let focus = Focus::of(gaussians);
    let camera = Camera::framing(focus.centre.into(), focus.radius * 0.6, [200, 130]);
    let background = Background::Colour([0.1, 0.2, 0.3]);
    let mut renderer = Renderer::new(&device, options, &scene).unwrap();
    renderer.render(&camera, background).unwrap();
    let whole = renderer.pixels().unwrap();
    let mut fast = FastPipeline::new(&device, options, scene.layout()).unwrap().unwrap();
    let grid = fast.grid(camera.size_px, scene.len());
    fast.prepare(&device, grid).unwrap();
    let capacity =
        Capacity { gaussians: scene.len(), visible: room, spans: room, listed: 2 * room, cells: grid.count() as usize };
    let work = FastWorkspace::new(&device, capacity, fast.splat_elements()).unwrap();
    let image = Image::new(&device, "image", 200, 130).unwrap();
    let mut slabs = Slabs::new(&device, &fast, &scene).unwrap();
    let target = Target { image: &image, certificate: None, background };
    let shot = Shot { scene: &scene, camera: &camera };
    let drawn = slabs.draw(&device, (&fast, &work, options), shot, target).unwrap();
    let parts = read_pixels(&device, &image).unwrap();
    let differ = parts.rgba.iter().zip(&whole.rgba).filter(|(a, b)| a.map(f32::to_bits) != b.map(f32::to_bits)).count();
    assert_eq!(differ, 0, "pixels that differ in {} slabs", drawn.parts.slabs);
    assert_eq!(device.validation_messages(), Vec::<String>::new());
    drawn.parts.slabs
}

#[test]
fn a_frame_in_slabs_has_the_bits_of_a_whole_frame() {
    let gaussians = synthetic::cactus(20_000).unwrap().gaussians;
    for options in
        [Options::EXACT, Options::BALANCED, Options::FAST, Options::PREVIEW, Options { stop: 0.0, ..Options::BALANCED }]
    {
        for room in [20_000, 5_000, 300] {
            let slabs = compare(&options, &gaussians, room);
            assert!(slabs > 1 || room > 10_000, "{room}: {slabs} slabs");
            eprintln!("{room}: {slabs}");
        }
    }
}

#[test]
fn a_scene_in_pages_has_the_bits_of_a_whole_scene() {
    let gaussians = Arc::new(synthetic::cactus(30_000).unwrap().gaussians);
    let statistics = Statistics::of(&gaussians);
    let focus = Focus::of(&gaussians);
    let background = Background::Colour([0.1, 0.2, 0.3]);
    let whole_device = Device::open(&DeviceChoice::Best, Validation::IfInstalled).unwrap();
    for (name, options) in Options::PRESETS {
        if options.portable || FastPipeline::subgroup(&whole_device, &options).is_none() {
            continue;
        }
        let scene = GpuScene::new(&whole_device, &gaussians, &options).unwrap();
        let mut whole = Renderer::new(&whole_device, &options, &scene).unwrap();
        let device = Device::open(&DeviceChoice::Best, Validation::IfInstalled).unwrap();
        let device = device.with_memory_limit(Some(72 << 20)).unwrap();
        let pages = Pages::of_gaussians(gaussians.clone(), statistics.clone(), &options);
        let scene = GpuScene::of_pages(&device, &pages, &options, 1 << 20).unwrap();
        let mut paged = Renderer::new(&device, &options, &scene).unwrap();
        for zoom in [0.2, 0.6, 1.5] {
            let camera = Camera::framing(focus.centre.into(), focus.radius * zoom, [200, 130]);
            whole.render(&camera, background).unwrap();
            let frame = paged.render(&camera, background).unwrap();
            let (expected, drawn) = (whole.pixels().unwrap(), paged.pixels().unwrap());
            let pairs = drawn.rgba.iter().zip(&expected.rgba);
            let differ = pairs.filter(|(a, b)| a.map(f32::to_bits) != b.map(f32::to_bits)).count();
            assert_eq!(differ, 0, "{name}, {zoom}: pixels that differ");
            eprintln!("{name} {zoom} {:?} {:?}", scene.pages_read(), frame.totals.visible);
        }
        assert_eq!(device.validation_messages(), Vec::<String>::new());
        let memory = device.memory();
        assert!(memory.peak <= memory.limit.unwrap(), "{memory:?}");
    }
}
