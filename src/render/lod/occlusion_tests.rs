//! Occlusion on a scene behind a wall: stop depths, cuts, and what frames depend on.

use std::sync::{Arc, LazyLock};

use glam::DVec3;

use super::fixtures::{differing, open, psnr, with_levels};
use super::target::LodReport;
use crate::camera::Camera;
use crate::gpu::{Commands, Device};
use crate::options::Options;
use crate::pagefile::PageFile;
use crate::pagefile::write::Settings;
use crate::pixels::Pixels;
use crate::render::renderer::Renderer;
use crate::render::scene::{SceneSource, Upload};
use crate::render::shaders::fast::{BIN_COLUMNS, BIN_ROWS, BLOCK_WIDTH, BLOCKS};
use crate::rules::Background;
use crate::scene::{Gaussians, Random, Scene, sh_coefficients};

const SIZE: [u32; 2] = [320, 200];
const BACKGROUND: Background = Background::Colour([0.1, 0.2, 0.3]);
/// Stops early, so that the splat at which a pixel stops is drawn.
const OPTIONS: Options = Options { stop: 1e-3, lod_error: 20.0, lod_occlusion: 6.0, ..Options::EXACT };

/// A wall over more than the right half of the picture, and Gaussians of all colours: two thirds of them behind it.
fn behind_a_wall() -> Gaussians {
    let mut random = Random::of(7);
    let mut gaussians = Gaussians::default();
    let mut add = |mean: [f32; 3], scale: f32, opacity: f32, random: &mut Random| {
        gaussians.means.push(mean);
        gaussians.scales.push([scale; 3]);
        gaussians.rotations.push([1.0, 0.0, 0.0, 0.0]);
        gaussians.opacities.push(opacity);
        gaussians.sh.extend([(); sh_coefficients(0)].map(|()| [(); 3].map(|()| random.normal() as f32)));
    };
    for place in 0..88 * 56 {
        let [column, row] = [place % 88, place / 88].map(|number| 0.1 * number as f32);
        add([column - 1.6, row - 2.8, 4.0], 0.14, 0.85, &mut random);
    }
    for place in 0..36_000 {
        let [x, y, z] = [(); 3].map(|()| random.unit() as f32);
        let x = if place % 3 == 0 { -8.0 * x } else { 0.5 + 7.5 * x };
        add([x, 10.0 * y - 5.0, 8.0 + 6.0 * z], 0.03, 0.8, &mut random);
    }
    gaussians
}

static SCENE: LazyLock<(Gaussians, Arc<PageFile>)> = LazyLock::new(|| {
    let gaussians = behind_a_wall();
    let scene = Scene { gaussians: gaussians.clone(), ..Scene::empty("test") };
    (gaussians, with_levels(scene, Settings::LOSSLESS))
});

/// A camera this far to the left of the first, which has half of the scene behind the wall.
fn camera(left: f64) -> Camera {
    Camera::looking_at(DVec3::new(-left, 0.0, 0.0), DVec3::new(-left, 0.0, 1.0), SIZE, 2.0)
}

fn renderer(device: &Device, options: &Options) -> Renderer {
    let source = SceneSource::of_file(SCENE.1.clone());
    let scene = source.upload_with(device, options, Upload::reserving(1 << 20)).unwrap();
    Renderer::new(device, options, &scene).unwrap()
}

fn draw(renderer: &mut Renderer, camera: &Camera) -> (Pixels, LodReport) {
    let frame = renderer.render(camera, BACKGROUND).unwrap();
    (renderer.pixels().unwrap(), frame.detail.unwrap())
}

/// The stop depths of blocks and bins that a renderer knows.
fn stop_depths(device: &Device, renderer: &mut Renderer) -> Vec<f32> {
    let mut cmd = Commands::new(device).unwrap();
    let depths = cmd.read(&renderer.choice().occlusion().unwrap().depths).unwrap();
    cmd.submit().unwrap().wait().unwrap().view(&depths).to_vec()
}

/// Without the Gaussians behind a depth, exactly those blocks change whose stop depth is behind it.
#[test]
fn blocks_stop_at_their_stop_depths() {
    let (device, camera) = (open(None), camera(0.0));
    // All Gaussians are drawn.
    let options = Options { lod_error: 1e-12, ..OPTIONS };
    let plain = Options { lod_error: 0.0, lod_occlusion: 0.0, ..options };
    let without_behind = |depth: f32, form: Option<usize>| {
        let gaussians = &SCENE.0;
        let kept: Vec<u32> =
            (0..gaussians.len() as u32).filter(|i| gaussians.means()[*i as usize][2] <= depth).collect();
        let source = SceneSource::of(gaussians.selected(&kept).unwrap());
        let scene = source.upload_with(&device, &plain, Upload::default()).unwrap();
        let mut renderer = Renderer::new(&device, &plain, &scene).unwrap();
        renderer.choice().force_block_form(form);
        renderer.render(&camera, BACKGROUND).unwrap();
        renderer.pixels().unwrap()
    };
    for (form, key_bits) in [(None, 32), (Some(2), 32), (Some(3), 32), (None, 20)] {
        let mut renderer = renderer(&device, &Options { key_bits, ..options });
        renderer.choice().force_block_form(form);
        let expected = draw(&mut renderer, &camera).0;
        let depths = stop_depths(&device, &mut renderer);
        let grid = renderer.choice().fast().unwrap().grid(SIZE, SCENE.0.len());
        let (columns, height, bins) = (grid.bins[0], grid.block_height, grid.count());
        let corner = |place: u32| {
            let (bin, block) = (place / BLOCKS, place % BLOCKS);
            let x = bin % columns * BIN_COLUMNS + block % BIN_COLUMNS;
            [x * BLOCK_WIDTH, (bin / columns * BIN_ROWS + block / BIN_COLUMNS) * height]
        };
        let is_inside = |[x, y]: [u32; 2]| x < SIZE[0] && y < SIZE[1];
        let blocks: Vec<([u32; 2], f32)> = (0..bins * BLOCKS)
            .map(|place| (corner(place), depths[place as usize]))
            .filter(|(corner, _)| is_inside(*corner))
            .collect();
        let mut stopped: Vec<f32> = blocks.iter().map(|(_, depth)| *depth).filter(|depth| depth.is_finite()).collect();
        assert!(stopped.len() > blocks.len() / 4 && stopped.len() < blocks.len(), "{} blocks stop", stopped.len());
        stopped.sort_unstable_by(f32::total_cmp);
        // The camera's axes are rounded.
        let slack = if key_bits == 32 { 1e-6 } else { 1e-3 };
        for depth in stopped.iter().step_by(stopped.len() / 12) {
            let pixels = without_behind(depth * (1.0 + slack), form);
            for ([left, top], stop) in &blocks {
                let is_changed = (*top..(top + height).min(SIZE[1])).any(|y| {
                    let row = |x: u32| (y * SIZE[0] + x) as usize;
                    let range = row(*left)..row((left + BLOCK_WIDTH).min(SIZE[0]));
                    let bits = |pixels: &Pixels| -> Vec<[u32; 4]> {
                        pixels.rgba[range.clone()].iter().map(|pixel| pixel.map(f32::to_bits)).collect()
                    };
                    bits(&pixels) != bits(&expected)
                });
                // A short key stands for several depths.
                let must_change = stop.is_finite() && *stop > depth * (1.0 + 2.0 * slack) && key_bits == 32;
                let is_expected = if is_changed { stop > depth } else { !must_change };
                assert!(is_expected, "{left}, {top}, {form:?}: stops at {stop}, drawn up to {depth}");
            }
        }
        for bin in 0..bins {
            let blocks = (bin * BLOCKS..(bin + 1) * BLOCKS).filter(|place| is_inside(corner(*place)));
            let farthest = blocks.map(|place| depths[place as usize]).fold(0.0, f32::max);
            assert_eq!(depths[(bins * BLOCKS + bin) as usize], farthest);
        }
    }
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}

#[test]
fn hidden_nodes_are_coarser_and_the_picture_hardly_changes() {
    let (device, camera) = (open(None), camera(0.0));
    let (plain, all) = draw(&mut renderer(&device, &Options { lod_occlusion: 0.0, ..OPTIONS }), &camera);
    let (coarser, fewer) = draw(&mut renderer(&device, &OPTIONS), &camera);
    assert!(fewer.nodes < 0.75 * all.nodes, "{} of {} nodes", fewer.nodes, all.nodes);
    assert!(psnr(&coarser, &plain) > 60.0, "{} dB", psnr(&coarser, &plain));
    // A budget goes to what is seen.
    let options = Options { lod_error: 0.0, splats: 20_000, ..OPTIONS };
    let exact = draw(&mut renderer(&device, &OPTIONS.finest()), &camera).0;
    let shown = |options: &Options| psnr(&draw(&mut renderer(&device, options), &camera).0, &exact);
    let (with, without) = (shown(&options), shown(&Options { lod_occlusion: 0.0, ..options }));
    assert!(with > without + 1.0, "{with} and {without} dB");
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}

#[test]
fn pictures_depend_on_their_view_alone() {
    let device = open(None);
    let options = Options { lod_error: 0.0, splats: 20_000, ..OPTIONS };
    let mut one = renderer(&device, &options);
    let [first, other, again] = [0.0, 2.0, 0.0].map(|left| draw(&mut one, &camera(left)));
    assert_eq!((differing(&again.0, &first.0), again.1), (0, first.1));
    assert!(differing(&other.0, &first.0) > 1000);
    for limit in [80 << 20, 60 << 20, 50 << 20] {
        let device = open(Some(limit));
        let mut limited = renderer(&device, &options);
        for (left, expected) in [(2.0, &other), (0.0, &first)] {
            let found = draw(&mut limited, &camera(left));
            assert_eq!((differing(&found.0, &expected.0), found.1), (0, expected.1), "{limit} bytes, {left}");
        }
        assert_eq!(device.validation_messages(), Vec::<String>::new());
    }
    // In slabs.
    let grid = one.choice().fast().unwrap().grid(SIZE, SCENE.0.len());
    // Of the blocks that lie in the picture as a whole, and of bins.
    let whole = (SIZE[1] / grid.bin_px()[1] * grid.bins[0] * BLOCKS) as usize;
    let of_picture = |depths: Vec<f32>| {
        let (blocks, bins) = depths.split_at((grid.count() * BLOCKS) as usize);
        [&blocks[..whole], bins].concat()
    };
    let expected = of_picture(stop_depths(&device, &mut one));
    let mut in_slabs = renderer(&device, &options);
    in_slabs.choice().force_slabs();
    assert_eq!(differing(&draw(&mut in_slabs, &camera(0.0)).0, &first.0), 0);
    assert!(of_picture(stop_depths(&device, &mut in_slabs)) == expected);
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}

/// A streamed frame takes what the frame before it hid: the second at rest is that of a frame that waits. What comes
/// out from behind the wall is coarse in one frame, if its pages are resident, and has no hole.
#[test]
fn streamed_frames_follow_within_a_frame() {
    let device = open(None);
    let waiting = [0.0, 2.5].map(|left| draw(&mut renderer(&device, &OPTIONS), &camera(left)));
    let mut streamed = renderer(&device, &OPTIONS);
    streamed.enable_page_streaming().unwrap();
    let mut settle = |left: f64| {
        loop {
            streamed.render(&camera(left), BACKGROUND).unwrap();
            streamed.streamer().wait_for_loads();
            if !streamed.has_news() {
                return streamed.pixels().unwrap();
            }
        }
    };
    // The pages of both views are resident.
    settle(2.5);
    let pixels = settle(0.0);
    assert_eq!(differing(&pixels, &waiting[0].0), 0, "at rest");
    let moved = draw(&mut streamed, &camera(2.5));
    assert!(streamed.has_news() && streamed.residency().unwrap().is_pending, "what came out is coarse");
    let next = draw(&mut streamed, &camera(2.5));
    assert!(!streamed.has_news(), "the second frame at rest is the last");
    let last = draw(&mut streamed, &camera(2.5));
    let seen = [&moved, &next].map(|frame| psnr(&frame.0, &waiting[1].0));
    assert!(moved.1.nodes < next.1.nodes && seen[0] > 20.0 && seen[1] > 60.0, "{seen:?}");
    assert_eq!(differing(&next.0, &last.0), 0, "{seen:?}");
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}

#[test]
fn a_measurement_knows_what_is_hidden() {
    let (device, camera) = (open(None), camera(0.0));
    let options = Options { lod_error: 0.0, splats: 12_000, ..OPTIONS };
    let mut one = renderer(&device, &options);
    let exact = draw(&mut renderer(&device, &options.finest()), &camera).0;
    let sampled = one.sample_psnr(&camera, BACKGROUND, u32::MAX).unwrap();
    let measured = psnr(&draw(&mut one, &camera).0, &exact);
    assert!((sampled.psnr() - measured).abs() < 0.01, "{} and {measured} dB", sampled.psnr());
    let mut unknowing = renderer(&device, &Options { lod_occlusion: 0.0, ..options });
    let other = unknowing.sample_psnr(&camera, BACKGROUND, u32::MAX).unwrap().psnr();
    assert!((other - measured).abs() > 0.2, "{other} and {measured} dB");
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}

/// The limit that is searched keeps the PSNR of the picture in which hidden groups are coarser.
#[test]
fn a_psnr_is_kept_where_much_is_hidden() {
    const WANTED: f64 = 42.0;
    let (device, camera) = (open(None), camera(0.0));
    let options = Options { stop: 0.03, lod_error: 0.0, lod_psnr: WANTED as f32, ..OPTIONS };
    let exact = draw(&mut renderer(&device, &options.finest()), &camera).0;
    let mut one = renderer(&device, &options);
    let (picture, report) = draw(&mut one, &camera);
    let measured = psnr(&picture, &exact);
    assert!(measured >= WANTED, "{measured} dB");
    assert!((report.measured_psnr.unwrap() - measured).abs() < 1e-3, "{report:?}, {measured}");
    let all = draw(&mut renderer(&device, &Options { lod_occlusion: 0.0, ..options }), &camera).1;
    assert!(report.nodes < 0.9 * all.nodes && report.lod_error <= all.lod_error, "{report:?}, {all:?}");
    // Neither other views before, a known limit, nor little memory changes the picture.
    let other = Camera { position: DVec3::new(-2.0, 0.0, 0.0), ..camera.clone() };
    let small = open(Some(60 << 20));
    for mut other_first in [renderer(&device, &options), renderer(&small, &options), one] {
        draw(&mut other_first, &other);
        for _ in 0..2 {
            let again = draw(&mut other_first, &camera);
            assert_eq!((differing(&again.0, &picture), again.1), (0, report));
        }
    }
    for device in [device, small] {
        assert_eq!(device.validation_messages(), Vec::<String>::new());
    }
}
