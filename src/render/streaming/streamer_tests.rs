//! Pictures that do not wait for pages: they become those that do, and are near them where memory is short.

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
use crate::render::lod::fixtures::{brought, open, with_levels};
use crate::render::renderer::Renderer;
use crate::render::scene::GpuScene;
use crate::rules::{Background, Rules};
use crate::scene::{Focus, Transform};

const SIZE: [u32; 2] = [200, 130];
const BACKGROUND: Background = Background::Colour([0.1, 0.2, 0.3]);

fn streaming(device: &Device, scene: &GpuScene, options: &Options) -> Renderer {
    let mut renderer = Renderer::new(device, options, scene).unwrap();
    renderer.enable_page_streaming().unwrap();
    renderer
}

/// Draws until nothing more comes.
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

fn differing(a: &Pixels, b: &Pixels) -> usize {
    a.rgba.iter().zip(&b.rgba).filter(|(a, b)| a.map(f32::to_bits) != b.map(f32::to_bits)).count()
}

fn waited_for(device: &Device, scene: &GpuScene, options: &Options, camera: &Camera) -> Pixels {
    let mut renderer = Renderer::new(device, options, scene).unwrap();
    renderer.render(camera, BACKGROUND).unwrap();
    renderer.pixels().unwrap()
}

#[test]
fn pictures_that_do_not_wait_become_those_that_do() {
    let scene = cactus::cactus(120_000).unwrap();
    let focus = Focus::of(&scene.gaussians);
    let (file, device) = (with_levels(scene, Settings::LOSSLESS), open(None));
    let beside = Transform::new(glam::DQuat::from_rotation_y(0.7), [3.0, 0.0, 1.0].into(), 1.5).unwrap();
    let plain = Options { rules: Rules { near: 0.01, ..Rules::TRAINED }, ..Options::EXACT };
    for places in [&[][..], &[Transform::IDENTITY, beside]] {
        for options in [plain.finest(), Options { splats: 20_000, ..plain }] {
            let scene = brought(&device, &file, places, &options);
            let mut renderer = streaming(&device, &scene, &options);
            let first = renderer.residency().unwrap();
            assert!(first.there < first.fitting, "{first:?}");
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

/// The pages that do not fit are those that matter least, so the picture is near that of all, and nothing flickers.
#[test]
fn what_does_not_fit_is_drawn_coarser() {
    let scene = cactus::cactus(120_000).unwrap();
    let focus = Focus::of(&scene.gaussians);
    let options = Options { rules: Rules { near: 0.01, ..Rules::TRAINED }, ..Options::BALANCED }.finest();
    let file = with_levels(scene, Options::BALANCED);
    let (device, small) = (open(None), open(Some(60 << 20)));
    let (all, some) = (brought(&device, &file, &[], &options), brought(&small, &file, &[], &options));
    let mut renderer = streaming(&small, &some, &options);
    for zoom in [0.3, 1.0, 0.2] {
        let camera = Camera::framing(focus.centre.into(), focus.radius * zoom, SIZE);
        let (pixels, residency) = settle(&mut renderer, &camera);
        assert!(residency.fitting < 2 * file.pages().len() / 3, "{residency:?}");
        assert!(residency.missing > 0 || zoom < 1.0, "{residency:?}");
        let again = settle(&mut renderer, &camera).0;
        assert_eq!(differing(&pixels, &again), 0, "zoom {zoom}");
        let expected = waited_for(&device, &all, &options, &camera);
        let squares = |(a, b): (&[f32; 4], &[f32; 4])| (0..3).map(|i| f64::from(a[i] - b[i]).powi(2)).sum::<f64>();
        let sum: f64 = pixels.rgba.iter().zip(&expected.rgba).map(squares).sum();
        let psnr = -10.0 * (sum / (3 * pixels.rgba.len()) as f64).log10();
        // Half of the pages, chosen for this view.
        assert!(psnr > 28.0, "zoom {zoom}: {psnr} dB, {residency:?}");
    }
    assert_eq!(small.validation_messages(), Vec::<String>::new());
}

/// While pages are missing, a look shows by how much their parents are coarser than asked for.
#[test]
fn a_look_shows_what_is_missing() {
    let scene = cactus::cactus(120_000).unwrap();
    let focus = Focus::of(&scene.gaussians);
    let (file, device) = (with_levels(scene, Options::BALANCED), open(None));
    let options = Options { splats: 60_000, ..Options::BALANCED };
    let scene = brought(&device, &file, &[], &options);
    let mut renderer = streaming(&device, &scene, &options);
    renderer.set_inspection(Inspection::of_attribute(Attribute::Lag)).unwrap();
    let camera = Camera::framing(focus.centre.into(), focus.radius, SIZE);
    let lag = |pixels: &Pixels| pixels.rgba.iter().map(|p| p[0] / p[3].max(1e-6)).fold(0.0, f32::max);
    renderer.render(&camera, BACKGROUND).unwrap();
    let first = lag(&renderer.pixels().unwrap());
    assert!(first > 0.5 && first < 16.0, "the coarsest pages alone: {first}");
    assert_eq!(lag(&settle(&mut renderer, &camera).0), 0.0);
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}

/// Pages arrive faster than buffers grow, so a frame that is repeated must not show more of them each time.
#[test]
fn a_frame_that_is_repeated_shows_the_same_pages() {
    let scene = cactus::cactus(150_000).unwrap();
    let focus = Focus::of(&scene.gaussians);
    let (file, device) = (with_levels(scene, Options::BALANCED), open(None));
    let options = Options::BALANCED.finest();
    let scene = brought(&device, &file, &[], &options);
    let mut renderer = streaming(&device, &scene, &options);
    let camera = Camera::framing(focus.centre.into(), focus.radius, SIZE);
    let changes = || scene.paged().unwrap().cache().changes();
    for _ in 0..2 {
        renderer = renderer.with_capacity(Capacity::default()).unwrap();
        let before = changes();
        let frame = renderer.render(&camera, BACKGROUND).unwrap();
        assert!(frame.attempts > 2 && changes() <= before + 1, "{} attempts", frame.attempts);
        while !renderer.has_news() && !renderer.residency().unwrap().is_settled() {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}

/// While a view moves, the pages come that it needs a moment later, and the picture of now shows the same as without.
#[test]
fn pages_are_there_when_the_view_arrives() {
    let scene = cactus::cactus(150_000).unwrap();
    let focus = Focus::of(&scene.gaussians);
    let (file, device) = (with_levels(scene, Options::BALANCED), open(None));
    let options = Options { splats: 30_000, rules: Rules { near: 0.01, ..Rules::TRAINED }, ..Options::BALANCED };
    let far = Camera::framing(focus.centre.into(), focus.radius, SIZE);
    // It comes nearer by the same part of the way each time.
    let at = |part: f64| Camera { position: far.position.lerp(focus.centre.into(), part), ..far.clone() };
    let lacking = |moves: bool| {
        let scene = brought(&device, &file, &[], &options);
        let mut renderer = streaming(&device, &scene, &options);
        settle(&mut renderer, &at(0.3));
        if moves {
            // It comes from so far that there are some pictures on the way, also on a machine that is busy.
            let begun = Instant::now();
            let mut part = -2.0;
            while part < 0.3 {
                part = (begun.elapsed().as_secs_f64() - 2.0).min(0.3);
                renderer.render(&at(part), BACKGROUND).unwrap();
            }
        }
        let (pixels, _) = settle(&mut renderer, &at(0.3));
        renderer.render(&at(0.6), BACKGROUND).unwrap();
        (renderer.residency().unwrap().missing, pixels)
    };
    let (without, still) = lacking(false);
    assert!(without > 20, "{without} pages are missing");
    // The picture before the last may still be busy with what it asked for.
    let come = (0..5).any(|_| {
        let (with, moved) = lacking(true);
        assert_eq!(differing(&still, &moved), 0);
        with < 2 * without / 3
    });
    assert!(come, "about {without} pages are missing with and without a motion");
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}
