//! The PSNR of levels of detail: what is estimated from patches is what whole pictures have, and what is asked for is
//! kept.

use std::sync::Arc;

use crate::common::{Gpu, open};
use glam::DVec3;
use smalto::camera::Camera;
use smalto::gpu::{Device, Validation};
use smalto::measure::metrics::{mse, psnr};
use smalto::options::Options;
use smalto::pagefile::PageFile;
use smalto::pagefile::write::{Job, Settings, write_whole};
use smalto::pixels::Pixels;
use smalto::procedural::cactus;
use smalto::render::{Form, FrameOutputs, FrameQueue, HostFrame, LodReport, Renderer, SceneSource, Upload};
use smalto::rules::Background;

const BACKGROUND: Background = Background::Colour([0.2, 0.4, 0.1]);

/// A view of the cactus from one of many sides.
fn view(side: u32, size: [u32; 2]) -> Camera {
    let angle = f64::from(side);
    let from = DVec3::new(2.5 * angle.sin(), -2.0, -2.5 * angle.cos());
    Camera::looking_at(from, DVec3::new(0.0, -1.2, 0.0), size, 0.9)
}

/// A page file of a cactus of this many Gaussians with levels.
fn file(count: usize) -> Arc<PageFile> {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("cactus.smalto");
    let settings = Settings { has_levels: true, ..Settings::default() };
    let job = Job::new(&output, settings, "test");
    write_whole(&job, &cactus(count).unwrap()).unwrap();
    Arc::new(PageFile::open(&output).unwrap())
}

fn renderer(device: &Device, file: &Arc<PageFile>, options: &Options) -> Renderer {
    let scene = SceneSource::of_file(file.clone());
    let scene = scene.upload_with(device, options, Upload::reserving(1 << 20)).unwrap();
    Renderer::new(device, options, &scene).unwrap()
}

/// The report and the picture by levels, and the picture of all Gaussians.
fn draw(renderer: &mut Renderer, camera: &Camera) -> (LodReport, [Pixels; 2]) {
    let report = renderer.render(camera, BACKGROUND).unwrap().detail.unwrap();
    let shown = renderer.pixels().unwrap();
    renderer.set_finest(true);
    renderer.render(camera, BACKGROUND).unwrap();
    renderer.set_finest(false);
    (report, [shown, renderer.pixels().unwrap()])
}

fn portable(options: Options) -> Options {
    Options { portable: true, ..options }
}

#[test]
fn the_estimate_of_all_patches_is_the_measured_psnr() {
    let gpu = Gpu::own();
    let file = file(40_000);
    let by_error = Options { lod_error: 20.0, ..Options::BALANCED };
    let by_count = Options { splats: 4000, ..Options::FAST };
    for options in [by_error, by_count, portable(by_error)] {
        let mut renderer = renderer(&gpu.0, &file, &options);
        for (side, size) in [[200, 150], [130, 65], [64, 64], [30, 300]].into_iter().enumerate() {
            let camera = view(side as u32, size);
            let (_, [shown, exact]) = draw(&mut renderer, &camera);
            let expected = mse(&shown, &exact);
            assert!(expected > 1e-7, "{options:?}, {size:?}: levels are seen");
            let sampled = renderer.sample_psnr(&camera, BACKGROUND, u32::MAX).unwrap();
            assert!((sampled.mse / expected - 1.0).abs() < 1e-9, "{sampled:?}, {expected}, {options:?}, {size:?}");
            assert_eq!(sampled.standard_error, 0.0);
        }
    }
    assert_eq!(gpu.0.validation_messages(), Vec::<String>::new());
}

#[test]
fn memory_and_steps_change_no_estimate() {
    let gpu = Gpu::own();
    let (file, camera) = (file(40_000), view(0, [192, 160]));
    let small = open(Validation::Required).with_small_limit(54 << 20).unwrap();
    let by_error = Options { lod_error: 100.0, ..Options::BALANCED };
    let by_psnr = Options { lod_psnr: 40.0, ..Options::BALANCED };
    for options in [by_error, by_psnr] {
        let [mut own, mut capped] = [&gpu.0, &small].map(|device| renderer(device, &file, &options));
        let expected = own.sample_psnr(&camera, BACKGROUND, 4).unwrap();
        assert!(expected.standard_error > 0.0, "{expected:?}");
        assert_eq!(capped.sample_psnr(&camera, BACKGROUND, 4).unwrap(), expected);
        let mut measurement = own.begin_measurement(&camera, BACKGROUND, 4).unwrap();
        let mut steps = Vec::new();
        while steps.last().is_none_or(Option::is_none) {
            steps.push(own.go_on_measuring(&mut measurement, 1).unwrap());
        }
        assert!(steps.len() > 1 && steps.last() == Some(&Some(expected)), "{steps:?}");
        let frames = [&mut own, &mut capped].map(|renderer| draw(renderer, &camera));
        assert_eq!(frames[0].0.measured_psnr, frames[1].0.measured_psnr);
        assert!(frames[0].1[0].rgba == frames[1].1[0].rgba);
    }
    for device in [&gpu.0, &small] {
        assert_eq!(device.validation_messages(), Vec::<String>::new());
    }
}

#[test]
fn estimates_of_few_patches_are_as_far_off_as_they_say() {
    let gpu = Gpu::new();
    let options = Options { lod_error: 100.0, ..Options::BALANCED };
    let mut renderer = renderer(&gpu.0, &file(40_000), &options);
    let (mut sum, mut within) = (0.0, 0);
    const VIEWS: u32 = 16;
    for side in 0..VIEWS {
        let camera = view(side, [320, 256]);
        let (_, [shown, exact]) = draw(&mut renderer, &camera);
        let sampled = renderer.sample_psnr(&camera, BACKGROUND, 10).unwrap();
        assert!(sampled.patches[0] >= 8 && sampled.patches[0] < sampled.patches[1], "{sampled:?}");

        let off = (sampled.mse - mse(&shown, &exact)) / sampled.standard_error;
        sum += off;
        within += u32::from(off.abs() < 2.0);
    }
    // The sum of so many standard errors.
    assert!((sum / f64::from(VIEWS).sqrt()).abs() < 4.0, "{sum}");
    assert!(within >= VIEWS * 3 / 4, "{within} of {VIEWS} are within two standard errors");
}

#[test]
fn a_psnr_that_is_asked_for_is_kept() {
    let gpu = Gpu::new();
    let file = file(20_000);
    let camera = view(0, [240, 200]);
    for wanted in [30.0_f32, 38.5, 50.0] {
        let options = Options { lod_psnr: wanted, ..Options::BALANCED };
        let mut own = renderer(&gpu.0, &file, &options);
        let (report, [shown, exact]) = draw(&mut own, &camera);
        let measured = psnr(&shown, &exact);
        assert!(measured >= f64::from(wanted), "{measured} dB instead of {wanted}");
        assert!((report.measured_psnr.unwrap() - measured).abs() < 1e-6, "{report:?}, {measured}");
        // A slightly coarser cut does not keep it.
        let coarser = Options { lod_error: 1.04 * report.lod_error as f32, lod_psnr: 0.0, ..options };
        let (_, [shown, exact]) = draw(&mut renderer(&gpu.0, &file, &coarser), &camera);
        assert!(psnr(&shown, &exact) < f64::from(wanted), "{wanted}: a coarser picture would do");
        // Other views before change nothing, and the queue of frames draws the same.
        own.render(&camera, BACKGROUND).unwrap();
        let expected = own.pixels().unwrap();
        let mut queue = FrameQueue::new(&gpu.0, renderer(&gpu.0, &file, &options));
        let outputs = FrameOutputs { picture: vec![Form::Floats], ..FrameOutputs::default() };
        for camera in [view(3, [240, 200]), camera.clone()] {
            let started = queue.start(&camera, BACKGROUND, &outputs, HostFrame::default()).unwrap();
            let mut finished = queue.finish(started).unwrap();
            let picture = finished.host.picture().unwrap();
            let patches = finished.frames[0].detail.unwrap().patches.unwrap();
            assert_eq!(patches[0], patches[1], "all are drawn");
            if camera == view(0, [240, 200]) {
                assert!(picture.rgba == expected.rgba, "{wanted}");
            }
        }
    }
}

/// Patches that show nothing of the scene do not count, and large pictures are drawn in bands.
#[test]
fn a_psnr_is_kept_where_the_scene_is_small_and_where_the_picture_is_large() {
    let gpu = Gpu::new();
    let file = file(16_000);
    let options = Options { lod_psnr: 55.0, ..Options::BALANCED };
    let mut renderer = renderer(&gpu.0, &file, &options);
    let (from, to) = (DVec3::new(0.0, 0.0, -25.0), DVec3::new(2.0, 1.0, 0.0));
    for camera in [Camera::looking_at(from, to, [960, 540], 0.9), view(0, [100, 700]), view(2, [2100, 2048])] {
        let (report, [shown, exact]) = draw(&mut renderer, &camera);
        let measured = psnr(&shown, &exact);
        let least = if report.standard_error == Some(0.0) { 55.0 } else { 53.0 };
        assert!(measured >= least, "{measured} dB, {report:?}");
    }
    assert_eq!(gpu.0.validation_messages(), Vec::<String>::new());
}

/// What pictures refuse is refused by measurements, too.
#[test]
fn a_lens_sees_no_levels() {
    let gpu = Gpu::new();
    let mut renderer = renderer(&gpu.0, &file(40_000), &Options { lod_error: 20.0, ..Options::BALANCED });
    let fisheye = smalto::camera::Lens::named("FISHEYE", &[]).unwrap();
    let camera = Camera { lens: fisheye.map(Arc::new), ..view(0, [64, 64]) };
    let refusal = renderer.sample_psnr(&camera, BACKGROUND, 8).unwrap_err().to_string();
    assert!(refusal.contains("a camera with a lens"), "{refusal}");
}

#[test]
fn a_psnr_beyond_all_levels_is_drawn_with_all_gaussians() {
    let gpu = Gpu::new();
    let options = Options { lod_psnr: 100.0, ..Options::BALANCED };
    let mut renderer = renderer(&gpu.0, &file(40_000), &options);
    let (report, [shown, exact]) = draw(&mut renderer, &view(1, [128, 96]));
    assert!(psnr(&shown, &exact) >= 100.0);
    assert!(report.measured_psnr.is_none_or(|measured| measured >= 100.0), "{report:?}");
}
