//! A stratified sample of patches, and the estimate of the squared error of a picture from it.
//!
//! The patches of a picture are cut into strata of equal size along a Morton curve, so that a stratum is a connected
//! part of the picture, and two patches of each stratum are drawn without replacement. The sum over the picture and its
//! variance follow for a stratum of M patches with the values x and y (Cochran, Sampling Techniques, 1977, 5.3):
//!
//! > sum = M (x+y)/2, variance = M^2 (1 - 2/M) (x-y)^2 / 4.

use std::collections::HashMap;
use std::ops::Range;

use crate::camera::Camera;
use crate::render::lod::SampledPsnr;
use crate::render::patches::Patches;

/// The patches of a picture that a sample draws.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    size_px: [u32; 2],
    strata: Vec<Stratum>,
}

/// A part of a picture, of which one or two patches are drawn.
#[derive(Clone, Debug, PartialEq)]
struct Stratum {
    /// The number of its patches.
    size: u32,
    drawn: Vec<u32>,
}

impl Sample {
    /// About `count` patches of the picture of a camera, at least two, or all if there are not more. They are random,
    /// and follow from the camera alone.
    pub fn of(camera: &Camera, count: u32) -> Self {
        let all = in_morton_order(camera.size_px);
        let strata = if count as usize >= all.len() { all.len() } else { (count / 2).max(1) as usize };
        let mut random = random_numbers(camera);
        let stratum = |number: usize| {
            let patches = &all[number * all.len() / strata..(number + 1) * all.len() / strata];
            let first = random() as usize % patches.len();
            let mut drawn = vec![patches[first]];
            if patches.len() > 1 {
                let second = (first + 1 + random() as usize % (patches.len() - 1)) % patches.len();
                drawn.push(patches[second]);
            }
            Stratum { size: patches.len() as u32, drawn }
        };
        Self { size_px: camera.size_px, strata: (0..strata).map(stratum).collect() }
    }

    /// The number of strata.
    pub fn strata(&self) -> usize {
        self.strata.len()
    }

    /// The patches of some strata.
    pub fn patches(&self, strata: Range<usize>) -> Patches {
        Patches::of(self.size_px, self.strata[strata].iter().flat_map(|stratum| stratum.drawn.clone()).collect())
    }

    /// The squared errors of the patches of each of some strata, from the pixels of these patches in both pictures as
    /// [`Commands::read_rectangles`](crate::gpu::Commands) reads them.
    pub fn errors(&self, strata: Range<usize>, shown: &[[f32; 4]], exact: &[[f32; 4]]) -> Vec<Vec<f64>> {
        let (patches, mut begin) = (self.patches(strata.clone()), 0);
        let of_patch = |(number, [.., width, height]): (u32, [u32; 4])| {
            let pixels = begin..begin + width as usize * height as usize;
            begin = pixels.end;
            (number, squared_error(&shown[pixels.clone()], &exact[pixels]))
        };
        let errors: HashMap<u32, f64> = patches.numbers().zip(patches.rectangles()).map(of_patch).collect();
        let of_stratum = |stratum: &Stratum| stratum.drawn.iter().map(|patch| errors[patch]).collect();
        self.strata[strata].iter().map(of_stratum).collect()
    }

    /// The estimate from the squared errors of the patches of all strata.
    pub fn estimate(&self, errors: &[Vec<f64>]) -> SampledPsnr {
        let (mut sum, mut variance) = (0.0, 0.0);
        for (values, Stratum { size, .. }) in errors.iter().zip(&self.strata) {
            let size = f64::from(*size);
            sum += size * values.iter().sum::<f64>() / values.len() as f64;
            if let [x, y] = values[..] {
                variance += size * (size - 2.0) * (x - y).powi(2) / 4.0;
            }
        }
        let numbers = 3.0 * self.size_px.iter().map(|side| f64::from(*side)).product::<f64>();
        SampledPsnr {
            mse: sum / numbers,
            standard_error: variance.sqrt() / numbers,
            patches: [errors.iter().map(|values| values.len() as u32).sum(), Patches::number_in(self.size_px)],
        }
    }
}

/// The sum of the squared differences of the colour values.
fn squared_error(a: &[[f32; 4]], b: &[[f32; 4]]) -> f64 {
    let of_pixel = |(a, b): (&[f32; 4], &[f32; 4])| {
        (0..3).map(|channel| (f64::from(a[channel]) - f64::from(b[channel])).powi(2)).sum::<f64>()
    };
    a.iter().zip(b).map(of_pixel).sum()
}

/// The numbers of all patches of a picture along a Morton curve.
fn in_morton_order(size_px: [u32; 2]) -> Vec<u32> {
    let [columns, rows] = Patches::grid(size_px);
    let spread = |side: u32| (0..16).fold(0_u64, |bits, bit| bits | u64::from(side >> bit & 1) << (2 * bit));
    let mut all = Vec::from_iter(0..columns * rows);
    all.sort_unstable_by_key(|patch| spread(patch % columns) | spread(patch / columns) << 1);
    all
}

/// Random numbers that follow from a camera.
fn random_numbers(camera: &Camera) -> impl FnMut() -> u64 {
    let mut hasher = blake3::Hasher::new();
    let Camera { position, rotation, focal_px, centre_px, size_px, .. } = camera;
    let vectors = [position.to_array().to_vec(), rotation.to_cols_array().to_vec()];
    let pixels = [focal_px.to_array(), centre_px.to_array()].concat();
    vectors.concat().iter().chain(&pixels).for_each(|number| _ = hasher.update(&number.to_le_bytes()));
    size_px.iter().for_each(|side| _ = hasher.update(&side.to_le_bytes()));
    let mut stream = hasher.finalize_xof();
    move || {
        let mut bytes = [0; 8];
        stream.fill(&mut bytes);
        u64::from_le_bytes(bytes)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn camera(number: u32, size_px: [u32; 2]) -> Camera {
        Camera::looking_at(DVec3::new(f64::from(number), 1.0, -3.0), DVec3::ZERO, size_px, 1.0)
    }

    /// The estimate of pictures that differ by `error` of each pixel.
    fn estimate(sample: &Sample, error: impl Fn(u32, u32) -> f32) -> SampledPsnr {
        let all = 0..sample.strata();
        let mut shown = Vec::new();
        for [left, top, width, height] in sample.patches(all.clone()).rectangles() {
            for (x, y) in (top..top + height).flat_map(|y| (left..left + width).map(move |x| (x, y))) {
                shown.push([error(x, y), 0.0, 0.0, 1.0]);
            }
        }
        let exact = vec![[0.0, 0.0, 0.0, 0.5]; shown.len()];
        sample.estimate(&sample.errors(all, &shown, &exact))
    }

    #[test]
    fn a_sample_of_all_patches_measures_the_error() {
        let sample = Sample::of(&camera(0, [200, 130]), 12);
        let estimate = estimate(&sample, |x, _| if x < 100 { 0.5 } else { 0.0 });
        assert!((estimate.mse - 0.25 / 6.0).abs() < 1e-12, "alpha does not count: {estimate:?}");
        assert_eq!((estimate.standard_error, estimate.patches), (0.0, [12, 12]));
    }

    #[test]
    fn patches_are_distinct_and_follow_from_the_camera() {
        let size = [1920, 1080];
        for (count, drawn) in [(1, 2), (2, 2), (3, 2), (16, 16), (64, 64), (509, 508), (510, 510), (10_000, 510)] {
            let sample = Sample::of(&camera(1, size), count);
            assert_eq!(sample.patches(0..sample.strata()).numbers().count(), drawn, "of {count}");
            assert_eq!(sample, Sample::of(&camera(1, size), count));
            assert_eq!(sample.strata.iter().map(|stratum| stratum.size).sum::<u32>(), 510);
        }
        assert_ne!(Sample::of(&camera(1, [640, 480]), 8), Sample::of(&camera(2, [640, 480]), 8));
    }

    /// Over many samples, the mean of the estimates is the truth, and their spread is the standard error.
    #[test]
    fn estimates_are_unbiased_and_their_standard_errors_are_true() {
        let size = [1280, 720];
        let error = |x: u32, y: u32| (x as f32 / 1280.0).powi(2) * if y % 200 < 100 { 0.5 } else { 0.1 };
        let truth = estimate(&Sample::of(&camera(0, size), u32::MAX), error).mse;
        let runs = 400;
        let estimates: Vec<_> =
            (0..runs).map(|number| estimate(&Sample::of(&camera(number, size), 40), error)).collect();
        let mean = |of: &dyn Fn(&SampledPsnr) -> f64| estimates.iter().map(of).sum::<f64>() / f64::from(runs);
        let spread = mean(&|estimate| (estimate.mse - truth).powi(2)).sqrt();
        let bias = mean(&|estimate| estimate.mse) - truth;
        assert!(bias.abs() < 3.0 * spread / f64::from(runs).sqrt(), "bias {bias}, spread {spread}");
        let claimed = mean(&|estimate| estimate.standard_error.powi(2)).sqrt();
        assert!((claimed / spread - 1.0).abs() < 0.15, "claimed {claimed}, spread {spread}");
    }
}
