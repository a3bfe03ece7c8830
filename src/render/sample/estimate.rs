//! A stratified sample of patches, and the estimate of the squared error of a picture from it.
//!
//! The patches that pages touch are cut into strata along a Morton curve, with about as many pages in each, so that a
//! stratum is a connected part of the picture, and two patches of each stratum are drawn without replacement. The sum
//! over the picture and its variance follow for a stratum of M patches with the values x and y (Cochran, Sampling
//! Techniques, 1977, 5.3):
//!
//! > sum = M (x+y)/2, variance = M^2 (1 - 2/M) (x-y)^2 / 4.

use std::collections::HashMap;
use std::ops::Range;

use super::touched::Touched;
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

impl Stratum {
    /// The strata of patches along a curve, each with its weight, of which at most `count` are drawn, or all if there
    /// are not more. Strata have about the same weight, so that more is drawn where more may differ.
    fn all(patches: &[(u32, u32)], count: u32, random: &mut impl FnMut() -> u64) -> Vec<Self> {
        let count = count.max(2) as usize;
        let drawn = |strata: &[&[(u32, u32)]]| strata.iter().map(|stratum| stratum.len().min(2)).sum::<usize>();
        let cut = if patches.len() <= count {
            patches.chunks(1).collect()
        } else {
            let cuts = (1..=count).map(|strata| cut(patches, strata));
            cuts.take_while(|strata| drawn(strata) <= count).last().unwrap_or_default()
        };
        let stratum = |own: &[(u32, u32)]| {
            let first = random() as usize % own.len();
            let mut drawn = vec![own[first].0];
            if own.len() > 1 {
                drawn.push(own[(first + 1 + random() as usize % (own.len() - 1)) % own.len()].0);
            }
            Self { size: own.len() as u32, drawn }
        };
        cut.into_iter().map(stratum).collect()
    }
}

/// Cuts patches into at most so many parts of about the same weight.
fn cut(patches: &[(u32, u32)], parts: usize) -> Vec<&[(u32, u32)]> {
    let mut left = patches.iter().map(|(_, weight)| u64::from(*weight)).sum::<u64>();
    let (mut rest, mut found) = (patches, Vec::new());
    while !rest.is_empty() {
        let (target, mut sum) = (left.div_ceil((parts - found.len()).max(1) as u64), 0);
        let end = rest.iter().position(|(_, weight)| {
            sum += u64::from(*weight);
            sum >= target
        });
        let (part, behind) = rest.split_at(end.map_or(rest.len(), |end| end + 1));
        found.push(part);
        (rest, left) = (behind, left - sum);
    }
    found
}

impl Sample {
    /// About `count` of the touched patches of the picture of a camera, at least two, or all if there are not more. An
    /// eighth of them are of those that only nodes touch, which hardly differ. They are random, and follow from the
    /// camera and from `touched`.
    pub fn of(camera: &Camera, touched: &Touched, count: u32) -> Self {
        let mut random = random_numbers(camera);
        let Touched { by_gaussians, by_nodes } = touched;
        let of_nodes = (count / 8).max(2).min(by_nodes.len() as u32);
        let of_gaussians = count.saturating_sub(of_nodes).max(2);
        let mut strata = Vec::new();
        for (patches, count) in [(by_gaussians, of_gaussians), (by_nodes, of_nodes)] {
            strata.extend(Stratum::all(&in_morton_order(camera.size_px, patches.clone()), count, &mut random));
        }
        Self { size_px: camera.size_px, strata }
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
            patches: [
                errors.iter().map(|values| values.len() as u32).sum(),
                self.strata.iter().map(|stratum| stratum.size).sum(),
            ],
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

/// Patches of a picture, with their weights, along a Morton curve.
fn in_morton_order(size_px: [u32; 2], mut patches: Vec<(u32, u32)>) -> Vec<(u32, u32)> {
    let [columns, _] = Patches::grid(size_px);
    let spread = |side: u32| (0..16).fold(0_u64, |bits, bit| bits | u64::from(side >> bit & 1) << (2 * bit));
    patches.sort_unstable_by_key(|(patch, _)| spread(patch % columns) | spread(patch / columns) << 1);
    patches
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

    /// A sample of all patches.
    fn of_all(camera: &Camera, count: u32) -> Sample {
        let by_gaussians = (0..Patches::number_in(camera.size_px)).map(|patch| (patch, 1)).collect();
        Sample::of(camera, &Touched { by_gaussians, by_nodes: Vec::new() }, count)
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
        let sample = of_all(&camera(0, [200, 130]), 12);
        let estimate = estimate(&sample, |x, _| if x < 100 { 0.5 } else { 0.0 });
        assert!((estimate.mse - 0.25 / 6.0).abs() < 1e-12, "alpha does not count: {estimate:?}");
        assert_eq!((estimate.standard_error, estimate.patches), (0.0, [12, 12]));
    }

    #[test]
    fn patches_that_nothing_touches_are_not_drawn_and_have_no_error() {
        let touched = Touched {
            by_gaussians: [3, 4, 17, 18].map(|patch| (patch, 9)).to_vec(),
            by_nodes: [5, 6, 7].map(|patch| (patch, 1)).to_vec(),
        };
        let sample = Sample::of(&camera(0, [640, 480]), &touched, 64);
        assert_eq!(Vec::from_iter(sample.patches(0..sample.strata()).numbers()), [3, 4, 5, 6, 7, 17, 18]);
        let estimate = estimate(&sample, |_, _| 0.5);
        assert!((estimate.mse - 0.25 * 7.0 * 4096.0 / (3.0 * 640.0 * 480.0)).abs() < 1e-12, "{estimate:?}");
        assert_eq!((estimate.standard_error, estimate.patches), (0.0, [7, 7]));
        // Those that Gaussians touch are drawn first.
        let few = Sample::of(&camera(0, [640, 480]), &touched, 6);
        let numbers = Vec::from_iter(few.patches(0..few.strata()).numbers());
        assert!(numbers.len() == 6 && [3, 4, 17, 18].iter().all(|patch| numbers.contains(patch)), "{numbers:?}");
        let nothing = Touched { by_gaussians: Vec::new(), by_nodes: Vec::new() };
        let nothing = Sample::of(&camera(0, [640, 480]), &nothing, 64);
        assert_eq!((nothing.strata(), nothing.estimate(&[]).mse), (0, 0.0));
    }

    #[test]
    fn strata_have_about_the_same_weight() {
        let weights = [1, 1, 1, 1, 9, 1, 1, 1, 1, 1, 9, 9, 1, 1];
        let patches: Vec<(u32, u32)> = (0..).zip(weights).collect();
        for parts in 1..=14 {
            let cut = cut(&patches, parts);
            assert!(cut.len() <= parts && cut.concat() == patches, "{parts}: {cut:?}");
        }
        let sizes = Vec::from_iter(cut(&patches, 4).iter().map(|part| part.len()));
        assert_eq!(sizes, [5, 6, 1, 2]);
        let all = Stratum::all(&patches, 14, &mut || 0);
        assert_eq!(all.iter().map(|stratum| stratum.drawn.len()).sum::<usize>(), 14);
    }

    #[test]
    fn patches_are_distinct_and_follow_from_the_camera() {
        let size = [1920, 1080];
        for (count, drawn) in [(1, 2), (2, 2), (3, 2), (16, 16), (64, 64), (510, 510), (10_000, 510)] {
            let sample = of_all(&camera(1, size), count);
            assert_eq!(sample.patches(0..sample.strata()).numbers().count(), drawn, "of {count}");
            assert_eq!(sample, of_all(&camera(1, size), count));
            assert_eq!(sample.strata.iter().map(|stratum| stratum.size).sum::<u32>(), 510);
        }
        assert_ne!(of_all(&camera(1, [640, 480]), 8), of_all(&camera(2, [640, 480]), 8));
    }

    /// Over many samples, the mean of the estimates is the truth, and their spread is the standard error.
    #[test]
    fn estimates_are_unbiased_and_their_standard_errors_are_true() {
        let size = [1280, 720];
        let error = |x: u32, y: u32| (x as f32 / 1280.0).powi(2) * if y % 200 < 100 { 0.5 } else { 0.1 };
        let truth = estimate(&of_all(&camera(0, size), u32::MAX), error).mse;
        let runs = 400;
        let estimates: Vec<_> = (0..runs).map(|number| estimate(&of_all(&camera(number, size), 40), error)).collect();
        let mean = |of: &dyn Fn(&SampledPsnr) -> f64| estimates.iter().map(of).sum::<f64>() / f64::from(runs);
        let spread = mean(&|estimate| (estimate.mse - truth).powi(2)).sqrt();
        let bias = mean(&|estimate| estimate.mse) - truth;
        assert!(bias.abs() < 3.0 * spread / f64::from(runs).sqrt(), "bias {bias}, spread {spread}");
        let claimed = mean(&|estimate| estimate.standard_error.powi(2)).sqrt();
        assert!((claimed / spread - 1.0).abs() < 0.15, "claimed {claimed}, spread {spread}");
    }
}
