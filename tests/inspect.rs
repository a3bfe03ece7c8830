//! Looking inside the pipeline: what the pictures of attributes and of work show, against the f64 reference.

mod common;

use common::agree::{GREEN, RED, ahead, ball};
use common::cloud::{camera, cloud};
use common::free::build;
use common::{Gpu, ROUNDING, Random, captured_cameras, compare, gaussians, read_captured};
use glam::{DMat3, DQuat, DVec2, DVec3, dvec2};
use smalto::camera::Camera;
use smalto::gpu::Commands;
use smalto::options::{Background, Options, Rules, Storage, TILE};
use smalto::pixels::Pixels;
use smalto::reference::{self, Lists, Splat, Tiling};
use smalto::render::{Attribute, Explanation, GpuScene, Inspection, Look, Still, Work};
use smalto::scene::{Gaussians, Raw, Requirements, harmonics, synthetic};

const RULES: &Rules = &Rules::TRAINED;

fn still(gpu: &Gpu, scene: &Gaussians, options: &Options) -> Still {
    let scene = GpuScene::new(&gpu.0, scene, options).unwrap();
    Still::new(&gpu.0, options, &scene).unwrap()
}

fn look(look: Look) -> Inspection {
    Inspection { look, ..Inspection::default() }
}

/// A picture, and everything that its frame wrote.
struct Picture {
    pixels: Pixels,
    buffers: Vec<(String, Vec<u8>)>,
    visible: usize,
    instances: usize,
}

fn inspect(gpu: &Gpu, scene: &Gaussians, camera: &Camera, options: &Options, inspection: Inspection) -> Picture {
    let mut still = still(gpu, scene, options);
    still.set_inspection(inspection).unwrap();
    let (frame, results) = still.render_with(camera, Background::Colour([0.3; 3]), Commands::capture_scopes).unwrap();
    let buffers = results.captures().iter().map(|c| (c.buffer().to_owned(), c.bytes().to_vec())).collect();
    let totals = frame.totals;
    let (visible, instances) = (totals.visible_kept as usize, totals.instances_kept as usize);
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

/// Splats and their lists.
struct Listed {
    gaussians: Vec<u32>,
    splats: Vec<Splat>,
    ranges: Vec<[u32; 2]>,
    ids: Vec<u32>,
    tiling: Tiling,
}

/// What a pixel's list comes to in f64.
#[derive(Default)]
struct Walked {
    evaluations: usize,
    /// Splats that were blended.
    blended: Vec<u32>,
    is_stopped: bool,
}

impl Listed {
    /// The reference's.
    fn of(scene: &Gaussians, camera: &Camera, rules: &Rules) -> Self {
        let gaussians = reference::cull(scene, camera, rules);
        let splats: Vec<Splat> = gaussians.iter().map(|id| reference::project(scene, *id, camera, rules)).collect();
        let mut order: Vec<u32> = (0..splats.len() as u32).collect();
        order.sort_by(|a, b| (splats[*a as usize].depth as f32).total_cmp(&(splats[*b as usize].depth as f32)));
        let tiling = Tiling::of(camera.size_px);
        let (keys, ids) = reference::duplicate(&splats, &order, tiling, rules);
        let (keys, ids) = reference::sort(&keys, &ids, 0..tiling.key_bits());
        Self { gaussians, splats, ranges: reference::ranges(&keys, tiling.tiles()), ids, tiling }
    }

    fn list(&self, pixel: usize) -> (&[u32], DVec2) {
        let (x, y) = (pixel as u32 % self.tiling.size_px[0], pixel as u32 / self.tiling.size_px[0]);
        let [begin, end] = self.ranges[(y / TILE * self.tiling.counts[0] + x / TILE) as usize];
        (&self.ids[begin as usize..end as usize], dvec2(f64::from(x) + 0.5, f64::from(y) + 0.5))
    }

    fn walk(&self, pixel: usize) -> Walked {
        let (list, centre) = self.list(pixel);
        let (mut walked, mut transmittance) = (Walked::default(), 1.0);
        for id in list {
            walked.evaluations += 1;
            let splat = &self.splats[*id as usize];
            if splat.distance(centre) > splat.level(RULES) {
                continue;
            }
            let alpha = (splat.opacity * (-0.5 * splat.distance(centre)).exp()).min(RULES.alpha_max.into());
            if transmittance * (1.0 - alpha) < f64::from(RULES.transmittance_min) {
                walked.is_stopped = true;
                break;
            }
            transmittance *= 1.0 - alpha;
            walked.blended.push(*id);
        }
        walked
    }

    /// Blended over black, and with which pixels are in doubt.
    fn blend(&self) -> Vec<reference::Pixel> {
        let lists = Lists { splats: &self.splats, ranges: &self.ranges, splat_ids: &self.ids, rays: None };
        reference::blend(&lists, self.tiling, DVec3::ZERO, RULES)
    }
}

/// Scenes and views: random, procedural, and captured where there is one.
fn cases() -> Vec<(Gaussians, Camera)> {
    let from = DVec3::new(1.5, -2.5, -4.0);
    let mut cases = vec![
        (build(&cloud(&mut Random(5), 400, 2, 0.3), 2), camera()),
        (
            synthetic::cactus(8000).unwrap().gaussians,
            Camera::looking_at(from, DVec3::new(0.0, -1.2, 0.0), [100, 70], 0.9),
        ),
    ];
    if let Some(biker) = read_captured("biker.spz") {
        let cameras = captured_cameras("biker.orbit.cameras.json", &[10], [120, 80]);
        cases.push((biker, cameras[0].clone()));
    }
    cases
}

#[test]
fn inspect_counts_what_a_pixel_takes() {
    let gpu = Gpu::new();
    for ((scene, camera), portable) in cases().iter().zip([false, true, false]) {
        let options = Options { portable, ..Options::EXACT };
        let picture = |work| inspect(&gpu, scene, camera, &options, look(Look::Work(work)));
        let [load, evaluations, contributions] = [Work::TileLoad, Work::Evaluations, Work::Contributions].map(picture);
        let own = evaluations.listed(scene, camera);
        let (own_pixels, exact) = (own.blend(), Listed::of(scene, camera, RULES));
        let (exact_pixels, mut compared, mut stopped) = (exact.blend(), 0, 0);
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
        println!("{compared} of {} pixels, {stopped} stopped", own_pixels.len());
        assert!(compared > own_pixels.len() * 9 / 10 && stopped > 10, "{compared} compared, {stopped} stopped");
    }
}

/// The lists may hold what touches a tile between its pixel centres, or within rounding.
#[test]
fn tile_load_is_the_length_of_the_reference_list() {
    let gpu = Gpu::new();
    for (scene, camera) in cases() {
        let load = inspect(&gpu, &scene, &camera, &Options::EXACT, look(Look::Work(Work::TileLoad))).pixels;
        let generous = Listed::of(&scene, &camera, &Rules { alpha_min: 0.99 * RULES.alpha_min, ..*RULES });
        let exact = Listed::of(&scene, &camera, RULES);
        let tiles = exact.tiling.counts[0] * exact.tiling.counts[1];
        let mut sums = [0; 2];
        for tile in 0..tiles {
            let (x, y) = (tile % exact.tiling.counts[0] * TILE, tile / exact.tiling.counts[0] * TILE);
            let pixel = (y * camera.size_px[0] + x) as usize;
            let (loaded, [exact, most]) = (load.rgba[pixel][0], [&exact, &generous].map(|l| l.list(pixel).0.len()));
            assert!(loaded as usize <= most, "tile {tile}: {loaded} for {exact} to {most}");
            sums[0] += loaded as usize;
            sums[1] += exact;
        }
        assert!(sums[0].abs_diff(sums[1]) * 50 <= sums[1], "{sums:?} are within 2 %");
    }
}

/// More entries in one tile than llvmpipe lets a loop run.
#[test]
fn a_list_longer_than_65535_is_walked_to_its_end() {
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
    let picture = |work| inspect(&gpu, &scene, &camera, &Options::EXACT, look(Look::Work(work)));
    let [evaluations, contributions, centres] = [Work::Evaluations, Work::Contributions, Work::Centres].map(picture);
    let lists = evaluations.listed(&scene, &camera);
    assert!(lists.list(0).0.len() > 65_535);
    for (pixel, exact) in lists.blend().iter().enumerate().filter(|(_, exact)| exact.doubt == 0.0) {
        let (walked, at) = (lists.walk(pixel), |picture: &Picture| picture.pixels.rgba[pixel][0] as usize);
        let counted = (at(&evaluations), at(&contributions));
        assert_eq!(counted, (walked.evaluations, walked.blended.len()), "pixel {pixel}: {exact:?}");
    }
    let last = reference::project(&scene, 70_000, &camera, RULES).mean_px;
    assert_eq!(centres.pixels.at(last.x as u32, last.y as u32), &[0.0, 1.0, 0.0, 1.0]);
}

const ATTRIBUTES: [Attribute; 7] = [
    Attribute::Depth,
    Attribute::Normal,
    Attribute::Opacity,
    Attribute::Size,
    Attribute::Anisotropy,
    Attribute::BaseColour,
    Attribute::Identity,
];

fn attribute(attribute: Attribute, scene: &Gaussians, id: u32, camera: &Camera) -> DVec3 {
    let i = id as usize;
    let scale = scene.scales()[i].map(f64::from);
    let (longest, shortest) = (scale.into_iter().fold(0.0, f64::max), scale.into_iter().fold(f64::MAX, f64::min));
    let mean = DVec3::from(scene.means()[i].map(f64::from));
    match attribute {
        Attribute::Depth => DVec3::splat(camera.view(mean).z),
        Attribute::Normal => {
            let [w, x, y, z] = scene.rotations()[i].map(f64::from);
            let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
            let normal = axes.col(scale.iter().position(|s| *s == shortest).unwrap());
            0.5 - 0.5 * normal * normal.dot(mean - camera.position).signum()
        }
        Attribute::Opacity => DVec3::splat(scene.opacities()[i].into()),
        Attribute::Size => DVec3::splat(longest.log2()),
        Attribute::Anisotropy => DVec3::splat((longest / shortest).log2()),
        Attribute::BaseColour => (0.5 + harmonics::C0 * DVec3::from(scene.sh(i)[0].map(f64::from))).max(DVec3::ZERO),
        Attribute::Identity => {
            let state = id.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
            let bytes = ((word >> 22) ^ word).to_le_bytes();
            0.2 + 0.8 / 255.0 * DVec3::new(bytes[0].into(), bytes[1].into(), bytes[2].into())
        }
    }
}

/// Largest and mean difference of a picture to the reference recoloured by an attribute, where it is in no doubt, over the
/// largest value.
fn difference(pixels: &Pixels, shown: Attribute, scene: &Gaussians, camera: &Camera) -> [f64; 2] {
    let mut exact = Listed::of(scene, camera, RULES);
    for (splat, id) in exact.splats.iter_mut().zip(&exact.gaussians) {
        splat.colour = attribute(shown, scene, *id, camera);
    }
    let scale = exact.splats.iter().map(|s| s.colour.abs().max_element()).fold(0.0, f64::max);
    let unsigned = exact.splats.iter().map(|s| s.colour.abs()).collect::<Vec<_>>();
    let expected = exact.blend();
    exact.splats.iter_mut().zip(unsigned).for_each(|(splat, colour)| splat.colour = colour);
    let (mut largest, mut sum) = (0.0_f64, 0.0);
    for ((pixel, expected), Pixel { doubt, .. }) in pixels.rgba.iter().zip(&expected).zip(exact.blend()) {
        let alpha = (f64::from(pixel[3]) - (1.0 - expected.transmittance)).abs();
        let error = (0..3).map(|i| (f64::from(pixel[i]) - expected.colour[i]).abs() / scale).fold(alpha, f64::max);
        sum += error;
        largest = largest.max(if doubt > 0.0 { 0.0 } else { error });
    }
    [largest, sum / expected.len() as f64]
}
use reference::Pixel;

#[test]
fn recolour_shows_the_attributes_of_the_gaussians() {
    let gpu = Gpu::new();
    let stored = |storage| Options { sh_storage: storage, shape_storage: storage, ..Options::EXACT };
    let halves = Options { half_blend: true, portable: true, ..stored(Storage::F32) };
    for (scene, camera) in cases() {
        for shown in ATTRIBUTES {
            let against = |options: &Options, expected| {
                let pixels = inspect(&gpu, &scene, &camera, options, look(Look::Attribute(shown))).pixels;
                difference(&pixels, expected, &scene, &camera)
            };
            for options in [Options::EXACT, halves] {
                let [largest, mean] = against(&options, shown);
                assert!(largest <= ROUNDING && mean <= ROUNDING, "{shown:?}: {largest:e}, {mean:e}");
            }
            // What is kept in fewer bits has other ellipses too.
            for (storage, allowed) in [(Storage::F16, 1e-3), (Storage::U8, 3e-2)] {
                let [_, mean] = against(&stored(storage), shown);
                assert!(mean <= allowed, "{shown:?} in {storage:?}: {mean:e}");
            }
            let other = if shown == Attribute::Depth { Attribute::Normal } else { Attribute::Depth };
            let [largest, mean] = against(&Options::EXACT, other);
            assert!(largest > 0.1 && mean > 0.01, "{shown:?} is told from {other:?}: {largest}, {mean}");
        }
    }
}

#[test]
fn an_isolated_gaussian_is_drawn_as_if_it_were_alone() {
    let gpu = Gpu::new();
    let all = cloud(&mut Random(8), 300, 2, 0.3);
    let (scene, camera) = (build(&all, 2), camera());
    let options = Options { shape_storage: Storage::F32, sh_storage: Storage::F32, ..Options::EXACT };
    let visible = reference::cull(&scene, &camera, RULES);
    let hidden = (0..300).find(|id| visible.binary_search(id).is_err()).unwrap();
    for id in visible.into_iter().step_by(40).chain([hidden, 299, 300]) {
        let isolated = Inspection { isolated: Some(id), ..Inspection::default() };
        let picture = inspect(&gpu, &scene, &camera, &options, isolated.clone());
        let alone = build(all.get(id as usize..id as usize + 1).unwrap_or(&[]), 2);
        let mut ordinary = still(&gpu, &alone, &options);
        ordinary.render(&camera, Background::Colour([0.3; 3])).unwrap();
        assert!(picture.pixels == ordinary.pixels().unwrap(), "{id}");
        let expected = reference::render(&alone, &camera, RULES, Background::Colour([0.3; 3]));
        assert_eq!(compare(&picture.pixels, &expected).unexplained, 0, "{id}");
        let load = Inspection { look: Look::Work(Work::TileLoad), ..isolated };
        let load = inspect(&gpu, &scene, &camera, &options, load).pixels;
        assert!(load.rgba.iter().all(|p| p[0] <= 1.0), "its tiles list nothing else");
    }
}

/// From beside, from among and from beyond what is drawn, so that much of it lies behind the camera.
#[test]
fn what_is_culled_from_elsewhere_is_drawn_from_here() {
    let gpu = Gpu::new();
    for (scene, from) in cases() {
        let frozen = inspect(&gpu, &scene, &from, &Options::EXACT, Inspection::default()).gaussians();
        let keep = |ids: &[u32]| {
            let all = common::free::free(&scene);
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
                let picture = inspect(&gpu, &scene, &camera, &Options::EXACT, inspection);
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
