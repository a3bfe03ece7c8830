//! Scenes that are packed on the device, against scenes that are packed on the host.

use smalto::camera::Camera;
use smalto::options::{Options, Storage};
use smalto::packing::{Layout, Statistics};
use smalto::render::{DeviceArrays, Examination, GpuScene, HostNeeded, Renderer, Upload};
use smalto::rules::{Background, LISTED_ALPHA, Rules};
use smalto::scene::{Arrays, Gaussians, sh_coefficients};

use crate::common::{Gpu, Random};

/// Arrays as a training program has them.
#[derive(Clone)]
struct Rows {
    means: Vec<[f32; 3]>,
    rotations: Vec<[f32; 4]>,
    scales: Vec<[f32; 3]>,
    opacities: Vec<f32>,
    sh: Vec<[f32; 3]>,
    degree: u32,
}

impl Rows {
    /// `count` rows that can be drawn, with unit and other quaternions, and small, large and rounded values.
    fn random(count: usize, degree: u32, seed: u64) -> Self {
        let mut random = Random(seed);
        let mut number = |low: f64, high: f64| random.between(low, high) as f32;
        let mut rows = Self {
            means: Vec::new(),
            rotations: Vec::new(),
            scales: Vec::new(),
            opacities: Vec::new(),
            sh: Vec::new(),
            degree,
        };
        for i in 0..count {
            rows.means.push([(); 3].map(|()| number(-2.0, 2.0)));
            let q = [(); 4].map(|()| number(-1.0, 1.0));
            let length = q.iter().map(|v| v * v).sum::<f32>().sqrt();
            rows.rotations.push(match i % 5 {
                0 => q.map(|v| v / length),
                1 => q.map(|v| v * 1e-25),
                2 => [q[0], 0.0, -0.0, 1e-30],
                _ => q,
            });
            rows.scales.push([(); 3].map(|()| number(-9.0, -3.0).exp()));
            rows.opacities.push(match i % 17 {
                0 => 1.0,
                1 => 1.0 + 6e-6,
                2 => 1.0 / 255.0,
                3 => number(0.0, 0.005),
                4 => number(-70.0, 0.0).exp(),
                _ => number(0.0, 1.0),
            });
            for coefficient in 0..sh_coefficients(degree) {
                rows.sh.push(match (coefficient, i % 13) {
                    (0, _) => [(); 3].map(|()| number(-1.5, 1.5)),
                    (_, 0) => [(); 3].map(|()| number(-40.0, -10.0).exp()),
                    (_, 1) => [0.0, -0.0, 0.0],
                    _ => [(); 3].map(|()| number(-0.05, 0.05)),
                });
            }
        }
        rows
    }

    fn gaussians(&self) -> Gaussians {
        let Self { means, rotations, scales, opacities, sh, degree } = self;
        let arrays = Arrays { means, rotations, scales, opacities, sh, sh_degree: *degree };
        let (gaussians, report) = arrays.gaussians().unwrap();
        assert_eq!(report.dropped(), report.transparent);
        gaussians
    }

    fn on(&self, gpu: &Gpu) -> DeviceArrays {
        let arrays = DeviceArrays::new(&gpu.0, self.opacities.len(), self.degree).unwrap();
        let parts: [&[f32]; 5] = [
            self.means.as_flattened(),
            self.rotations.as_flattened(),
            self.scales.as_flattened(),
            &self.opacities,
            self.sh.as_flattened(),
        ];
        gpu.run(|cmd| {
            let words = arrays.words();
            let write = |memory: &mut [u32]| {
                for (range, part) in arrays.parts().into_iter().zip(parts) {
                    memory[range].copy_from_slice(bytemuck::cast_slice(part));
                }
            };
            cmd.upload(words, 0, words.len(), write).unwrap();
        });
        arrays
    }

    fn examined(&self, gpu: &Gpu, options: &Options) -> Result<Examination, HostNeeded> {
        self.on(gpu).examine(options, Upload::default()).unwrap()
    }
}

fn packed(gpu: &Gpu, rows: &Rows, options: &Options, upload: Upload) -> GpuScene {
    let mut arrays = rows.on(gpu);
    let examination = arrays.examine(options, upload).unwrap().unwrap_or_else(|why| panic!("{why}"));
    arrays.pack(&examination, None, upload).unwrap().unwrap()
}

/// The words of all planes.
fn planes(gpu: &Gpu, scene: &GpuScene) -> Vec<Vec<[u32; 4]>> {
    scene.planes().map(|plane| gpu.download(plane)).collect()
}

const F32: Options = Options { sh_storage: Storage::F32, shape_storage: Storage::F32, ..Options::EXACT };

/// Fails if the scenes have different bytes.
fn assert_packed(gpu: &Gpu, rows: &Rows, options: &Options, upload: Upload) {
    let gaussians = rows.gaussians();
    let name = format!("{} Gaussians of degree {}, {options:?}", gaussians.len(), rows.degree);
    let alpha_min = if upload.is_certifiable { LISTED_ALPHA } else { options.rules.alpha_min };
    let uploaded = Options { rules: Rules { alpha_min, ..options.rules }, ..*options };
    let expected = GpuScene::new(&gpu.0, &gaussians, &uploaded).unwrap();
    let found = packed(gpu, rows, options, upload);
    let statistics = Statistics::of(&gaussians);
    assert_eq!(found.layout(), expected.layout(), "{name}");
    let examination = rows.on(gpu).examine(options, upload).unwrap().unwrap();
    assert_eq!(examination.extent(), statistics.extent, "{name}");
    assert_eq!(*examination.layout(), Layout::of(&statistics, options), "{name}");
    for (i, (found, expected)) in planes(gpu, &found).iter().zip(&planes(gpu, &expected)).enumerate() {
        let place = found.iter().zip(expected).position(|(found, expected)| found != expected);
        let both = place.map(|k| (k, found[k], expected[k]));
        assert!(found.len() == expected.len() && place.is_none(), "{name}, plane {i}: {both:x?}");
    }
}

#[test]
fn arrays_are_packed_to_the_bytes_of_the_host() {
    let gpu = Gpu::new();
    for degree in 0..=4 {
        for count in [1, 7, 8, 9, 255, 256, 257, 2047, 2048, 2049, 5001] {
            assert_packed(&gpu, &Rows::random(count, degree, count as u64), &F32, Upload::default());
        }
        for count in [2047, 2048, 5001] {
            let rows = Rows::random(count, degree, 7);
            let gsplat = Options::preset("gsplat").unwrap();
            for options in [Options::EXACT, Options::BALANCED, Options::PREVIEW, gsplat] {
                assert_packed(&gpu, &rows, &options, Upload::default());
            }
            let lower = Options { sh_degree: degree.saturating_sub(1), ..Options::BALANCED };
            assert_packed(&gpu, &rows, &lower, Upload { is_certifiable: true, ..Upload::default() });
        }
    }
}

#[test]
fn arrays_of_wide_scales_and_bright_colours_have_the_layout_of_the_host() {
    let gpu = Gpu::new();
    let rows = Rows::random(3000, 3, 1);
    let mut wide = rows.clone();
    (wide.scales[5], wide.scales[6]) = ([1e-30, 0.0, 1.0], [3e30, 1e-3, 1e-2]);
    let mut bright = rows.clone();
    bright.sh[0] = [50.0, 0.0, 0.0];
    let mut lower = rows;
    (0..3000).for_each(|i| lower.sh[16 * i + 4..][..12].fill([0.0; 3]));
    for rows in [wide, bright, lower] {
        assert_packed(&gpu, &rows, &Options::BALANCED, Upload::default());
        assert_packed(&gpu, &rows, &Options::EXACT, Upload::default());
    }
}

/// Random opacities and quaternions, of which a different rounding would show in a few of a million.
#[test]
fn a_million_rows_are_packed_to_the_bytes_of_the_host() {
    let gpu = Gpu::new();
    let rows = Rows::random(1_000_000, 0, 100);
    assert_packed(&gpu, &rows, &Options::EXACT, Upload::default());
    assert_packed(&gpu, &rows, &Options::BALANCED, Upload { is_certifiable: true, ..Upload::default() });
}

fn camera() -> Camera {
    Camera::looking_at(glam::DVec3::new(0.3, -0.5, -6.0), glam::DVec3::ZERO, [160, 90], 0.9)
}

/// Gaussians with the opacity 0 keep their places on the device, where the host leaves them out.
#[test]
fn transparent_rows_are_never_drawn() {
    let gpu = Gpu::new();
    let mut rows = Rows::random(3000, 1, 3);
    for i in (0..3000).step_by(7) {
        rows.opacities[i] = if i % 2 == 0 { 0.0 } else { -5e-6 };
        (rows.means[i], rows.scales[i]) = ([900.0; 3], [50.0; 3]);
    }
    for options in [Options::EXACT, Options::BALANCED] {
        let expected = gpu.render(&rows.gaussians(), &camera(), &options);
        let scene = packed(&gpu, &rows, &options, Upload::default());
        assert_eq!(*scene.layout(), Layout::of(&Statistics::of(&rows.gaussians()), &options));
        let mut renderer = Renderer::new(&gpu.0, &options, &scene).unwrap();
        renderer.render(&camera(), Background::BLACK).unwrap();
        assert!(renderer.pixels().unwrap() == expected);
        assert!(expected.rgba.iter().any(|pixel| pixel[3] > 0.1), "the camera sees the scene");
    }
}

#[test]
fn arrays_with_values_out_of_range_are_left_to_the_host() {
    let gpu = Gpu::new();
    let rows = Rows::random(2100, 2, 4);
    assert!(rows.examined(&gpu, &Options::EXACT).is_ok());
    for wrong in [f32::NAN, f32::INFINITY, -f32::INFINITY, 2e38] {
        for row in [0, 1029, 2099] {
            let broken = |change: &dyn Fn(&mut Rows)| {
                let mut rows = rows.clone();
                change(&mut rows);
                rows.examined(&gpu, &Options::EXACT).err()
            };
            let expected = Some(HostNeeded::OutOfRange);
            assert_eq!(broken(&|rows| rows.means[row][1] = wrong), expected);
            assert_eq!(broken(&|rows| rows.opacities[row] = wrong), expected);
            assert_eq!(broken(&|rows| rows.sh[9 * row + 8][2] = wrong), expected);
            if !wrong.is_finite() {
                assert_eq!(broken(&|rows| rows.scales[row][2] = wrong), expected);
                assert_eq!(broken(&|rows| rows.rotations[row][3] = wrong), expected);
            }
            assert_eq!(broken(&|rows| rows.scales[row][0] = -1e-3), expected);
            assert_eq!(broken(&|rows| rows.rotations[row] = [0.0, -0.0, 0.0, 0.0]), expected);
            assert_eq!(broken(&|rows| rows.opacities[row] = 1.00002), expected);
            assert_eq!(broken(&|rows| rows.opacities[row] = -0.00002), expected);
        }
    }
}

#[test]
fn arrays_that_the_host_stores_otherwise_are_left_to_it() {
    let gpu = Gpu::new();
    let rows = Rows::random(2100, 1, 5);
    let why = |rows: &Rows, options: &Options| rows.examined(&gpu, options).err();
    let bytes = Options { shape_storage: Storage::U8, ..Options::BALANCED };
    assert_eq!(why(&rows, &bytes), Some(HostNeeded::Bytes));
    let mut rounded = rows.clone();
    rounded.sh.as_flattened_mut().iter_mut().for_each(|value| *value = (*value * 64.0).round() / 64.0);
    assert_eq!(why(&rounded, &Options::EXACT), Some(HostNeeded::Grids));
    assert_eq!(why(&rounded, &F32), None);
    let mut bright = rows.clone();
    bright.sh[2] = [80.0; 3];
    assert_eq!(why(&bright, &Options::BALANCED), Some(HostNeeded::Bright));
    assert_eq!(why(&bright, &Options::EXACT), None);
    let mut transparent = rows;
    transparent.opacities.fill(0.0);
    assert_eq!(why(&transparent, &F32), Some(HostNeeded::Empty));
    transparent.opacities.clear();
    assert_eq!(why(&Rows { means: vec![], rotations: vec![], scales: vec![], sh: vec![], ..transparent }, &F32), {
        Some(HostNeeded::Empty)
    });
}

/// A scene is packed over the one before, in its planes, and the renderer stays.
#[test]
fn a_replaced_scene_is_drawn_like_a_new_one() {
    let gpu = Gpu::new();
    for options in [Options::EXACT, Options::BALANCED, Options { portable: true, ..Options::EXACT }] {
        let first = Rows::random(3000, 3, 8);
        let mut scene = packed(&gpu, &first, &options, Upload::default());
        let mut renderer = Renderer::new(&gpu.0, &options, &scene).unwrap();
        renderer.render(&camera(), Background::BLACK).unwrap();
        for seed in [9, 10] {
            let mut next = Rows::random(3000, 3, seed);
            // Another extent, which decides on the depth keys.
            next.means[17] = [0.0, 0.0, 40.0 * seed as f32];
            let mut arrays = next.on(&gpu);
            let examination = arrays.examine(&options, Upload::default()).unwrap().unwrap();
            assert!(examination.fits(&scene));
            scene = arrays.pack(&examination, Some(scene), Upload::default()).unwrap().unwrap();
            assert!(renderer.replace_scene(&scene));
            renderer.render(&camera(), Background::BLACK).unwrap();
            assert!(renderer.pixels().unwrap() == gpu.render(&next.gaussians(), &camera(), &options));
        }
        let more = Rows::random(70_000, 3, 11);
        assert!(renderer.replace_scene(&packed(&gpu, &more, &options, Upload::default())));
        renderer.render(&camera(), Background::BLACK).unwrap();
        assert!(renderer.pixels().unwrap() == gpu.render(&more.gaussians(), &camera(), &options));
        let other = packed(&gpu, &Rows::random(3000, 1, 8), &options, Upload::default());
        assert!(!renderer.replace_scene(&other), "the pipelines are those of degree 3");
        renderer.render(&camera(), Background::BLACK).unwrap();
    }
}
