//! Bands of pictures: they have the bits of the whole picture, on one device and on several.

use std::collections::BTreeSet;
use std::sync::Arc;

use crate::common::lens::{all, around, sphere};
use crate::common::{Gpu, Random, open, read_captured};
use glam::DVec3;
use smalto::camera::Camera;
use smalto::gpu::{Commands, Device, Validation};
use smalto::options::Options;
use smalto::pagefile::PageFile;
use smalto::pagefile::write::{Job, Settings, write_whole};
use smalto::pixels::{Integers, Pixels};
use smalto::procedural::cactus;
use smalto::render::{
    BAND_ROWS, Band, Form, FrameOutputs, GpuScene, Inspection, OtherDevices, Renderer, SceneSource, SplitFrame,
    SplitRenderer, Upload,
};
use smalto::rules::Background;

const BACKGROUND: Background = Background::Colour([0.2, 0.4, 0.1]);

fn view(size: [u32; 2]) -> Camera {
    Camera::looking_at(DVec3::new(1.5, -2.5, -3.0), DVec3::new(0.0, -1.2, 0.0), size, 0.9)
}

fn bits(pixels: &Pixels) -> Vec<[u32; 4]> {
    pixels.rgba.iter().map(|pixel| pixel.map(f32::to_bits)).collect()
}

/// The pixels of all bands that end at multiples of `rows`, one below the other, and the same of what `read` reads.
fn in_bands(renderer: &mut Renderer, camera: &Camera, rows: u32, read: impl Fn(&Renderer) -> Pixels) -> Pixels {
    let height = camera.size_px[1];
    let borders = Vec::from_iter((rows..height).step_by(rows as usize));
    let mut rgba = Vec::new();
    for band in Band::between(&borders, height) {
        renderer.set_band(Some(band));
        renderer.render(camera, BACKGROUND).unwrap();
        let pixels = read(renderer);
        assert_eq!(pixels.size, band.size(camera.size_px));
        rgba.extend(pixels.rgba);
    }
    renderer.set_band(None);
    Pixels { size: camera.size_px, rgba }
}

fn check(renderer: &mut Renderer, camera: &Camera, what: &str) {
    let frame = renderer.render(camera, BACKGROUND).unwrap();
    let whole = renderer.pixels().unwrap();
    assert!(frame.totals.visible_kept > 0, "{what}: nothing is seen");
    let unit = renderer.band_rows(camera);
    assert!(BAND_ROWS.is_multiple_of(unit), "{what}");
    for rows in BTreeSet::from([unit, BAND_ROWS]) {
        let parts = in_bands(renderer, camera, rows, |renderer| renderer.pixels().unwrap());
        assert!(bits(&whole) == bits(&parts), "{what}: bands of {rows} rows differ");
    }
}

fn presets() -> Vec<(&'static str, Options)> {
    let names = ["exact", "balanced", "fast", "portable", "inria", "gsplat", "khr"];
    names.into_iter().map(|name| (name, Options::preset(name).unwrap())).filter(|(_, o)| o.scale == 1.0).collect()
}

#[test]
fn bands_have_the_bits_of_the_whole_picture() {
    let gpu = Gpu::new();
    let scene = cactus(6000).unwrap().gaussians;
    for (name, options) in presets() {
        let uploaded = GpuScene::new(&gpu.0, &scene, &options).unwrap();
        let mut renderer = Renderer::new(&gpu.0, &options, &uploaded).unwrap();
        for size in [[100, 150], [70, 64], [64, 193]] {
            check(&mut renderer, &view(size), &format!("{name} {size:?}"));
        }
    }
}

#[test]
fn bands_of_a_captured_scene_have_the_bits_of_the_whole_picture() {
    let gpu = Gpu::new();
    let scene = read_captured("biker.spz");
    let options = Options::BALANCED;
    let uploaded = GpuScene::new(&gpu.0, &scene, &options).unwrap();
    let mut renderer = Renderer::new(&gpu.0, &options, &uploaded).unwrap();
    for camera in crate::common::captured_cameras("biker.orbit.cameras.json", &[0, 10], [150, 200]) {
        check(&mut renderer, &camera, "biker");
    }
}

#[test]
fn bands_of_certificates_and_depths_have_the_bits_of_the_whole() {
    let gpu = Gpu::new();
    let scene = cactus(4000).unwrap().gaussians;
    let (options, camera) = (Options::BALANCED, view([90, 140]));
    let upload = Upload { is_certifiable: true, reserve_bytes: 1 << 20 };
    let uploaded = SceneSource::of(scene).upload_with(&gpu.0, &options, upload).unwrap();
    let mut certified = Renderer::certified(&gpu.0, &options, &uploaded).unwrap();
    check(&mut certified, &camera, "certified");
    let certificate = |renderer: &Renderer| renderer.certificate().unwrap().unwrap();
    certified.render(&camera, BACKGROUND).unwrap();
    let whole = certificate(&certified);
    assert!(whole.largest() > 0.0);
    assert!(bits(&whole) == bits(&in_bands(&mut certified, &camera, 32, certificate)));

    let mut depths = Renderer::new(&gpu.0, &options, &uploaded).unwrap();
    depths.set_inspection(Inspection::of_depths()).unwrap();
    check(&mut depths, &camera, "depths");
}

/// All lenses, and a pinhole along rays: colours, depths and certificates. The rays of a wide lens have
/// no planes in some bins, so that another path draws them, and all bands.
#[test]
fn bands_along_rays_have_the_bits_of_the_whole_picture() {
    let gpu = Gpu::new();
    let mut paths = BTreeSet::new();
    let mut cameras = all([48, 80]);
    cameras.push(("pinhole", view([48, 80]).along_rays()));
    cameras.push(("a whole sphere in a few pixels", sphere([12, 130])));
    for (i, (name, camera)) in cameras.into_iter().enumerate() {
        let scene = around(&mut Random(70 + i as u64), &camera, 500);
        for preset in ["balanced", "portable"] {
            let (name, options) = (format!("{name} {preset}"), Options::preset(preset).unwrap());
            let upload = Upload { is_certifiable: true, reserve_bytes: 1 << 20 };
            let source = SceneSource::of(scene.clone());
            let uploaded = source.upload_with(&gpu.0, &options, upload).unwrap();
            let mut renderer = Renderer::new(&gpu.0, &options, &uploaded).unwrap();
            check(&mut renderer, &camera, &name);
            paths.insert((preset, renderer.path().to_string()));
            renderer.set_inspection(Inspection::of_depths()).unwrap();
            check(&mut renderer, &camera, &format!("{name}, depths"));
            if preset == "balanced" {
                let mut certified = Renderer::certified(&gpu.0, &options, &uploaded).unwrap();
                check(&mut certified, &camera, &format!("{name}, certified"));
                let certificate = |renderer: &Renderer| renderer.certificate().unwrap().unwrap();
                certified.render(&camera, BACKGROUND).unwrap();
                let whole = certificate(&certified);
                assert!(bits(&whole) == bits(&in_bands(&mut certified, &camera, 64, certificate)), "{name}");
            }
        }
    }
    for path in [("portable", "rays"), ("balanced", "fast-rays"), ("balanced", "rays")] {
        assert!(paths.contains(&(path.0, path.1.to_owned())), "{paths:?}");
    }
}

/// A page file of a cactus, with or without levels.
fn pages(has_levels: bool) -> Arc<PageFile> {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("cactus.smalto");
    let settings = Settings { has_levels, ..Settings::default() };
    let job = Job::new(&output, settings, "test");
    write_whole(&job, &cactus(40_000).unwrap()).unwrap();
    Arc::new(PageFile::open(&output).unwrap())
}

#[test]
fn bands_of_pages_levels_and_slabs_have_the_bits_of_the_whole_picture() {
    let _turn = Gpu::new();
    let device = open(Validation::Required).with_small_limit(54 << 20).unwrap();
    let camera = view([120, 200]);
    let mut drawn_in_slabs = false;
    for has_levels in [false, true] {
        let file = pages(has_levels);
        let budget = Options { splats: 9000, ..Options::BALANCED };
        let cases = [("balanced", Options::BALANCED), ("portable", Options::preset("portable").unwrap())];
        for (name, options) in cases.into_iter().chain(has_levels.then_some(("budget", budget))) {
            let scene = SceneSource::of_file(file.clone());
            let scene = scene.upload_with(&device, &options, Upload::reserving(1 << 20)).unwrap();
            let mut renderer = Renderer::new(&device, &options, &scene).unwrap();
            check(&mut renderer, &camera, &format!("{name}, levels {has_levels}"));
            let frame = renderer.render(&camera, BACKGROUND).unwrap();
            drawn_in_slabs |= frame.parts.is_some();
        }
    }
    assert!(drawn_in_slabs);
    let options = Options::BALANCED;
    let scene = GpuScene::new(&device, &cactus(40_000).unwrap().gaussians, &options).unwrap();
    let mut renderer = Renderer::new(&device, &options, &scene).unwrap();
    check(&mut renderer, &camera, "whole scene, little memory");
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}

/// Renderers of one scene on this many instances of the device.
fn on_instances(devices: &[Device], options: &Options) -> SplitRenderer {
    let scene = cactus(6000).unwrap().gaussians;
    let renderer = |device| {
        let scene = GpuScene::new(device, &scene, options).unwrap();
        (device, Renderer::new(device, options, &scene).unwrap())
    };
    SplitRenderer::new(options, devices.iter().map(renderer).collect()).unwrap()
}

fn joined(frame: &mut SplitFrame) -> (Vec<u8>, Vec<[u32; 4]>) {
    let (mut integers, mut floats) = (Vec::new(), Vec::new());
    for band in &mut frame.bands {
        integers.extend_from_slice(band.host.integers(Integers::Rgb8).unwrap());
        floats.extend(bits(&band.host.picture().unwrap()));
    }
    (integers, floats)
}

#[test]
fn several_devices_draw_the_bits_of_one_and_go_on_without_a_lost_one() {
    let gpu = Gpu::own();
    let devices = [gpu.0.clone(), open(Validation::Required), open(Validation::Required)];
    let outputs =
        FrameOutputs { picture: vec![Form::Integers(Integers::Rgb8), Form::Floats], ..FrameOutputs::default() };
    let options = Options::BALANCED;
    let mut one = on_instances(&devices[..1], &options);
    let mut split = on_instances(&devices, &options);
    let cameras = [[100, 160], [60, 40], [33, 10]].map(view);
    let mut expected = Vec::new();
    for camera in &cameras {
        let mut frame = one.render(camera, BACKGROUND, &outputs).unwrap();
        expected.push(joined(&mut frame));
    }
    for (round, camera) in (0..9).flat_map(|round| cameras.iter().map(move |camera| (round, camera))) {
        let which = cameras.iter().position(|other| other == camera).unwrap();
        // In rounds 3 and 6 a device is lost in the middle of a frame.
        if which == 0 && (round == 3 || round == 6) {
            split.lose(split.devices() - 1);
        }
        let mut frame = split.render(camera, BACKGROUND, &outputs).unwrap();
        assert!(joined(&mut frame) == expected[which], "round {round}, view {which}: {:?}", frame.bands.len());
        split.recycle(frame);
        let lost = split.take_lost();
        assert_eq!(lost.len(), usize::from(which == 0 && (round == 3 || round == 6)));
    }
    assert_eq!(split.devices(), 1);
    split.lose(0);
    let Err(error) = split.render(&cameras[0], BACKGROUND, &outputs) else { panic!("no device is left") };
    assert!(error.to_string().contains("lost"), "{error:#}");
    for device in &devices {
        assert_eq!(device.validation_messages(), Vec::<String>::new());
    }
}

/// Bands of other devices are joined on the device of a renderer: the picture and what follows from it are those of
/// the renderer alone in 8 bits, over paths and sizes, and also when another device is lost in the middle of a frame.
#[test]
fn bands_of_other_devices_are_joined_to_the_picture_of_one() {
    let gpu = Gpu::own();
    let others = [open(Validation::Required), open(Validation::Required)];
    let scene = cactus(6000).unwrap().gaussians;
    for name in ["balanced", "portable", "exact"] {
        let options = Options::preset(name).unwrap();
        let renderer = |device| {
            let scene = GpuScene::new(device, &scene, &options).unwrap();
            Renderer::new(device, &options, &scene).unwrap()
        };
        let mut own = renderer(&gpu.0);
        let helping = others.iter().map(|device| (device, renderer(device))).collect();
        let mut helping = OtherDevices::new(&gpu.0, &options, helping).unwrap();
        if name == "portable" {
            helping.copy_bands();
        }
        let mut left = 3;
        for (round, size) in (0..4).flat_map(|round| [[100, 200], [64, 160], [40, 64]].map(|size| (round, size))) {
            let camera = view(size);
            let whole = own.render(&camera, BACKGROUND).unwrap();
            let expected = own.pixels().unwrap();
            helping.learn_alone(1e6);
            helping.always_draw_bands();
            assert!(helping.are_used(&camera) == (left > 1), "{name}, round {round}");
            let losses = usize::from(left > 1 && round > 0 && size[0] == 100);
            if losses > 0 {
                helping.lose(left - 2);
                left -= 1;
            }
            let mut cmd = Commands::new(&gpu.0).unwrap();
            let recorded = helping.record(&mut own, &mut cmd, &camera, BACKGROUND).unwrap();
            let results = cmd.submit().unwrap().wait().unwrap();
            let totals = own.judge(&results, &recorded).unwrap().expect("a joined picture is complete");
            assert!(own.pixels().unwrap().to_rgb8() == expected.to_rgb8(), "{name}, round {round}, {size:?}");
            assert!(totals.visible >= whole.totals.visible, "{name}: bands list what the picture lists");
            let bands = helping.last_bands().iter().map(|band| band.band.rows);
            let most = size[1].div_ceil(own.band_rows(&camera)).min(left as u32) as usize;
            assert_eq!(bands.clone().count(), if most > 1 { most } else { 0 }, "{name}, round {round}, {size:?}");
            assert!(most < 2 || bands.sum::<u32>() == size[1]);
            // A pixel is explained from the renderer's own lists, and the picture is there again.
            if round == 0 {
                let [x, y] = size.map(|side| side / 2);
                let explained = own.explain([x, y]).unwrap();
                own.render(&camera, BACKGROUND).unwrap();
                assert_eq!(format!("{explained:?}"), format!("{:?}", own.explain([x, y]).unwrap()));
                assert!(bits(&own.pixels().unwrap()) == bits(&expected));
            }
            let lost = helping.take_lost();
            assert_eq!(lost.len(), losses, "{name}, round {round}");
            assert!(lost.iter().all(|lost| lost.error.to_string().contains("lost")));
        }
        assert_eq!(left, 1);
    }
    for device in others.iter().chain([&gpu.0]) {
        assert_eq!(device.validation_messages(), Vec::<String>::new());
    }
}
