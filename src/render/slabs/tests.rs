//! Frames in slabs and in pages show the bits of frames that are drawn at once.

use glam::DVec3;

use super::FastSlabs;
use crate::camera::Camera;
use crate::gpu::{Device, Image};
use crate::host_memory::OutOfMemory;
use crate::options::{Options, Storage};
use crate::pixels::Pixels;
use crate::procedural::{Procedural, cactus};
use crate::render::Frame;
use crate::render::capacity::Capacity;
use crate::render::fast::{FastFrame, FastPipeline, FastWorkspace};
use crate::render::frame::{Shot, Target};
use crate::render::lod::fixtures::open;
use crate::render::portable::PortableWorkspace;
use crate::render::readback::read_pixels;
use crate::render::recorded::Counted;
use crate::render::renderer::Renderer;
use crate::render::scene::{GpuScene, SceneSource, Upload};
use crate::rules::{Background, Rules};
use crate::scene::{Builder, Focus, Gaussians, Raw};

const SIZE: [u32; 2] = [200, 130];
const BACKGROUND: Background = Background::Colour([0.1, 0.2, 0.3]);

/// Views from inside of a scene to one from far away.
fn views(gaussians: &Gaussians) -> [Camera; 3] {
    let focus = Focus::of(gaussians);
    [0.2, 0.6, 1.5].map(|zoom| Camera::framing(focus.centre.into(), focus.radius * zoom, SIZE))
}

fn differing(one: &Pixels, other: &Pixels) -> usize {
    let bits = |pixels: &[f32; 4]| pixels.map(f32::to_bits);
    one.rgba.iter().zip(&other.rgba).filter(|(a, b)| bits(a) != bits(b)).count()
}

fn assert_valid(device: &Device) {
    assert_eq!(device.validation_messages(), Vec::<String>::new());
    let memory = device.memory();
    assert!(memory.limit.is_none_or(|limit| memory.peak <= limit), "{memory:?}");
    // The driver counts allocations that the budget does not: its report is compared where it has one.
    let is_kept = memory.driver_used.zip(memory.user_limit).is_none_or(|(used, limit)| used <= limit);
    assert!(is_kept, "{memory:?}");
}

/// The number of slabs in which a scene that is on the device as a whole is drawn with a capacity of `room` splats.
fn slabs_of_whole(device: &Device, options: &Options, gaussians: &Gaussians, room: u64) -> u32 {
    let scene = GpuScene::new(device, gaussians, options).unwrap();
    let camera = &views(gaussians)[1];
    let mut renderer = Renderer::new(device, options, &scene).unwrap();
    renderer.render(camera, BACKGROUND).unwrap();
    let whole = renderer.pixels().unwrap();
    let mut fast = FastPipeline::new(device, options, scene.layout()).unwrap().unwrap();
    let grid = fast.grid(SIZE, scene.len());
    fast.prepare(device, grid).unwrap();
    let cells = grid.count() as usize;
    let capacity = Capacity { gaussians: scene.len(), visible: room, spans: room, listed: 2 * room, cells };
    let work = FastWorkspace::new(device, capacity, fast.splat_elements()).unwrap();
    let image = Image::new(device, "image", SIZE[0], SIZE[1]).unwrap();
    let mut slabs = FastSlabs::new(device, &fast, &scene).unwrap();
    let target = Target { image: &image, certificate: None, background: BACKGROUND };
    let shot = Shot::new(&scene, camera);
    let frame = FastFrame::new(&fast, &work, options, shot, target);
    let drawn = slabs.draw(device, &frame, None).unwrap();
    let parts = read_pixels(device, &image).unwrap();
    assert_eq!(differing(&parts, &whole), 0, "pixels that differ in {} slabs", drawn.report.slabs);
    drawn.report.slabs
}

#[test]
fn a_frame_in_slabs_has_the_bits_of_a_whole_frame() {
    let (device, gaussians) = (open(None), cactus::cactus(8000).unwrap().gaussians);
    for options in [Options::EXACT, Options::BALANCED, Options::PREVIEW] {
        assert_eq!(slabs_of_whole(&device, &options, &gaussians, 16_000), 1);
        assert!(slabs_of_whole(&device, &options, &gaussians, 1000) > 8);
    }
    assert_valid(&device);
}

#[test]
fn splats_of_one_depth_are_cut_by_their_indices() {
    let (device, gaussians) = (open(None), cactus::cactus(3000).unwrap().gaussians);
    // With 8 bits, few depth keys are left, each of many splats.
    let options = Options { key_bits: 8, ..Options::BALANCED };
    assert!(slabs_of_whole(&device, &options, &gaussians, 200) > 10);
    assert_valid(&device);
}

/// Draws views of a scene as a whole and under a limit of memory, and compares every bit. `churns`: pages are evicted
/// at random. Returns the frames that were drawn under the limit.
fn compare_under_limit(
    options: &Options,
    (gaussians, cameras): (Gaussians, &[Camera]),
    limit: u64,
    churns: bool,
) -> Vec<Frame> {
    let source = SceneSource::of(gaussians);
    let (whole_device, device) = (open(None), open(Some(limit)));
    let draw = |device: &Device, cameras: Vec<&Camera>| {
        let scene = source.upload_with(device, options, Upload::reserving(1 << 20)).unwrap();
        if let Some(paged) = scene.paged() {
            paged.cache().churn = churns.then_some(7);
        }
        let mut renderer = Renderer::new(device, options, &scene).unwrap();
        let mut draw = |camera: &&Camera| {
            let frame = renderer.render(camera, BACKGROUND).unwrap();
            (frame, renderer.pixels().unwrap())
        };
        let drawn: Vec<_> = cameras.iter().map(&mut draw).collect();
        assert_valid(device);
        drawn
    };
    let whole = draw(&whole_device, cameras.iter().collect());
    // In another order: what was loaded before does not matter.
    let mut parts = draw(&device, cameras.iter().rev().collect());
    parts.reverse();
    for ((_, expected), (frame, drawn)) in whole.iter().zip(&parts) {
        assert_eq!(differing(drawn, expected), 0, "pixels that differ, {:?}", frame.parts);
    }
    parts.into_iter().map(|(frame, _)| frame).collect()
}

#[test]
fn presets_draw_the_same_bits_at_any_limit_of_memory() {
    draw_presets_under_limits(&["balanced", "portable"]);
}

#[test]
#[ignore = "long: every preset draws 120,000 splats under a limit"]
fn long_every_preset_draws_the_same_bits_at_any_limit_of_memory() {
    draw_presets_under_limits(&Options::PRESETS.map(|(name, _)| name));
}

fn draw_presets_under_limits(names: &[&str]) {
    for (name, options) in Options::PRESETS.into_iter().filter(|(name, _)| names.contains(name)) {
        let gaussians = cactus::cactus(120_000).unwrap().gaussians;
        // The limits lie between the least and the bytes of the scene. On the portable path, the pages that cross one
        // depth exceed such a small cache: its limits allow the whole scene on the device, but not its lists.
        let is_fast = FastPipeline::subgroup(&open(None), &options).is_some();
        let limit = match (options.shape_storage == Storage::Lossless, is_fast) {
            (true, true) => 64 << 20,
            (false, true) => 54 << 20,
            (true, false) => 72 << 20,
            (false, false) => 60 << 20,
        };
        // Frames take long where they are drawn on the CPU: from inside the scene, and for one preset from nearby, too.
        let cameras = views(&gaussians);
        let cameras = &cameras[..if name == "balanced" { 2 } else { 1 }];
        let frames = compare_under_limit(&options, (gaussians, cameras), limit, name == "balanced");
        let parts: Vec<_> = frames.iter().filter_map(|frame| frame.parts).collect();
        let is_paged = parts.iter().any(|parts| parts.slabs > 1 && parts.pages_read > 0);
        assert!(is_paged || !is_fast, "{name}: {parts:?}");
    }
}

#[test]
#[ignore = "long: 400,000 splats in pages on the portable path"]
fn long_the_farthest_pages_are_drawn_with_few_depth_keys() {
    // The farthest key is the largest that 8 bits hold, which the portable path has for splats without tiles.
    let mut builder = Builder::new(0, 400_000).unwrap();
    builder.extend(400_000, |i, sh| {
        let wall = i % 2 == 0;
        let part = |k: usize| (i / 2 * k % 997) as f64 / 997.0 - 0.5;
        let z = if wall { 63.5 + 0.4 * part(7) } else { 8.0 + 22.0 * (part(3) + 0.5) };
        sh[0] = if wall { [1.0, 0.2, 0.1] } else { [0.1, 0.3, 1.0] };
        let mean = [z * part(1), z * part(11), z];
        Raw { mean, log_scale: [-2.0; 3], rotation: [1.0, 0.0, 0.0, 0.0], opacity_logit: -2.0 }
    });
    let (gaussians, _) = builder.finish();
    let cameras = [Camera::looking_at(DVec3::ZERO, DVec3::Z, SIZE, 0.9)];
    let rules = Rules { near: 0.25, ..Options::BALANCED.rules };
    let options = Options { key_bits: 8, portable: true, rules, ..Options::BALANCED };
    let frames = compare_under_limit(&options, (gaussians, &cameras), 50 << 20, false);
    assert!(frames[0].parts.is_some_and(|parts| parts.pages_read > 0), "{:?}", frames[0].parts);
}

#[test]
fn hidden_pages_are_not_read() {
    let town = Procedural::parse("town:400000").unwrap().unwrap();
    let gaussians = town.make().unwrap().gaussians;
    let view = town.views(crate::procedural::TownPath::Street, 1).unwrap();
    let camera = crate::camera::path::looking(&view, SIZE).remove(0);
    let device = open(Some(56 << 20));
    let source = SceneSource::of(gaussians);
    let scene = source.upload_with(&device, &Options::BALANCED, Upload::reserving(1 << 20)).unwrap();
    let frame = Renderer::new(&device, &Options::BALANCED, &scene).unwrap().render(&camera, BACKGROUND).unwrap();
    let parts = frame.parts.expect("the town is larger than the limit");
    assert!(parts.pages_in_view < 391, "pages behind the camera are not in view: {parts:?}");
    assert_valid(&device);
}

#[test]
#[ignore = "long: certificates of 120,000 splats"]
fn long_certificates_and_depths_have_the_same_bits_in_slabs() {
    use crate::render::{Form, FrameOutputs, FrameQueue, HostFrame};
    let gaussians = cactus::cactus(120_000).unwrap().gaussians;
    let [_, camera, _] = views(&gaussians);
    let source = SceneSource::of(gaussians);
    let draw = |device: Device| {
        let options = Options::BALANCED;
        let scene =
            source.upload_with(&device, &options, Upload { is_certifiable: true, reserve_bytes: 2 << 20 }).unwrap();
        let mut certified = Renderer::certified(&device, &options, &scene).unwrap();
        let frame = certified.render(&camera, BACKGROUND).unwrap();
        let certificate = certified.certificate().unwrap().unwrap();
        let picture = certified.pixels().unwrap();
        drop((certified, scene));
        let scene = source.upload_with(&device, &options, Upload::reserving(2 << 20)).unwrap();
        let mut queue = FrameQueue::new(&device, Renderer::new(&device, &options, &scene).unwrap());
        let outputs = FrameOutputs { picture: vec![Form::Floats], depths: true, is_exported: false };
        let view = queue.start(&camera, BACKGROUND, &outputs, HostFrame::default()).unwrap();
        let mut host = queue.finish(view).unwrap().host;
        let layers = [host.picture().unwrap(), host.depths().unwrap()];
        assert_valid(&device);
        (frame.parts.map_or(0, |parts| parts.slabs), certificate, picture, layers)
    };
    let (slabs, certificate, picture, layers) = draw(open(None));
    assert_eq!(slabs, 0);
    let limited = draw(open(Some(57 << 20)));
    assert!(limited.0 > 1, "{} slabs", limited.0);
    assert_eq!(differing(&certificate, &limited.1), 0, "certificates");
    assert_eq!(differing(&picture, &limited.2), 0, "pictures with certificates");
    assert_eq!(layers.iter().zip(&limited.3).map(|(a, b)| differing(a, b)).sum::<usize>(), 0, "layers");
}

#[test]
fn a_limit_that_is_too_low_is_refused_with_the_bytes_that_are_missing() {
    let source = SceneSource::of(cactus::cactus(300_000).unwrap().gaussians);
    let bring = |limit: u64| {
        let device = open(Some(limit));
        source.upload_with(&device, &Options::EXACT, Upload::reserving(1 << 20)).map(|scene| (device, scene))
    };
    let limit = 34 << 20;
    let error = bring(limit).err().expect("so little memory is refused");
    let OutOfMemory { bytes, reason, .. } = error.downcast_ref().expect("the error reports the bytes");
    let left = reason.split(' ').next().and_then(|bytes| bytes.parse::<u64>().ok()).expect("the reason has the rest");
    let missing = bytes.unwrap() - left;
    assert!((1..32 << 20).contains(&missing), "{missing}");
    let (device, scene) = bring(limit + missing).expect("no more bytes are missing");
    let camera = Camera::looking_at(DVec3::new(0.0, -1.0, -4.0), DVec3::ZERO, SIZE, 1.0);
    Renderer::new(&device, &Options::EXACT, &scene).unwrap().render(&camera, BACKGROUND).unwrap();
    assert_valid(&device);
}

/// 2^32 instances and more are counted in 64 bits: nothing is blended, and no buffer holds them, so slabs draw.
#[test]
fn more_instances_than_32_bits_count_are_no_frame() {
    let device = open(None);
    // Each covers 256 x 64 tiles.
    let count = (1_usize << 32) / (256 * 64) + 1;
    let ball = |i: usize| Raw {
        mean: [0.0, 0.0, 5.0 + 1e-4 * i as f64],
        log_scale: [1e3_f64.ln(); 3],
        rotation: [1.0, 0.0, 0.0, 0.0],
        opacity_logit: 0.0,
    };
    let mut builder = Builder::new(0, count).unwrap();
    builder.extend(count, |i, _| ball(i));
    let scene = GpuScene::new(&device, &builder.finish().0, &Options::EXACT).unwrap();
    // The fast path's bins are larger: these are 2^28 entries.
    let options = Options { portable: true, ..Options::EXACT };
    // Rows of tiles that did not fit would be counted, but not their instances.
    let room =
        Capacity { gaussians: count, visible: count as u64, spans: 64 * count as u64, listed: 1, cells: 256 * 64 };
    let mut renderer = Renderer::new(&device, &options, &scene).unwrap().with_capacity(room).unwrap();
    let camera = Camera::looking_at(DVec3::ZERO, DVec3::Z, [4096, 1024], 0.9);
    let started = renderer.start(&camera, BACKGROUND).unwrap();
    let results = started.commands.wait().unwrap();
    let Counted::Whole(counted) = &started.recorded.counted else { panic!("the first frame is not cut") };
    let totals = results.view(counted)[0];
    assert_eq!(Capacity::of(&totals, 0, 0).listed, 256 * 64 * count as u64);
    assert_eq!((totals.listed_high, totals.listed_kept), (1, 0));
    assert!(renderer.judge(&results, &started.recorded).unwrap().is_none(), "the frame is not complete");
    let error = PortableWorkspace::new(&device, Capacity::of(&totals, 0, 0)).err().unwrap();
    assert!(error.is::<OutOfMemory>() && error.to_string().contains("instance"), "{error:#}");
    assert_valid(&device);
}
