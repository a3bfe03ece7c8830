//! Streamed frames: they become equal to frames that wait for pages, and close to them where memory is short.

use std::time::{Duration, Instant};

use super::streamer::Residency;
use crate::camera::Camera;
use crate::gpu::Device;
use crate::options::Options;
use crate::pagefile::write::Settings;
use crate::pixels::Pixels;
use crate::procedural::cactus;
use crate::render::capacity::Capacity;
use crate::render::inspect::{Attribute, Inspection};
use crate::render::lod::fixtures::{open, opened_scene, with_levels, with_source_levels};
use crate::render::renderer::Renderer;
use crate::render::scene::GpuScene;
use crate::rules::{Background, Rules};
use crate::scene::{Focus, Transform};

const SIZE: [u32; 2] = [200, 130];
const BACKGROUND: Background = Background::Colour([0.1, 0.2, 0.3]);

/// A renderer that streams pages and predicts no motion: its motion clock stands still.
fn streaming(device: &Device, scene: &GpuScene, options: &Options) -> Renderer {
    let mut renderer = Renderer::new(device, options, scene).unwrap();
    renderer.enable_page_streaming().unwrap();
    renderer.streamer().set_motion_time(Duration::ZERO);
    renderer
}

/// Draws until no page is loading and further frames show the same.
fn settle(renderer: &mut Renderer, camera: &Camera) -> (Pixels, Residency) {
    let begun = Instant::now();
    loop {
        renderer.render(camera, BACKGROUND).unwrap();
        while !renderer.has_news() && !renderer.residency().unwrap().is_settled() {
            std::thread::sleep(Duration::from_millis(1));
        }
        let residency = renderer.residency().unwrap();
        assert!(renderer.take_problem().is_none());
        assert!(begun.elapsed() < Duration::from_secs(100), "it settles: {residency:?}");
        if !renderer.has_news() {
            return (renderer.pixels().unwrap(), residency);
        }
    }
}

/// Does the same as [`settle`], but draws no frame while pages are loading, so that all runs request the same pages.
fn settle_in_step(renderer: &mut Renderer, camera: &Camera) -> Pixels {
    loop {
        renderer.render(camera, BACKGROUND).unwrap();
        renderer.streamer().wait_for_loads();
        assert!(renderer.take_problem().is_none());
        if !renderer.has_news() {
            return renderer.pixels().unwrap();
        }
    }
}

fn differing(a: &Pixels, b: &Pixels) -> usize {
    a.rgba.iter().zip(&b.rgba).filter(|(a, b)| a.map(f32::to_bits) != b.map(f32::to_bits)).count()
}

/// A frame that waits for its pages.
fn waited_for(device: &Device, scene: &GpuScene, options: &Options, camera: &Camera) -> Pixels {
    let mut renderer = Renderer::new(device, options, scene).unwrap();
    renderer.render(camera, BACKGROUND).unwrap();
    renderer.pixels().unwrap()
}

#[test]
fn streamed_frames_become_equal_to_frames_that_wait() {
    let scene = cactus::cactus(60_000).unwrap();
    let focus = Focus::of(&scene.gaussians);
    let of_source = with_source_levels(cactus::cactus(60_000).unwrap(), 5000, Settings::LOSSLESS);
    let (file, device) = (with_levels(scene, Settings::LOSSLESS), open(None));
    let beside = Transform::new(glam::DQuat::from_rotation_y(0.7), [3.0, 0.0, 1.0].into(), 1.5).unwrap();
    let plain = Options { rules: Rules { near: 0.01, ..Rules::TRAINED }, ..Options::EXACT };
    for (file, places) in [(&file, &[][..]), (&file, &[Transform::IDENTITY, beside]), (&of_source, &[])] {
        for options in [plain.finest(), Options { splats: 20_000, ..plain }] {
            let scene = opened_scene(&device, file, places, &options);
            let mut renderer = streaming(&device, &scene, &options);
            let first = renderer.residency().unwrap();
            assert!(first.resident < first.capacity, "{first:?}");
            for zoom in [0.1, 1.0, 3.0] {
                let camera = Camera::framing(focus.centre.into(), focus.radius * zoom, SIZE);
                let (pixels, residency) = settle(&mut renderer, &camera);
                assert_eq!(residency.missing, 0, "zoom {zoom}: {residency:?}");
                let expected = waited_for(&device, &scene, &options, &camera);
                assert_eq!(differing(&pixels, &expected), 0, "zoom {zoom} at {places:?}");
            }
        }
    }
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}

/// Nearly all pages have none in their place, but all fit.
#[test]
fn a_large_environment_is_streamed() {
    let file = with_source_levels(cactus::cactus(30_100).unwrap(), 30_000, Settings::LOSSLESS);
    let (device, options) = (open(None), Options { splats: 30_050, ..Options::EXACT });
    let scene = opened_scene(&device, &file, &[], &options);
    let mut renderer = streaming(&device, &scene, &options);
    let focus = file.statistics().focus;
    let camera = Camera::framing(focus.centre.into(), focus.radius, SIZE);
    let (pixels, residency) = settle(&mut renderer, &camera);
    assert_eq!((residency.missing, residency.capacity), (0, file.pages().len()));
    assert_eq!(differing(&pixels, &waited_for(&device, &scene, &options, &camera)), 0);
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}

/// With a small page cache, the pages of the lowest priorities are missing, so the picture is close to that of all
/// pages, and settled frames are equal.
#[test]
fn pages_that_do_not_fit_are_drawn_coarser() {
    let scene = cactus::cactus(120_000).unwrap();
    let focus = Focus::of(&scene.gaussians);
    let options = Options { rules: Rules { near: 0.01, ..Rules::TRAINED }, ..Options::BALANCED }.finest();
    let file = with_levels(scene, Options::BALANCED);
    let (device, small) = (open(None), open(Some(60 << 20)));
    let (all, some) = (opened_scene(&device, &file, &[], &options), opened_scene(&small, &file, &[], &options));
    let mut renderer = streaming(&small, &some, &options);
    for zoom in [0.3, 1.0, 0.2] {
        let camera = Camera::framing(focus.centre.into(), focus.radius * zoom, SIZE);
        let (pixels, residency) = settle(&mut renderer, &camera);
        assert!(residency.capacity < 2 * file.pages().len() / 3, "{residency:?}");
        assert!(residency.missing > 0 || zoom < 1.0, "{residency:?}");
        let again = settle(&mut renderer, &camera).0;
        assert_eq!(differing(&pixels, &again), 0, "zoom {zoom}");
        let expected = waited_for(&device, &all, &options, &camera);
        let squares = |(a, b): (&[f32; 4], &[f32; 4])| (0..3).map(|i| f64::from(a[i] - b[i]).powi(2)).sum::<f64>();
        let sum: f64 = pixels.rgba.iter().zip(&expected.rgba).map(squares).sum();
        let psnr = -10.0 * (sum / (3 * pixels.rgba.len()) as f64).log10();
        // Half of the pages, selected for this view.
        assert!(psnr > 28.0, "zoom {zoom}: {psnr} dB, {residency:?}");
    }
    assert_eq!(small.validation_messages(), Vec::<String>::new());
}

/// While pages are missing, the attribute `lag` shows by how many levels their parents are coarser than selected.
#[test]
fn the_lag_shows_missing_pages() {
    let scene = cactus::cactus(60_000).unwrap();
    let focus = Focus::of(&scene.gaussians);
    let (file, device) = (with_levels(scene, Options::BALANCED), open(None));
    let options = Options { splats: 30_000, ..Options::BALANCED };
    let scene = opened_scene(&device, &file, &[], &options);
    let mut renderer = streaming(&device, &scene, &options);
    renderer.set_inspection(Inspection::of_attribute(Attribute::Lag)).unwrap();
    let camera = Camera::framing(focus.centre.into(), focus.radius, SIZE);
    let lag = |pixels: &Pixels| pixels.rgba.iter().map(|p| p[0] / p[3].max(1e-6)).fold(0.0, f32::max);
    renderer.render(&camera, BACKGROUND).unwrap();
    let first = lag(&renderer.pixels().unwrap());
    assert!(first > 0.5 && first < 16.0, "the pinned pages alone: {first}");
    assert_eq!(lag(&settle(&mut renderer, &camera).0), 0.0);
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}

/// Pages are loaded faster than buffers grow, so each attempt of a frame must draw the same resident pages.
#[test]
fn all_attempts_of_a_frame_draw_the_same_pages() {
    let scene = cactus::cactus(150_000).unwrap();
    let focus = Focus::of(&scene.gaussians);
    let (file, device) = (with_levels(scene, Options::BALANCED), open(None));
    let options = Options::BALANCED.finest();
    let scene = opened_scene(&device, &file, &[], &options);
    let mut renderer = streaming(&device, &scene, &options);
    let camera = Camera::framing(focus.centre.into(), focus.radius, SIZE);
    let generation = || scene.paged().unwrap().cache().generation();
    for _ in 0..2 {
        renderer = renderer.with_capacity(Capacity::default()).unwrap();
        let before = generation();
        let frame = renderer.render(&camera, BACKGROUND).unwrap();
        assert!(frame.attempts > 2 && generation() <= before + 1, "{} attempts", frame.attempts);
        renderer.streamer().wait_for_loads();
    }
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}

/// While the camera moves, pages of its next views are prefetched, and the present view shows the same as without.
#[test]
fn pages_are_resident_when_the_camera_arrives() {
    let scene = cactus::cactus(150_000).unwrap();
    let focus = Focus::of(&scene.gaussians);
    let (file, device) = (with_levels(scene, Options::BALANCED), open(None));
    let options = Options { splats: 30_000, rules: Rules { near: 0.01, ..Rules::TRAINED }, ..Options::BALANCED };
    let far = Camera::framing(focus.centre.into(), focus.radius, SIZE);
    let at = |fraction: f64| Camera { position: far.position.lerp(focus.centre.into(), fraction), ..far.clone() };
    let arrive = |moves: bool| {
        let scene = opened_scene(&device, &file, &[], &options);
        let mut renderer = streaming(&device, &scene, &options);
        settle_in_step(&mut renderer, &at(0.3));
        if moves {
            // Frames every 20 ms, 2 % of the way each: in 300 ms the camera will be at 0.6.
            for step in 0..=20 {
                renderer.streamer().set_motion_time(Duration::from_millis(2000 + 20 * step));
                renderer.render(&at(0.02 * step as f64 - 0.1), BACKGROUND).unwrap();
                renderer.streamer().wait_for_loads();
            }
        }
        let pixels = settle_in_step(&mut renderer, &at(0.3));
        renderer.render(&at(0.6), BACKGROUND).unwrap();
        (renderer.residency().unwrap().missing, pixels)
    };
    let (missing_without, still) = arrive(false);
    assert!(missing_without > 20, "{missing_without} pages are missing");
    let (missing, moved) = arrive(true);
    assert_eq!(differing(&still, &moved), 0);
    assert!(missing < missing_without / 4, "{missing} pages are missing, {missing_without} without the motion");
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}
