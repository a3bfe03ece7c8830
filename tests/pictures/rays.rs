//! Pictures of cameras with lenses against the reference, and pictures that must be equal.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DMat3, DVec2, DVec3};
use smalto::camera::Camera;
use smalto::measure::metrics::psnr;
use smalto::options::Options;
use smalto::pixels::Pixels;
use smalto::reference::{self, Pixel, Rendering};
use smalto::render::{Capacity, GpuScene, Inspection, Path, Renderer, depths};
use smalto::rules::{Background, Response, Rules};

use crate::common::agree::ball;
use crate::common::lens::{all, around, sphere, through};
use crate::common::{Gpu, ROUNDING, Random, again_in_subgroups_of_four, compare, difference, gaussians};

const WHITE: Background = Background::Colour([1.0; 3]);
/// dB.
const AGREES: f64 = 90.0;
/// Relative error of a depth: the GPU interpolates the footprints that weigh it.
const INTERPOLATED: f32 = 1e-3;
/// Error of a channel where a lens folds: footprints grow fast there, and the GPU interpolates them.
const NEAR_FOLD: f32 = 1e-3;

fn renderer(gpu: &Gpu, scene: &smalto::scene::Gaussians, options: &Options) -> Renderer {
    Renderer::new(&gpu.0, options, &GpuScene::new(&gpu.0, scene, options).unwrap()).unwrap()
}

fn draw(still: &mut Renderer, camera: &Camera) -> Pixels {
    let path = still.render(camera, WHITE).unwrap().path;
    assert!(matches!(path, Path::Rays | Path::FastRays), "{path}");
    still.pixels().unwrap()
}

/// [`Options::EXACT`] on the fast path, where the device has it, and on the portable path.
fn exact_on_both() -> [Options; 2] {
    [Options::EXACT, Options { portable: true, ..Options::EXACT }]
}

/// Every pixel agrees but for its doubt, and those that rounding decides otherwise, one in 1000 at most, aside, the
/// picture has [`AGREES`].
fn assert_agrees(name: &str, mut pixels: Pixels, exact: &Rendering) {
    let found = compare(&pixels, exact);
    println!("{name}: {found:?}");
    assert!(found.unexplained == 0 && found.different <= 1 + pixels.rgba.len() / 1000, "{name}: {found:?}");
    let expected = exact.to_pixels();
    for ((pixel, expected), exact) in pixels.rgba.iter_mut().zip(&expected.rgba).zip(&exact.pixels) {
        if difference((pixel, exact)) > ROUNDING {
            *pixel = *expected;
        }
    }
    let db = psnr(&pixels, &expected);
    assert!(db >= AGREES, "{name}: {db} dB");
}

#[test]
fn pictures_of_every_lens_match_the_reference() {
    let gpu = Gpu::new();
    for size in [[96, 64], [61, 37], [1, 1]] {
        for (i, (name, camera)) in all(size).into_iter().enumerate() {
            let scene = around(&mut Random(10 + i as u64), &camera, 600);
            let exact = reference::render(&scene, &camera, &Rules::TRAINED, WHITE);
            for options in exact_on_both() {
                let pixels = draw(&mut renderer(&gpu, &scene, &options), &camera);
                assert_agrees(&format!("{name} {size:?} portable {}", options.portable), pixels, &exact);
            }
        }
    }
}

/// A row, a column and a pixel alone, and parts whose last bins are one pixel wide or high.
#[test]
fn parts_of_a_picture_show_its_pixels() {
    const SIZE: [u32; 2] = [97, 80];
    let gpu = Gpu::new();
    for (i, (name, camera)) in all(SIZE).into_iter().enumerate() {
        let scene = around(&mut Random(40 + i as u64), &camera, 300);
        for options in exact_on_both() {
            let mut still = renderer(&gpu, &scene, &options);
            let whole = draw(&mut still, &camera);
            for ([left, top], size) in [
                ([48, 0], [1, 80]),
                ([0, 40], [97, 1]),
                ([50, 41], [1, 1]),
                ([3, 5], [65, 33]),
                ([20, 7], [33, 65]),
                ([16, 9], [2, 50]),
            ] {
                let centre_px = camera.centre_px - DVec2::new(left.into(), top.into());
                let part = draw(&mut still, &Camera { centre_px, size_px: size, ..camera.clone() });
                for (index, pixel) in part.rgba.iter().enumerate() {
                    let [x, y] = [index as u32 % size[0] + left, index as u32 / size[0] + top];
                    let expected = whole.rgba[(y * SIZE[0] + x) as usize];
                    let error = pixel.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                    // Less than an alpha at the threshold.
                    assert!(error < 1e-3, "{name} {size:?} portable {}: {x}, {y} {error}", options.portable);
                }
            }
        }
    }
}

/// One renderer draws one lens after the other, and then the first again.
#[test]
fn a_renderer_changes_its_lens_from_frame_to_frame() {
    let gpu = Gpu::new();
    let cameras: Vec<Camera> = all([48, 32]).into_iter().map(|(_, camera)| camera).collect();
    let scene = around(&mut Random(3), &cameras[0], 300);
    let mut one = renderer(&gpu, &scene, &Options::EXACT);
    for camera in cameras.iter().chain([&cameras[0]]) {
        let own = draw(&mut renderer(&gpu, &scene, &Options::EXACT), camera);
        assert!(draw(&mut one, camera) == own, "{camera:?}");
    }
    let pinhole = Camera { lens: None, ..cameras[0].clone() };
    assert!(matches!(one.render(&pinhole, WHITE).unwrap().path, Path::Fast | Path::Portable));
}

#[test]
fn rules_hold_along_rays() {
    let gpu = Gpu::new();
    let camera = through("OPENCV_FISHEYE", &[-0.02, 0.004, -0.001, 0.0001], [64, 48], 3.0);
    let scene = around(&mut Random(5), &camera, 400);
    let trained = Rules::TRAINED;
    for rules in [
        Rules { antialiased: true, ..trained },
        Rules { extent: smalto::rules::Footprint::ThreeSigma, ..trained },
        Rules { near: 2.0, ..trained },
        Rules { alpha_min: 1.0 / 64.0, ..trained },
        Rules { transmittance_min: 0.05, ..trained },
    ] {
        let options = Options { rules, ..Options::EXACT };
        let pixels = draw(&mut renderer(&gpu, &scene, &options), &camera);
        assert_agrees(&format!("{rules:?}"), pixels.clone(), &reference::render(&scene, &camera, &rules, WHITE));
        let other = compare(&pixels, &reference::render(&scene, &camera, &trained, WHITE));
        assert!(other.unexplained > 0, "{rules:?} shows in this scene");
    }
}

#[test]
fn pinholes_are_drawn_along_rays_by_the_rule() {
    let gpu = Gpu::new();
    let camera = Camera { lens: None, ..through("PINHOLE", &[], [96, 64], 2.2) };
    let scene = around(&mut Random(6), &camera, 600);
    let screen = reference::render(&scene, &camera, &Rules::TRAINED, WHITE);
    let rules = Rules { response: Response::Ray, ..Rules::TRAINED };
    let exact = reference::render(&scene, &camera, &rules, WHITE);
    let almost = Camera { lens: through("OPENCV", &[1e-12, 0.0, 0.0, 0.0], [96, 64], 2.2).lens, ..camera.clone() };
    let almost = reference::render(&scene, &almost, &Rules::TRAINED, WHITE);
    assert!(psnr(&exact.to_pixels(), &almost.to_pixels()) > 120.0, "as through a lens that does not distort");
    for options in exact_on_both() {
        let pixels = draw(&mut renderer(&gpu, &scene, &Options { rules, ..options }), &camera);
        assert_agrees(&format!("portable {}", options.portable), pixels.clone(), &exact);
        assert!(compare(&pixels, &screen).unexplained > 0, "the projection shows in this scene");
    }
}

#[test]
fn depths_and_counts_along_rays_are_those_of_the_reference() {
    let gpu = Gpu::new();
    let sees = |pixel: &Pixel| pixel.transmittance > 1e-9;
    for (i, (name, camera)) in all([48, 32]).into_iter().enumerate() {
        let scene = around(&mut Random(40 + i as u64), &camera, 600);
        let rendering = reference::render(&scene, &camera, &Rules::TRAINED, WHITE);
        let expected = rendering.depths();
        let mut still = renderer(&gpu, &scene, &Options::EXACT);
        let before = draw(&mut still, &camera);
        still.set_inspection(Inspection::of_depths()).unwrap();
        assert_eq!(still.render(&camera, WHITE).unwrap().path, Path::Rays);
        let drawn = depths(&still.pixels().unwrap());
        let (mut compared, mut agreeing) = (0, 0);
        for (i, _) in rendering.pixels.iter().enumerate().filter(|(_, exact)| exact.doubt == 0.0 && sees(exact)) {
            let own = [&drawn.expected, &drawn.median, &drawn.counts].map(|plane| plane.values[i]);
            let of = [&expected.expected, &expected.median, &expected.counts].map(|plane| plane.values[i]);
            let is_near = |(own, of): (f32, f32)| {
                own.is_nan() && of.is_nan() || own == of || (own - of).abs() <= INTERPOLATED * of
            };
            agreeing += usize::from(own[2] == of[2] && own.into_iter().zip(of).all(is_near));
            compared += 1;
        }
        println!("{name}: {agreeing} of {compared} pixels agree");
        assert!(compared > rendering.pixels.len() / 3, "{name}: {compared} compared");
        assert!(compared - agreeing <= 1 + compared / 200, "{name}: {agreeing} of {compared} pixels agree");
        still.set_inspection(Inspection::default()).unwrap();
        assert!(draw(&mut still, &camera) == before, "{name}: the picture is as before");
    }
}

#[test]
fn an_explanation_along_a_ray_adds_up_to_the_pixel() {
    let gpu = Gpu::new();
    for (i, (name, camera)) in all([48, 32]).into_iter().enumerate() {
        let scene = around(&mut Random(50 + i as u64), &camera, 600);
        let exact = reference::render(&scene, &camera, &Rules::TRAINED, WHITE);
        for options in exact_on_both() {
            let mut still = renderer(&gpu, &scene, &options);
            let pixels = draw(&mut still, &camera);
            let mut explained = 0;
            for pixel in [[24, 16], [3, 5], [40, 29]] {
                let index = (pixel[1] * 48 + pixel[0]) as usize;
                let found = still.explain(pixel).unwrap();
                let colour = found.colour(WHITE);
                let apart = (0..3).map(|i| (colour[i] - pixels.rgba[index][i]).abs()).fold(0.0, f32::max);
                assert!(apart < ROUNDING as f32, "{name} {pixel:?}: {colour:?} for {:?}", pixels.rgba[index]);
                let blended = exact.pixels[index].blended;
                assert!(exact.pixels[index].doubt > 0.0 || found.splats.len() as u32 == blended, "{name} {pixel:?}");
                assert!(found.splats.is_sorted_by_key(|splat| splat.depth), "{name} {pixel:?}: by depth");
                explained += found.splats.len();
            }
            assert!(explained > 10, "{name}: {explained} splats");
            assert!(still.pixels().unwrap() == pixels, "{name}: the picture is as before");
        }
    }
}

/// Products in the place of quotients cost less than the preset allows, also where the camera is inside of splats.
#[test]
fn balanced_pictures_along_rays_keep_their_promise() {
    let gpu = Gpu::new();
    let quotients = Options { portable: true, ..Options::BALANCED };
    for (i, (name, camera)) in all([300, 200]).into_iter().enumerate() {
        let scene = around(&mut Random(20 + i as u64), &camera, 1500);
        let [exact, balanced, quotients] = [Options::EXACT, Options::BALANCED, quotients]
            .map(|options| draw(&mut renderer(&gpu, &scene, &options), &camera));
        let [db, by_products] = [&exact, &quotients].map(|other| psnr(&balanced, other));
        let channels = balanced.rgba.iter().zip(&quotients.rgba).flat_map(|(a, b)| a.iter().zip(b));
        let largest = channels.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        println!("{name}: {db} dB, by products {by_products} dB, {largest}");
        assert!(db > 60.0 && by_products > 66.0, "{name}: {db} dB, by products {by_products} dB");
        assert!(largest < 3.0 / 255.0, "{name}: {largest} by products");
    }
}

#[test]
fn pixels_without_a_ray_are_transparent_black() {
    let gpu = Gpu::new();
    let folds = through("OPENCV", &[-0.25, 0.0, 0.0, 0.0], [70, 50], 3.0);
    for camera in [folds, through("FISHEYE", &[], [70, 50], 8.0)] {
        let scene = around(&mut Random(7), &camera, 300);
        let pixels = draw(&mut renderer(&gpu, &scene, &Options::EXACT), &camera);
        let found = compare(&pixels, &reference::render(&scene, &camera, &Rules::TRAINED, WHITE));
        assert!(found.psnr >= AGREES && found.max_error < NEAR_FOLD, "{found:?}");
        let mut seen = [0, 0];
        for (i, rgba) in pixels.rgba.iter().enumerate() {
            let place = DVec2::new((i % 70) as f64 + 0.5, (i / 70) as f64 + 0.5);
            let has_ray = camera.ray(place).is_some();
            seen[usize::from(has_ray)] += 1;
            assert_eq!(*rgba == [0.0; 4], !has_ray, "{place}: {rgba:?}");
        }
        assert!(seen.iter().all(|count| *count > 300), "{seen:?}");
    }
}

#[test]
fn a_quarter_turn_of_a_panorama_shifts_it_by_a_quarter_of_its_columns() {
    let gpu = Gpu::new();
    let camera = sphere([128, 64]);
    let scene = around(&mut Random(9), &camera, 500);
    let turned = Camera { rotation: DMat3::from_rotation_y(FRAC_PI_2) * camera.rotation, ..camera.clone() };
    let mut still = renderer(&gpu, &scene, &Options::EXACT);
    let [before, after] = [&camera, &turned].map(|camera| draw(&mut still, camera));
    assert!(psnr(&before, &after) < 40.0, "the picture is no plain colour");
    // What lay at azimuth a lies at a + 90 degrees now.
    let shifted = |i: usize| before.rgba[i / 128 * 128 + (i + 96) % 128];
    let shifted = Pixels { size: before.size, rgba: (0..before.rgba.len()).map(shifted).collect() };
    assert!(psnr(&shifted, &after) > AGREES, "{} dB", psnr(&shifted, &after));
}

/// A scene without detail, in which footprints of pixels play no part.
fn balls_around(camera: &Camera) -> smalto::scene::Gaussians {
    let mut random = Random(13);
    let one = |_| {
        let direction = DVec3::from_array(std::array::from_fn(|_| random.between(-1.0, 1.0))).normalize();
        let distance = random.between(2.0, 9.0);
        let mean = (camera.position + distance * direction).to_array();
        (ball(mean, distance * random.between(0.1, 0.3), 0.8), std::array::from_fn(|_| random.between(0.0, 1.0) as f32))
    };
    gaussians(&(0..150).map(one).collect::<Vec<_>>())
}

/// The pinholes look along the axes of the panorama, 96 degrees wide.
#[test]
fn a_panorama_shows_what_six_pinholes_along_rays_show() {
    const SIDE: f64 = 160.0;
    let gpu = Gpu::new();
    let panorama = sphere([128, 64]);
    let scene = balls_around(&panorama);
    let rules = Rules { response: Response::Ray, ..Rules::TRAINED };
    let mut still = renderer(&gpu, &scene, &Options { rules, ..Options::EXACT });
    let whole = draw(&mut still, &panorama);
    let turns = [0.0, 0.5, 1.0, 1.5].map(|turn| DMat3::from_rotation_y(PI * turn));
    let turns = turns.into_iter().chain([-0.5, 0.5].map(|turn| DMat3::from_rotation_x(PI * turn)));
    let faces: Vec<(Camera, Pixels)> = turns
        .map(|turn| {
            let plain = Camera::looking_at(panorama.position, DVec3::ZERO, [SIDE as u32; 2], 1.0);
            let focal_px = DVec2::splat(SIDE / 2.0 / 48_f64.to_radians().tan());
            let face = Camera { focal_px, rotation: turn * panorama.rotation, ..plain };
            let pixels = draw(&mut still, &face);
            (face, pixels)
        })
        .collect();
    let seen = |i: usize| {
        let place = DVec2::new((i % 128) as f64 + 0.5, (i / 128) as f64 + 0.5);
        let point = panorama.unprojected(place, 5.0);
        let aside = |at: &DVec2| (*at - SIDE / 2.0).abs().max_element();
        let places = faces.iter().filter_map(|(face, pixels)| Some((face.projected(point)?.0, pixels)));
        let (at, pixels) = places.min_by(|(a, _), (b, _)| aside(a).total_cmp(&aside(b))).unwrap();
        let (low, part) = ((at - 0.5).floor(), (at - 0.5).fract().as_vec2());
        let texel = |x: usize, y: usize| pixels.rgba[(low.y as usize + y) * SIDE as usize + low.x as usize + x];
        let mix = |a: [f32; 4], b: [f32; 4], part: f32| std::array::from_fn(|i| a[i] + part * (b[i] - a[i]));
        mix(mix(texel(0, 0), texel(1, 0), part.x), mix(texel(0, 1), texel(1, 1), part.x), part.y)
    };
    let resampled = Pixels { size: whole.size, rgba: (0..whole.rgba.len()).map(seen).collect() };
    let db = psnr(&whole, &resampled);
    println!("{db} dB");
    assert!(db > 45.0, "{db} dB");
}

#[test]
fn options_and_buffers_that_grow_change_no_bit_along_rays() {
    let gpu = Gpu::new();
    let (_, camera) = all([80, 56]).swap_remove(2);
    let scene = around(&mut Random(11), &camera, 2000);
    for options in exact_on_both() {
        let mut still = renderer(&gpu, &scene, &options);
        let expected = draw(&mut still, &camera);
        let enough = still.render(&camera, WHITE).unwrap();
        assert_eq!(enough.attempts, 1);
        let room = Capacity { gaussians: 1, visible: 7, spans: 1, listed: 9, cells: 1 };
        let mut still = still.with_capacity(room).unwrap();
        let grown = still.render(&camera, WHITE).unwrap();
        assert!(grown.attempts > 1 && grown.totals == enough.totals, "{grown:?}");
        assert!(still.pixels().unwrap() == expected, "buffers that grow");
    }
    let passes = Options { rules: Rules { transmittance_min: 0.0, ..Rules::TRAINED }, ..Options::EXACT };
    let whole = draw(&mut renderer(&gpu, &scene, &passes), &camera);
    let exact = reference::render(&scene, &camera, &passes.rules, WHITE);
    assert_eq!(compare(&whole, &exact).unexplained, 0, "lists that no pixel ends early");
}

#[test]
fn pictures_along_rays_agree_in_subgroups_of_four() {
    again_in_subgroups_of_four(&["rays::pictures_of_every_lens", "rays::options_and_buffers"]);
}
