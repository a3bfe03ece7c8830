//! The stages that mark and select Gaussians: against figures in 64-bit floats, and against scenes without what is
//! left out.

use glam::{DVec2, DVec3};
use smalto::camera::Camera;
use smalto::options::Options;
use smalto::pixels::Pixels;
use smalto::procedural::cactus;
use smalto::render::shaders::shared::TINT_WEIGHT;
use smalto::render::{Aim, Figure, GpuScene, Marker, Outline, Renderer, SelectionMode};
use smalto::rules::Background;
use smalto::scene::Gaussians;

use crate::common::cloud::{SIZE, camera, cloud};
use crate::common::free::build;
use crate::common::{Gpu, Random, lens};

/// `TINT` of glsl/shared/marks.glsl.
const TINT: [f32; 3] = [1.0, 0.72, 0.1];

/// A set of about this fraction of `count` Gaussians.
fn some(random: &mut Random, count: usize, fraction: f64) -> Vec<u32> {
    let word = |first: usize| {
        let bits = (first..count.min(first + 32)).filter(|_| random.between(0.0, 1.0) < fraction);
        bits.fold(0, |word, i| word | 1 << (i - first))
    };
    (0..count).step_by(32).map(word).collect()
}

fn has(set: &[u32], i: usize) -> bool {
    set[i / 32] >> (i % 32) & 1 == 1
}

/// Of a scene with Gaussians that are never drawn: every figure in every mode, for numbers of Gaussians around a word,
/// a workgroup and more.
#[test]
fn figures_select_as_their_twin() {
    let gpu = Gpu::new();
    let marker = Marker::new(&gpu.0).unwrap();
    let random = &mut Random(47);
    let view = camera();
    let at = |x: f64, y: f64| DVec2::new(x, y);
    let star = (0..5).map(|i| f64::from(i * 2) * 1.2566).map(|a| at(48.0 + 30.0 * a.sin(), 32.0 - 30.0 * a.cos()));
    let way = (0..20).map(f64::from).map(|i| at(5.0 * i, 32.0 + 20.0 * (0.7 * i).sin())).collect();
    let figures = [
        Figure::Outline(Outline::Rectangle(at(70.0, 10.0), at(20.0, 50.0))),
        Figure::Outline(Outline::Lasso(star.collect())),
        Figure::Outline(Outline::Lasso(Vec::new())),
        Figure::Outline(Outline::Brush(way, 6.0)),
        Figure::Outline(Outline::Brush(vec![at(30.0, 30.0)], 12.0)),
        Figure::Ball(DVec3::new(0.3, 0.2, 3.0), 1.5),
        Figure::Box(DVec3::new(-1.0, -0.5, 1.0), DVec3::new(0.6, 9.0, 5.0)),
        Figure::Values(0.25..=0.5),
    ];
    for count in [1, 31, 33, 256, 5000] {
        let mut free = cloud(random, count, 0, 0.0);
        free.iter_mut().step_by(7).for_each(|one| one.raw.opacity_logit = -9.0);
        let all = build(&free, 0);
        let scene = GpuScene::new(&gpu.0, &all, &Options::EXACT).unwrap();
        let values: Vec<f32> = (0..count).map(|_| random.between(0.0, 1.0) as f32).collect();
        let contributions: Vec<f32> = (0..count).map(|_| random.between(0.0, 1.0) as f32).collect();
        let on_device = [gpu.upload("values", &values), gpu.upload("contributions", &contributions)];
        let (left_out, before) = (some(random, count, 0.3), some(random, count, 0.4));
        let before: Vec<u32> = before.iter().zip(&left_out).map(|(before, left_out)| before & !left_out).collect();
        for figure in &figures {
            for (mode, least) in [
                (SelectionMode::Replace, 0.0),
                (SelectionMode::Add, 0.0),
                (SelectionMode::Subtract, 0.0),
                (SelectionMode::Replace, 0.7),
                (SelectionMode::Subtract, 0.7),
            ] {
                marker.mark(&scene, &left_out, &before).unwrap();
                let aim = Aim {
                    view: &view,
                    near: 1.0,
                    values: Some(&on_device[0]),
                    contributions: Some((&on_device[1], least)),
                };
                let (found, _) = marker.select(&scene, figure, mode, aim).unwrap();
                let expected = |i: usize| {
                    let mean = DVec3::from(all.means()[i].map(f64::from));
                    let is_inside = contributions[i] >= least && figure.contains(&view, 1.0, mean, values[i]);
                    match mode {
                        _ if has(&left_out, i) => false,
                        SelectionMode::Replace => is_inside,
                        SelectionMode::Add => has(&before, i) || is_inside,
                        SelectionMode::Subtract => has(&before, i) && !is_inside,
                    }
                };
                for i in 0..count {
                    assert_eq!(has(&found, i), expected(i), "{figure:?} {mode:?}, Gaussian {i} of {count}");
                }
                assert_eq!(found.len(), count.div_ceil(32));
                assert!(count % 32 == 0 || found[count / 32] >> (count % 32) == 0, "no bit beyond the last Gaussian");
            }
        }
    }
}

fn picture(gpu: &Gpu, scene: &GpuScene, view: &Camera, options: &Options) -> Pixels {
    let mut renderer = Renderer::new(&gpu.0, options, scene).unwrap();
    renderer.render(view, Background::BLACK).unwrap();
    renderer.pixels().unwrap()
}

/// The scene and options of each path, with its cameras.
fn paths() -> Vec<(Options, Camera)> {
    let portable = Options { portable: true, ..Options::EXACT };
    let mut all = vec![(Options::EXACT, camera()), (portable, camera())];
    let through = lens::all(SIZE).swap_remove(1).1;
    all.extend([Options::EXACT, portable].map(|options| (options, through.clone())));
    all
}

/// Every path draws a scene with marks as the scene without what is left out, bit for bit, and again all of it once
/// the marks are gone. A renderer that was made before draws by the marks of the moment.
#[test]
fn pictures_leave_out_what_is_marked() {
    let gpu = Gpu::new();
    let marker = Marker::new(&gpu.0).unwrap();
    let random = &mut Random(11);
    for (options, view) in paths() {
        let all = match view.lens.is_some() {
            true => lens::around(random, &view, 700),
            false => build(&cloud(random, 700, 1, 0.1), 1),
        };
        let scene = GpuScene::new(&gpu.0, &all, &options).unwrap();
        let untouched = gpu.download(scene.planes().next().unwrap());
        let mut renderer = Renderer::new(&gpu.0, &options, &scene).unwrap();
        let mut drawn = || {
            renderer.render(&view, Background::BLACK).unwrap();
            renderer.pixels().unwrap()
        };
        let whole = drawn();
        let (left_out, none) = (some(random, all.len(), 0.5), vec![0; all.len().div_ceil(32)]);
        marker.mark(&scene, &left_out, &none).unwrap();
        let others: Vec<u32> = (0..all.len() as u32).filter(|i| !has(&left_out, *i as usize)).collect();
        let rest = all.selected(&others).unwrap();
        let alone = picture(&gpu, &GpuScene::new(&gpu.0, &rest, &options).unwrap(), &view, &options);
        let name = (options.portable, view.lens.is_some());
        assert!(drawn() == alone && alone != whole, "{name:?}: the rest as if it were all");
        // Bounds of its own keep the marks.
        let separate = marker.separated(&scene).unwrap();
        marker.mark(&scene, &none, &none).unwrap();
        assert!(drawn() == whole, "{name:?}: all again");
        assert!(picture(&gpu, &separate, &view, &options) == alone, "{name:?}: separated");
        assert!(gpu.download(scene.planes().next().unwrap()) == untouched, "no bit of the bounds has changed");
    }
}

/// Selected Gaussians have a mixture of their colour with the tint, on every path.
#[test]
fn selected_gaussians_are_tinted() {
    let gpu = Gpu::new();
    let marker = Marker::new(&gpu.0).unwrap();
    let random = &mut Random(5);
    let (all, options) = (build(&cloud(random, 500, 2, 0.2), 2), Options::EXACT);
    let scene = GpuScene::new(&gpu.0, &all, &options).unwrap();
    let (view, pixel) = (camera(), [SIZE[0] / 2, SIZE[1] / 2]);
    let mut renderer = Renderer::new(&gpu.0, &options, &scene).unwrap();
    renderer.render(&view, Background::BLACK).unwrap();
    let before = renderer.explain(pixel).unwrap();
    let (selected, none) = (some(random, all.len(), 0.5), vec![0; all.len().div_ceil(32)]);
    marker.mark(&scene, &none, &selected).unwrap();
    renderer.render(&view, Background::BLACK).unwrap();
    let after = renderer.explain(pixel).unwrap();
    assert_eq!(before.splats.len(), after.splats.len());
    let mut kinds = [0; 2];
    for (before, after) in before.splats.iter().zip(&after.splats) {
        let is_selected = has(&selected, before.gaussian as usize);
        let weight = if is_selected { TINT_WEIGHT } else { 0.0 };
        kinds[usize::from(is_selected)] += 1;
        for ((before, after), tint) in before.colour.into_iter().zip(after.colour).zip(TINT) {
            let mixed = before * (1.0 - weight) + tint * weight;
            assert!((after - mixed).abs() < 1e-6, "{after} instead of {mixed}");
        }
    }
    assert!(kinds.iter().all(|count| *count > 3), "{kinds:?}");
    for view in [camera(), lens::all(SIZE).swap_remove(1).1] {
        let [fast, portable] =
            [false, true].map(|portable| picture(&gpu, &scene, &view, &Options { portable, ..Options::EXACT }));
        let apart = fast.rgba.as_flattened().iter().zip(portable.rgba.as_flattened());
        let largest = apart.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(largest < 1e-3, "{largest}");
    }
}

/// A large scene that is culled in part, by depth and at the borders, with the options of the fast presets.
#[test]
fn presets_draw_the_rest_of_a_scene() {
    let gpu = Gpu::new();
    let marker = Marker::new(&gpu.0).unwrap();
    let all: Gaussians = cactus(20_000).unwrap().gaussians;
    let view = Camera::looking_at(DVec3::new(3.0, -2.0, -3.0), DVec3::new(0.0, -1.0, 0.0), [200, 150], 0.8);
    let random = &mut Random(3);
    let left_out = some(random, all.len(), 0.3);
    let others: Vec<u32> = (0..all.len() as u32).filter(|i| !has(&left_out, *i as usize)).collect();
    let rest = all.selected(&others).unwrap();
    for options in [Options::BALANCED, Options::FAST] {
        let [whole, alone] = [&all, &rest].map(|scene| GpuScene::new(&gpu.0, scene, &options).unwrap());
        marker.mark(&whole, &left_out, &vec![0; left_out.len()]).unwrap();
        let [marked, alone] = [&whole, &alone].map(|scene| picture(&gpu, scene, &view, &options));
        let apart = marked.rgba.as_flattened().iter().zip(alone.rgba.as_flattened());
        let largest = apart.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(largest < 0.02, "{largest}: both keep the promise of the preset");
    }
}
