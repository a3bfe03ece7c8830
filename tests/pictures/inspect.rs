//! Looking inside the pipeline: what the pictures of attributes and of work show, against the f64 reference.

use crate::common::agree::{GREEN, RED, ahead, ball};
use crate::common::cloud::{camera, cloud};
use crate::common::free::build;
use crate::common::listed::Listed;
use crate::common::{Gpu, Random, captured_cameras, compare, gaussians, read_captured};
use glam::{DVec2, DVec3, dvec2};
use smalto::camera::Camera;
use smalto::gpu::Commands;
use smalto::options::{Options, Storage};
use smalto::packing::Statistics;
use smalto::pixels::Pixels;
use smalto::procedural::cactus;
use smalto::reference::{self, Tiling};
use smalto::render::{Attribute, GpuScene, Inspection, Look, Renderer, Work};
use smalto::rules::{Background, Rules};
use smalto::scene::{Gaussians, Raw};

const RULES: &Rules = &Rules::TRAINED;

pub(super) fn still_of(gpu: &Gpu, scene: &Gaussians, options: &Options) -> Renderer {
    let scene = GpuScene::new(&gpu.0, scene, options).unwrap();
    Renderer::new(&gpu.0, options, &scene).unwrap()
}

pub(super) fn look(look: Look) -> Inspection {
    Inspection { look, ..Inspection::default() }
}

/// A picture, and everything that its frame wrote.
pub(super) struct Picture {
    pub(super) pixels: Pixels,
    pub(super) buffers: Vec<(String, Vec<u8>)>,
    pub(super) visible: usize,
    pub(super) instances: usize,
}

pub(super) fn inspect(still: &mut Renderer, camera: &Camera, inspection: Inspection) -> Picture {
    still.set_inspection(inspection).unwrap();
    let (frame, results) = still.render_with(camera, Background::Colour([0.3; 3]), Commands::capture_scopes).unwrap();
    let buffers = results.captures().iter().map(|c| (c.buffer().to_owned(), c.bytes().to_vec())).collect();
    let totals = frame.totals;
    let (visible, instances) = (totals.visible_kept as usize, totals.listed_kept as usize);
    Picture { pixels: still.pixels().unwrap(), buffers, visible, instances }
}

impl Picture {
    fn words<T: bytemuck::Pod>(&self, name: &str) -> Vec<T> {
        let found = self.buffers.iter().rfind(|(n, _)| n == name);
        bytemuck::pod_collect_to_vec(&found.unwrap_or_else(|| panic!("no stage wrote {name}")).1)
    }

    fn gaussians(&self) -> Vec<u32> {
        self.words("gaussian from splat")[..self.visible].to_vec()
    }

    /// The frame's own lists, of splats in f64.
    fn listed(&self, scene: &Gaussians, camera: &Camera) -> Listed {
        let pairs = [("instance keys", "instance values"), ("instance keys 2", "instance values 2")];
        let is_sorted = |(keys, _): &&(&str, &str)| self.words::<u32>(keys)[..self.instances].is_sorted();
        let (_, values) = pairs.iter().find(is_sorted).expect("one pair is sorted");
        let splats = self.gaussians().iter().map(|id| reference::project(scene, *id, camera, RULES)).collect();
        let tiling = Tiling::of(camera.size_px);
        let ranges = self.words("ranges")[..tiling.tiles()].to_vec();
        Listed { gaussians: self.gaussians(), splats, ranges, ids: self.words(values), tiling }
    }
}

pub(super) type Case = (Gaussians, Camera);

/// A random scene and a procedural one, each with a view.
pub(super) fn cases() -> [Case; 2] {
    let from = DVec3::new(1.5, -2.5, -4.0);
    let beside = Camera::looking_at(from, DVec3::new(0.0, -1.2, 0.0), [100, 70], 0.9);
    [(build(&cloud(&mut Random(5), 400, 2, 0.3), 2), camera()), (cactus(8000).unwrap().gaussians, beside)]
}

pub(super) fn captured_case() -> [Case; 1] {
    let mut cameras = captured_cameras("biker.orbit.cameras.json", &[10], [120, 80]);
    [(read_captured("biker.spz"), cameras.remove(0))]
}

#[test]
fn inspect_counts_the_work_of_a_pixel() {
    check_counts_of_pixels(&cases(), [false, true]);
}

#[test]
#[ignore = "needs the captured scenes (SMALTO_TEST_SCENES)"]
fn inspect_counts_the_work_of_a_pixel_in_a_captured_scene() {
    check_counts_of_pixels(&captured_case(), [false]);
}

fn check_counts_of_pixels<const N: usize>(cases: &[Case; N], portable: [bool; N]) {
    let gpu = Gpu::new();
    let mut stopped = 0;
    for ((scene, camera), portable) in cases.iter().zip(portable) {
        let options = Options { portable, ..Options::EXACT };
        let mut still = still_of(&gpu, scene, &options);
        let [load, evaluations, contributions] = [Work::TileLoad, Work::Evaluations, Work::Contributions]
            .map(|work| inspect(&mut still, camera, look(Look::Work(work))));
        let own = evaluations.listed(scene, camera);
        let (own_pixels, exact) = (own.blend(), Listed::of(scene, camera));
        let (exact_pixels, mut compared) = (exact.blend(), 0);
        for pixel in 0..own_pixels.len() {
            for picture in [&load, &evaluations, &contributions] {
                let [r, g, b, a] = picture.pixels.rgba[pixel];
                assert!(r == g && g == b && a == 1.0, "a number in all channels");
            }
            let at = |picture: &Picture| picture.pixels.rgba[pixel][0] as usize;
            assert_eq!(at(&load), own.list(pixel).0.len(), "pixel {pixel}");
            if own_pixels[pixel].doubt + exact_pixels[pixel].doubt > 0.0 {
                continue;
            }
            assert_eq!(at(&evaluations), own.walk(pixel).evaluations, "pixel {pixel}");
            assert_eq!(at(&contributions), exact.walk(pixel).blended.len(), "pixel {pixel}");
            compared += 1;
            stopped += usize::from(own.walk(pixel).is_stopped);
        }
        assert!(compared > own_pixels.len() * 9 / 10, "{compared} of {} compared", own_pixels.len());
    }
    assert!(stopped > 100, "{stopped} pixels stopped");
}

/// The lists may hold what touches a tile within rounding, and lack what lies between its pixel centres.
#[test]
fn tile_load_is_the_length_of_the_reference_list() {
    check_tile_load(&cases());
}

#[test]
#[ignore = "needs the captured scenes (SMALTO_TEST_SCENES)"]
fn tile_load_is_the_length_of_the_reference_list_in_a_captured_scene() {
    check_tile_load(&captured_case());
}

fn check_tile_load(cases: &[Case]) {
    let gpu = Gpu::new();
    for (scene, camera) in cases {
        let mut still = still_of(&gpu, scene, &Options::EXACT);
        let load = inspect(&mut still, camera, look(Look::Work(Work::TileLoad))).pixels;
        let exact = Listed::of(scene, camera);
        for (pixel, loaded) in load.rgba.iter().map(|p| p[0] as usize).enumerate() {
            let expected = exact.list(pixel).0.len();
            assert!(loaded.abs_diff(expected) <= 2 + expected / 20, "pixel {pixel}: {loaded} for {expected}");
        }
    }
}

/// More entries in one tile than llvmpipe lets a loop run.
#[test]
fn a_list_longer_than_65535_is_counted_completely() {
    let entry = |i: u32| {
        let z = 5.0 + 1e-5 * f64::from(i);
        if i % 400 == 399 {
            (ball([0.1, 0.1, z], 0.2, 0.02), GREEN)
        } else {
            (ball([-0.35, -0.35, z], 0.002, 0.5), RED)
        }
    };
    let mut raws: Vec<_> = (0..70_000).map(entry).collect();
    // The only mean near its pixel, after all others.
    raws.push((ball([0.21, -0.19, 8.0], 0.2, 0.95), GREEN));
    let (scene, camera) = (gaussians(&raws), ahead([16, 16], 100.0));
    let gpu = Gpu::new();
    let mut still = still_of(&gpu, &scene, &Options::EXACT);
    let [evaluations, contributions, centres] = [Work::Evaluations, Work::Contributions, Work::Centres]
        .map(|work| inspect(&mut still, &camera, look(Look::Work(work))));
    let lists = evaluations.listed(&scene, &camera);
    assert!(lists.list(0).0.len() > 65_535);
    for (pixel, exact) in lists.blend().iter().enumerate().filter(|(_, exact)| exact.doubt == 0.0) {
        let (walked, at) = (lists.walk(pixel), |picture: &Picture| picture.pixels.rgba[pixel][0] as usize);
        let counted = (at(&evaluations), at(&contributions));
        assert_eq!(counted, (walked.evaluations, walked.blended.len()), "pixel {pixel}: {exact:?}");
    }
    let last = reference::project(&scene, 70_000, &camera, RULES).mean_px;
    assert_eq!(centres.pixels.at(last.x as u32, last.y as u32), [0.0, 1.0, 0.0, 1.0]);
}

#[test]
fn an_isolated_gaussian_is_drawn_as_if_it_were_alone() {
    let gpu = Gpu::new();
    let all = cloud(&mut Random(8), 2500, 2, 0.3);
    let (scene, camera) = (build(&all, 2), camera());
    // What is looked at is drawn on the portable path.
    let options = Options { shape_storage: Storage::F32, sh_storage: Storage::F32, portable: true, ..Options::EXACT };
    let mut still = still_of(&gpu, &scene, &options);
    let visible = reference::cull(&scene, &camera, RULES);
    let hidden = (0..2500).find(|id| visible.binary_search(id).is_err()).unwrap();
    for id in visible.into_iter().step_by(311).chain([hidden, 1023, 1024, 2499, 2500]) {
        let isolated = Inspection { isolated: Some(id), ..Inspection::default() };
        let picture = inspect(&mut still, &camera, isolated.clone());
        let alone = build(all.get(id as usize..id as usize + 1).unwrap_or(&[]), 2);
        let mut ordinary = still_of(&gpu, &alone, &options);
        ordinary.render(&camera, Background::Colour([0.3; 3])).unwrap();
        assert!(picture.pixels == ordinary.pixels().unwrap(), "{id}");
        let expected = reference::render(&alone, &camera, RULES, Background::Colour([0.3; 3]));
        assert_eq!(compare(&picture.pixels, &expected).unexplained, 0, "{id}");
        let load = Inspection { look: Look::Work(Work::TileLoad), ..isolated };
        let load = inspect(&mut still, &camera, load).pixels;
        assert!(load.rgba.iter().all(|p| p[0] <= 1.0), "its tiles list nothing else");
    }
}

#[test]
fn culling_can_be_frozen_from_another_view() {
    check_frozen_culling(&cases());
}

#[test]
#[ignore = "needs the captured scenes (SMALTO_TEST_SCENES)"]
fn culling_can_be_frozen_from_another_view_in_a_captured_scene() {
    check_frozen_culling(&captured_case());
}

/// Looks from the side, from the middle and from the far end of what is drawn: much of it lies behind the camera.
fn check_frozen_culling(cases: &[Case]) {
    let gpu = Gpu::new();
    for (scene, from) in cases {
        let mut still = still_of(&gpu, scene, &Options { portable: true, ..Options::EXACT });
        let frozen = inspect(&mut still, from, Inspection::default()).gaussians();
        let keep = |ids: &[u32]| {
            let all = crate::common::free::free(scene);
            build(&ids.iter().map(|id| all[*id as usize].clone()).collect::<Vec<_>>(), scene.sh_degree())
        };
        let kept = keep(&frozen);
        let middle = kept.means().iter().fold(DVec3::ZERO, |sum, m| sum + DVec3::from(m.map(f64::from)));
        let middle = middle / kept.len() as f64;
        let away = middle - from.position;
        let mut was_behind = 0;
        for to in [DVec3::new(away.z, away.y, -away.x), away, -away, DVec3::new(0.3, 2.0, -0.1)] {
            for position in [middle, middle - to, from.position + 0.2 * to] {
                let camera = Camera::looking_at(position, position + to, [112, 72], 1.1);
                let inspection = Inspection { culled_from: Some(from.clone()), ..Inspection::default() };
                let picture = inspect(&mut still, &camera, inspection);
                assert!(picture.gaussians().iter().all(|id| frozen.binary_search(id).is_ok()));
                let expected = reference::render(&kept, &camera, RULES, Background::Colour([0.3; 3]));
                let comparison = compare(&picture.pixels, &expected);
                assert_eq!(comparison.unexplained, 0, "{to} from {position}: {comparison:?}");
                let is_behind = |mean: &&[f32; 3]| camera.view(DVec3::from(mean.map(f64::from))).z < 0.2;
                was_behind += kept.means().iter().filter(is_behind).count();
            }
        }
        assert!(was_behind > kept.len(), "the camera leaves Gaussians behind");
    }
}

#[test]
fn scaled_pictures_are_inspected_at_the_size_they_are_drawn() {
    let gpu = Gpu::new();
    let (scene, camera) = (build(&cloud(&mut Random(5), 400, 2, 0.3), 2), camera());
    let [mut small, mut drawn] = [0.5, 1.0].map(|scale| still_of(&gpu, &scene, &Options { scale, ..Options::EXACT }));
    let half = camera.sampled(camera.size_px.map(|side| side / 2));
    for shown in [Look::Attribute(Attribute::Depth), Look::Work(Work::Evaluations), Look::Work(Work::Outlines)] {
        let picture = inspect(&mut small, &camera, look(shown)).pixels;
        let whole = inspect(&mut drawn, &half, look(shown)).pixels;
        assert_eq!(picture.size, camera.size_px);
        // A quarter of a pixel off its centre, a value is 9/16 of the drawn one and the rest of three neighbours.
        let weights = [(0, 0, 9.0), (1, 0, 3.0), (0, 1, 3.0), (1, 1, 1.0)];
        for (x, y) in (1..half.size_px[0] - 1).zip(1..half.size_px[1] - 1) {
            let sum = weights.map(|(i, j, weight)| weight / 16.0 * whole.at(x + i, y + j)[0]).iter().sum::<f32>();
            let found = picture.at(2 * x + 1, 2 * y + 1)[0];
            assert!((found - sum).abs() <= 1e-5 * sum.max(1.0), "{shown:?} at {x} {y}: {found} for {sum}");
        }
        for pixel in [[31, 20], [40, 41], [95, 63]] {
            assert_eq!(small.explain(pixel).unwrap(), drawn.explain(pixel.map(|p| p / 2)).unwrap());
        }
    }
}

/// Across tiles, turned and long.
#[test]
fn outlines_lie_on_the_ellipse_and_centres_at_the_mean() {
    let raw = Raw {
        mean: [0.13, -0.07, 5.0],
        log_scale: [0.45_f64.ln(), 0.2_f64.ln(), -4.0],
        rotation: [0.9, 0.1, -0.2, 0.35],
        opacity_logit: 2.0,
    };
    let (scene, camera) = (gaussians(&[(raw, [0.2, 0.6, 0.4])]), ahead([100, 90], 90.0));
    let mut still = still_of(&Gpu::new(), &scene, &Options::EXACT);
    let [outlines, centres] =
        [Work::Outlines, Work::Centres].map(|work| inspect(&mut still, &camera, look(Look::Work(work))).pixels);
    let splat = reference::project(&scene, 0, &camera, RULES);
    // The ellipse, as points: the mean plus a root of the covariance times the unit circle.
    let root = {
        let [a, b, c] = [splat.covariance.x_axis.x, splat.covariance.x_axis.y, splat.covariance.y_axis.y];
        glam::DMat2::from_cols(dvec2(a.sqrt(), b / a.sqrt()), dvec2(0.0, (c - b * b / a).sqrt()))
    };
    let point = |i: u32| {
        let angle = f64::from(i) / 5000.0 * std::f64::consts::TAU;
        splat.mean_px + splat.level(RULES).sqrt() * (root * dvec2(angle.cos(), angle.sin()))
    };
    let ellipse: Vec<DVec2> = (0..5000).map(point).collect();
    let mut on = 0;
    for (x, y) in (0..90).flat_map(|y| (0..100).map(move |x| (x, y))) {
        let centre = dvec2(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let away = ellipse.iter().map(|p| p.distance(centre)).fold(f64::MAX, f64::min);
        let is_inside = splat.distance(centre) <= splat.level(RULES);
        match outlines.at(x, y) {
            [0.0, 0.0, 0.0, 0.0] => assert!(!is_inside || away > 0.9, "{x} {y} is dark, {away} px within"),
            [r, g, b, a] => {
                on += 1;
                assert!(is_inside && away < 1.01, "{x} {y} is bright, {away} px away");
                assert!([r - 0.1, g - 0.3, b - 0.2, a - 0.5].iter().all(|e| e.abs() < 1e-6), "half of its colour");
            }
        }
        let is_centre = splat.mean_px.distance(centre);
        if (is_centre - 1.5).abs() > 1e-4 {
            assert_eq!(centres.at(x, y)[3], f32::from(u8::from(is_centre < 1.5)), "{x} {y}");
        }
    }
    assert!(on > 50, "{on} pixels of outline");
    let [r, g, b, _] = centres.at(splat.mean_px.x as u32, splat.mean_px.y as u32);
    assert!((r - 0.2).abs() + (g - 0.6).abs() + (b - 0.4).abs() < 1e-5);
}

#[test]
fn without_inspection_the_frame_is_unchanged() {
    let gpu = Gpu::new();
    let (scene, camera) = (build(&cloud(&mut Random(5), 400, 2, 0.3), 2), camera());
    let options = Options { portable: true, ..Options::EXACT };
    let mut still = still_of(&gpu, &scene, &options);
    let mut frame = |inspection: Inspection| {
        still.set_inspection(inspection).unwrap();
        let (frame, results) = still.render_with(&camera, Background::BLACK, |_| {}).unwrap();
        let names: Vec<_> = frame.timings.iter().map(|t| t.name).collect();
        (still.pixels().unwrap(), names, results.barriers())
    };
    let ordinary = frame(Inspection::default());
    assert!(ordinary.0 == gpu.render(&scene, &camera, &options));
    let depth = frame(look(Look::Attribute(Attribute::Depth)));
    assert!(depth.1.contains(&"shade attribute") && depth.1.contains(&"blend") && depth.0 != ordinary.0);
    let work = frame(look(Look::Work(Work::TileLoad)));
    assert!(work.1.contains(&"inspect") && !work.1.contains(&"blend") && work.0 != ordinary.0);
    assert_eq!([&depth, &work].map(|frame| frame.2), [ordinary.2; 2], "nothing but what is asked for is recorded");
    let isolated = frame(Inspection { isolated: Some(7), ..Inspection::default() });
    assert_eq!((&isolated.1, isolated.2), (&ordinary.1, ordinary.2 + 1));
    let again = frame(Inspection::default());
    assert!(again == ordinary);
}

#[test]
fn a_certified_picture_is_not_inspected() {
    let gpu = Gpu::new();
    let scene = gaussians(&[(ball([0.0, 0.0, 5.0], 0.2, 0.5), RED)]);
    let certifiable = GpuScene::certifiable(&gpu.0, &scene, &Statistics::of(&scene), &Options::EXACT).unwrap();
    let mut still = Renderer::certified(&gpu.0, &Options::EXACT, &certifiable).unwrap();
    still.set_inspection(Inspection::default()).unwrap();
    assert!(still.set_inspection(look(Look::Work(Work::Centres))).is_err());
}
