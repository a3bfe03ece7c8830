//! Scenes with scene instances show the pictures of transformed and joined scenes, in the memory of one.

use std::sync::Arc;

use glam::{DQuat, DVec3};

use crate::camera::Camera;
use crate::gpu::Device;
use crate::options::Options;
use crate::packing::Statistics;
use crate::pagefile::Pages;
use crate::pixels::Pixels;
use crate::procedural::cactus;
use crate::render::lod::fixtures::open;
use crate::render::renderer::Renderer;
use crate::render::scene::gpu_scene::CACHE_FRACTION;
use crate::render::scene::{Content, GpuScene, SceneSource, Upload};
use crate::rules::{Background, Order, Rules};
use crate::scene::{Focus, Gaussians, SceneInstances, Transform};

use crate::render::scene::PageCache;

const SIZE: [u32; 2] = [200, 130];
const BACKGROUND: Background = Background::Colour([0.1, 0.2, 0.3]);

fn draw(device: &Device, options: &Options, scene: &GpuScene, camera: &Camera) -> (Pixels, u64) {
    let mut renderer = Renderer::new(device, options, scene).unwrap();
    let frame = renderer.render(camera, BACKGROUND).unwrap();
    let pixels = renderer.pixels().unwrap();
    assert_eq!(device.validation_messages(), Vec::<String>::new());
    (pixels, frame.parts.map_or(0, |parts| parts.pages_in_view))
}

/// The picture of a scene with scene instances.
fn placed(device: &Device, options: &Options, gaussians: &Gaussians, places: &[Transform], camera: &Camera) -> Pixels {
    draw(device, options, &bring(device, options, gaussians, places), camera).0
}

fn bring(device: &Device, options: &Options, gaussians: &Gaussians, places: &[Transform]) -> GpuScene {
    let instances = SceneInstances::new(places.to_vec()).unwrap();
    let source = SceneSource { instances: Some(instances), ..SceneSource::of(gaussians.clone()) };
    source.upload_with(device, options, Upload::reserving(1 << 20)).unwrap()
}

/// The picture of a scene in memory as a whole.
fn whole(device: &Device, options: &Options, gaussians: &Gaussians, camera: &Camera) -> Pixels {
    draw(device, options, &GpuScene::new(device, gaussians, options).unwrap(), camera).0
}

fn differing(a: &Pixels, b: &Pixels) -> usize {
    a.rgba.iter().zip(&b.rgba).filter(|(a, b)| a.map(f32::to_bits) != b.map(f32::to_bits)).count()
}

fn psnr(a: &Pixels, b: &Pixels) -> f64 {
    let squares = a.rgba.iter().flatten().zip(b.rgba.iter().flatten()).map(|(a, b)| f64::from(a - b).powi(2));
    -10.0 * (squares.sum::<f64>() / (4 * a.rgba.len()) as f64).log10()
}

fn place(position: [f64; 3], turn: [f64; 4], scale: f64) -> Transform {
    Transform::new(DQuat::from_array(turn), position.into(), scale).unwrap()
}

const UNTURNED: [f64; 4] = [0.0, 0.0, 0.0, 1.0];

/// Two scene instances that are apart, one of them turned and made larger, and a camera that sees both.
fn two(gaussians: &Gaussians) -> ([Transform; 2], Camera) {
    let focus = Focus::of(gaussians);
    let aside = focus.radius * 1.5;
    let places = [
        place([-aside, 0.0, 0.0], UNTURNED, 1.0),
        place([aside, 0.1, 2.0 * focus.radius], [0.3, -0.6, 0.2, 0.7], 1.75),
    ];
    let seen = SceneInstances::new(places.to_vec()).unwrap().focus(focus);
    (places, Camera::framing(seen.centre.into(), seen.radius * 0.8, SIZE))
}

#[test]
fn a_scene_at_the_identity_has_the_bits_of_the_scene() {
    let gaussians = cactus::cactus(5000).unwrap().gaussians;
    let device = open(None);
    let focus = Focus::of(&gaussians);
    for options in [Options::BALANCED, Options::FAST] {
        for zoom in [0.2, 1.0] {
            let camera = Camera::framing(focus.centre.into(), focus.radius * zoom, SIZE);
            let expected = whole(&device, &options, &gaussians, &camera);
            let drawn = placed(&device, &options, &gaussians, &[Transform::IDENTITY], &camera);
            assert_eq!(differing(&drawn, &expected), 0, "zoom {zoom}");
        }
    }
}

#[test]
fn places_show_what_the_transformed_and_joined_scene_shows() {
    let gaussians = cactus::cactus(5000).unwrap().gaussians;
    let device = open(None);
    let (places, camera) = two(&gaussians);
    let parts = places.map(|place| gaussians.transformed(&place).unwrap());
    let joined = Gaussians::joined(parts.iter()).unwrap();
    let by_distance = Rules { order: Order::Distance, ..Options::EXACT.rules };
    for options in [Options::EXACT, Options { rules: by_distance, ..Options::EXACT }] {
        let expected = whole(&device, &options, &joined, &camera);
        let drawn = placed(&device, &options, &gaussians, &places, &camera);
        let (db, empty) = (psnr(&drawn, &expected), whole(&device, &options, &parts[0], &camera));
        assert!(db > 60.0, "{db} dB");
        assert!(psnr(&empty, &expected) < 40.0, "the second place is seen");
    }
}

#[test]
fn a_place_is_drawn_from_any_distance_of_the_origin() {
    let gaussians = cactus::cactus(3000).unwrap().gaussians;
    let device = open(None);
    let focus = Focus::of(&gaussians);
    let camera = Camera::framing(focus.centre.into(), focus.radius, SIZE);
    let expected = whole(&device, &Options::EXACT, &gaussians, &camera);
    // A power of 2, so that sums with it lose few bits of 64, but nearly all of 32.
    let far = DVec3::new(f64::from(1 << 22), 0.0, -f64::from(1 << 21));
    let there = Camera { position: camera.position + far, ..camera };
    let drawn = placed(&device, &Options::EXACT, &gaussians, &[place(far.to_array(), UNTURNED, 1.0)], &there);
    let db = psnr(&drawn, &expected);
    assert!(db > 80.0, "{db} dB");
}

#[test]
fn bits_depend_neither_on_memory_nor_on_evicted_pages() {
    let gaussians = cactus::cactus(30_000).unwrap().gaussians;
    let options = Options::BALANCED;
    let (places, camera) = two(&gaussians);
    let places = [places.as_slice(), &[place([0.0, -0.2, 1.0], [0.0, 0.5, 0.0, 0.8], 0.6)]].concat();
    let expected = placed(&open(None), &options, &gaussians, &places, &camera);
    for seed in [None, Some(1), Some(2)] {
        let device = open(Some(72 << 20));
        let scene = bring(&device, &options, &gaussians, &places);
        let capacity = scene.paged().unwrap().cache().capacity();
        scene.paged().unwrap().cache().churn = seed;
        let (drawn, _) = draw(&device, &options, &scene, &camera);
        assert_eq!(differing(&drawn, &expected), 0, "seed {seed:?}, {capacity} slots");
        let memory = device.memory();
        assert!(memory.peak <= memory.limit.unwrap(), "{memory:?}");
    }
}

#[test]
fn bits_do_not_depend_on_the_number_of_pages_in_memory() {
    let gaussians = cactus::cactus(80_000).unwrap().gaussians;
    let options = Options::EXACT;
    let (places, camera) = two(&gaussians);
    let device = open(None);
    let expected = placed(&device, &options, &gaussians, &places, &camera);
    let gaussians = Arc::new(gaussians);
    let pages = Pages::of_gaussians(gaussians.clone(), Statistics::of(&gaussians), &options);
    // Room for 70 of 79 pages, so that every slab with all of them takes several batches.
    let reserve = device.free_bytes() - (70.5 * PageCache::bytes_each(&pages) as f64 / CACHE_FRACTION) as u64;
    let scene = GpuScene::of_pages(&device, &pages, &options, reserve).unwrap();
    assert_eq!(scene.paged().unwrap().cache().capacity(), 70);
    let scene = scene.placed(&SceneInstances::new(places.to_vec()).unwrap()).unwrap();
    let (drawn, seen) = draw(&device, &options, &scene, &camera);
    assert!(seen > 140, "{seen} pages of two places in view");
    assert_eq!(differing(&drawn, &expected), 0);
}

#[test]
fn thousands_of_places_take_the_memory_of_one() {
    let gaussians = cactus::cactus(2000).unwrap().gaussians;
    let device = open(None);
    let radius = Focus::of(&gaussians).radius;
    let at = |i: i32| place([3.0 * radius * f64::from(i % 50), 0.0, 3.0 * radius * f64::from(i / 50)], UNTURNED, 1.0);
    let many: Vec<_> = (0..2000).map(at).collect();
    let options = Options::FAST;
    let scene = bring(&device, &options, &gaussians, &many);
    let bytes = |scene: &GpuScene| scene.buffers().iter().map(|(_, bytes)| *bytes).sum::<u64>();
    assert_eq!(bytes(&scene), bytes(&bring(&device, &options, &gaussians, &many[..1])));
    // The camera stands before the first row and sees nothing of what is behind it.
    let target = many[999].translation();
    let camera = Camera::looking_at(many[24].translation() - DVec3::new(0.0, radius, 6.0 * radius), target, SIZE, 1.0);
    let (drawn, seen) = draw(&device, &options, &scene, &camera);
    assert_eq!(scene.pages_read().unwrap().pages, 2, "pages are read once for all places");
    assert!((500..4000).contains(&seen), "{seen} pages in view");
    let (first, _) = draw(&device, &options, &bring(&device, &options, &gaussians, &many[24..25]), &camera);
    assert!(psnr(&drawn, &first) < 30.0, "other places are seen, too");
}

#[test]
fn gaussians_of_equal_depth_are_drawn_in_the_order_of_their_places() {
    let gaussians = cactus::cactus(3000).unwrap().gaussians;
    let device = open(None);
    let focus = Focus::of(&gaussians);
    let camera = Camera::framing(focus.centre.into(), focus.radius, SIZE);
    // Key bits of 1 make nearly all depths equal.
    let options = Options { key_bits: 1, ..Options::EXACT };
    let moved = place([0.05, 0.0, 0.0], UNTURNED, 1.0);
    let [one, other] = [[Transform::IDENTITY, moved], [moved, Transform::IDENTITY]].map(|places| {
        let parts = places.map(|place| gaussians.transformed(&place).unwrap());
        let expected = whole(&device, &options, &Gaussians::joined(parts.iter()).unwrap(), &camera);
        let drawn = placed(&device, &options, &gaussians, &places, &camera);
        let db = psnr(&drawn, &expected);
        assert!(db > 60.0, "{db} dB");
        drawn
    });
    let db = psnr(&one, &other);
    assert!(db < 50.0, "the order of places matters: {db} dB");
}

#[test]
fn more_gaussians_than_can_be_ordered_are_refused() {
    let gaussians = cactus::cactus(3000).unwrap().gaussians;
    let device = open(None);
    let source = SceneSource::of(gaussians);
    let Content::Memory { gaussians, statistics } = &source.content else { panic!("the scene is in memory") };
    let pages = Pages::of_gaussians(Arc::clone(gaussians), (**statistics).clone(), &Options::FAST);
    let scene = GpuScene::of_pages(&device, &pages, &Options::FAST, 1 << 20).unwrap();
    let count = u32::MAX as usize / scene.len();
    let places = |count: usize| SceneInstances::new(vec![Transform::IDENTITY; count]).unwrap();
    assert!(scene.clone().placed(&places(count)).is_ok());
    let error = scene.placed(&places(count + 1)).err().unwrap().to_string();
    assert!(error.contains("which is the most that can be ordered"), "{error}");
}
