//! The stages of the rays path in whole frames: what each wrote, against its twin on the CPU.

use std::sync::LazyLock;

use glam::{DMat2, DVec2, DVec3};
use smalto::camera::{Camera, Footprints};
use smalto::options::Options;
use smalto::reference::{self, RayLists, RaySplat, Tiling};
use smalto::render::shaders;
use smalto::rules::{Rules, TILE};
use smalto::scene::Gaussians;

use crate::common::lens::{all, around};
use crate::common::{Captured, Gpu, Random, again_in_subgroups_of_four, compare};

const RULES: &Rules = &Rules::TRAINED;

/// Relative error of squared distances, of w and of the variance along a ray: rounding of the products of a covariance
/// and its inverse in 32 bits, and the interpolation of footprints.
const TOLERANCE: f64 = 2e-3;
/// The same within 10 degrees of the direction straight back, where footprints shrink to nothing around the axis, and
/// one row of their table is left.
const BACK_TOLERANCE: f64 = 0.05;
/// The cosine of 170 degrees.
const BACK: f64 = -0.985;

struct Case {
    name: &'static str,
    gaussians: Gaussians,
    camera: Camera,
    captured: Captured,
    /// The lists of the reference, and its splats.
    exact: RayLists,
}

/// Frames with all their buffers. All tests of this file read the same.
static CASES: LazyLock<Vec<Case>> = LazyLock::new(|| {
    let gpu = Gpu::new();
    let case = |(i, (name, camera)): (usize, (&'static str, Camera))| {
        let count = [255, 256, 257, 1023, 1024, 1025][i];
        let gaussians = around(&mut Random(i as u64), &camera, count);
        let captured = gpu.capture(&gaussians, &camera, &Options { portable: true, ..Options::EXACT });
        let exact = RayLists::of(&gaussians, &camera, &Footprints::of(&camera).unwrap(), RULES);
        Case { name, gaussians, camera, captured, exact }
    };
    all([61, 45]).into_iter().enumerate().map(case).collect()
});

impl Case {
    /// The Gaussian of each splat of the GPU.
    fn visible(&self) -> Vec<u32> {
        self.captured.buffer("gaussian from splat")[..self.captured.frame.totals.visible_kept as usize].to_vec()
    }

    fn tile_counts(&self) -> Vec<u32> {
        self.captured.buffer("tile counts")[..self.captured.frame.totals.visible_kept as usize].to_vec()
    }

    /// The splats of the GPU that have tiles, each with its Gaussian.
    fn splats(&self) -> Vec<(u32, shaders::RaySplat)> {
        let splats: Vec<shaders::RaySplat> = self.captured.buffer("ray splats");
        let all = self.visible().into_iter().zip(splats).zip(self.tile_counts());
        all.filter(|(_, tiles)| *tiles > 0).map(|(splat, _)| splat).collect()
    }

    /// The list of each tile, as splats of the GPU.
    fn lists(&self) -> Vec<Vec<u32>> {
        let total = self.captured.frame.totals.listed_kept as usize;
        let pairs = [("instance keys", "instance values"), ("instance keys 2", "instance values 2")];
        let is_sorted = |(keys, _): &&(&str, &str)| self.captured.buffer::<u32>(keys)[..total].is_sorted();
        let (_, values) = pairs.iter().find(is_sorted).expect("one pair is sorted");
        let ids: Vec<u32> = self.captured.buffer(values);
        let ranges: Vec<[u32; 2]> = self.captured.buffer("ranges");
        let tiles = Tiling::of(self.camera.size_px).tiles();
        ranges[..tiles].iter().map(|[begin, end]| ids[*begin as usize..*end as usize].to_vec()).collect()
    }

    fn exact(&self, id: u32) -> &RaySplat {
        &self.exact.splats[self.exact.visible.binary_search(&id).expect("the reference sees it")]
    }
}

/// The directions along which s is 1 along one axis and 0 along the other.
fn steps(splat: &RaySplat) -> [DVec3; 2] {
    let [p1, p2] = splat.p;
    let inverse = DMat2::from_cols(DVec2::new(p1.dot(p1), p1.dot(p2)), DVec2::new(p1.dot(p2), p2.dot(p2))).inverse();
    [0, 1].map(|axis| inverse.col(axis).x * p1 + inverse.col(axis).y * p2)
}

#[test]
fn ray_splats_match_their_twins() {
    for case in &*CASES {
        let splats = case.splats();
        assert!(splats.len() > 30, "{}: {} splats", case.name, splats.len());
        let mut worst = [[0.0_f64; 4]; 2];
        for (id, splat) in splats {
            let exact = case.exact(id);
            let [u, v, q, centre, colour] =
                [splat.u, splat.v, splat.q, splat.centre, splat.colour].map(|of| DVec3::from(of.map(f64::from)));
            assert!(centre.distance(exact.centre) < 1e-6 * (1.0 + exact.centre.length()), "{}: {id}", case.name);
            // Of u and v, P^T P is known, times the half of log2 e.
            let half_log2_e = 0.5 * std::f64::consts::LOG2_E;
            let square = |a: DVec3, b: DVec3| (u.dot(a) * u.dot(b) + v.dot(a) * v.dot(b)) / half_log2_e;
            let [a, b] = steps(exact);
            let whitened = [square(a, a) - 1.0, square(a, b), square(b, b) - 1.0];
            let n = exact.centre * if exact.q == DVec3::Z { 0.0 } else { 1.0 };
            let along = square(n, n).sqrt() * a.length().max(b.length());
            // w changes by this much where s changes by 1.
            let slope = |d: DVec3| (q - exact.q).dot(d).abs() / (1.0 + exact.q.dot(d).abs());
            let (kappa, level) = (f64::from(splat.kappa) * half_log2_e, exact.level(RULES));
            let errors = [
                whitened.into_iter().map(f64::abs).fold(0.0, f64::max),
                along,
                slope(a).max(slope(b)).max((q - exact.q).dot(exact.centre).abs()),
                (kappa - exact.kappa).abs() * level / (1.0 + exact.kappa * level),
            ];
            let is_back = exact.centre.z < BACK;
            for (worst, error) in worst[usize::from(is_back)].iter_mut().zip(errors) {
                *worst = worst.max(error);
            }
            assert_eq!(f64::from(splat.opacity), exact.opacity);
            assert!((colour - exact.colour).abs().max_element() < 2e-6, "{}: {colour}, {}", case.name, exact.colour);
        }
        println!("{}: {worst:?}", case.name);
        for (worst, tolerance) in worst.into_iter().zip([TOLERANCE, BACK_TOLERANCE]) {
            assert!(worst.iter().all(|worst| *worst < tolerance), "{}: {worst:?}", case.name);
        }
    }
}

#[test]
fn ray_splats_are_sorted_by_the_depths_of_the_camera() {
    for case in &*CASES {
        let visible = case.visible();
        for list in case.lists() {
            let key = |splat: &u32| ((case.exact(visible[*splat as usize]).depth as f32).to_bits(), *splat);
            assert!(list.is_sorted_by_key(key), "{}: by (f32 depth, index)", case.name);
        }
    }
}

/// The tiles of every Gaussian that the reference sees at the centre of some pixel.
fn touched(case: &Case) -> Vec<(u32, u32)> {
    let [width, _] = case.camera.size_px;
    let columns = Tiling::of(case.camera.size_px).counts[0];
    let mut touched = Vec::new();
    for (pixel, ray) in case.exact.rays.iter().enumerate() {
        let Some(ray) = *ray else { continue };
        let tile = pixel as u32 / width / TILE * columns + pixel as u32 % width / TILE;
        let all = case.exact.visible.iter().zip(&case.exact.splats);
        let met = all.filter(|(_, splat)| splat.distance(ray) < splat.level(RULES) * (1.0 - 1e-4));
        touched.extend(met.map(|(id, _)| (*id, tile)));
    }
    touched.sort_unstable();
    touched.dedup();
    touched
}

#[test]
fn every_tile_that_a_ray_touches_is_listed_and_hardly_more() {
    for case in &*CASES {
        let (visible, lists) = (case.visible(), case.lists());
        assert!(visible.is_sorted(), "compaction keeps the order");
        let listed = lists.iter().zip(0..).flat_map(|(list, tile)| list.iter().map(move |splat| (*splat, tile)));
        let mut listed: Vec<(u32, u32)> = listed.map(|(splat, tile)| (visible[splat as usize], tile)).collect();
        listed.sort_unstable();
        assert!(listed.is_sorted_by(|a, b| a < b), "{}: no tile is listed twice", case.name);
        let touched = touched(case);
        let missing: Vec<_> = touched.iter().filter(|pair| listed.binary_search(pair).is_err()).collect();
        assert!(missing.is_empty(), "{}: Gaussians and tiles {missing:?} are missing", case.name);
        println!("{}: {} listed, {} touched of {}", case.name, listed.len(), touched.len(), case.gaussians.len());
        // Around a tile is a sphere, and Gaussians of less than a pixel lie between the centres of pixels.
        assert!(listed.len() <= touched.len() * 5 / 2, "{}: {} for {}", case.name, listed.len(), touched.len());

        let counts = case.tile_counts();
        let mut written = vec![0; counts.len()];
        lists.iter().flatten().for_each(|splat| written[*splat as usize] += 1);
        assert_eq!(written, counts, "{}: list writes what project counts", case.name);
        let totals = case.captured.frame.totals;
        assert_eq!((totals.listed_low, totals.listed_high), (counts.iter().sum(), 0));
    }
}

#[test]
fn lists_of_rays_are_blended_as_the_reference_blends_them() {
    for case in &*CASES {
        let pixels = reference::blend_rays(&case.exact, None, DVec3::ZERO, RULES);
        let rendering = reference::Rendering { size_px: case.camera.size_px, pixels };
        let comparison = compare(&case.captured.pixels, &rendering);
        println!("{}: {comparison:?}", case.name);
        assert!(comparison.unexplained == 0 && comparison.psnr > 90.0, "{}: {comparison:?}", case.name);
    }
}

#[test]
fn every_stage_along_rays_agrees_in_subgroups_of_four() {
    again_in_subgroups_of_four(&["rays::", "--skip", "fast_rays", "--skip", "arrays", "--skip", "subgroups_of_four"]);
}
