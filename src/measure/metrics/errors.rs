//! Measures of single colour values and pixels.

use rayon::prelude::*;

use super::{by_row, check_sizes, is_finite};
use crate::pixels::{Pixels, to_byte};

/// Largest absolute difference of any colour channel of any pixel; infinite if either value is NaN.
pub fn max_error(a: &Pixels, b: &Pixels) -> f32 {
    pairs(a, b).map(|(p, q)| largest(p, q)).reduce(|| 0.0, f32::max)
}

/// Mean squared difference of the colour channels, which are not clamped.
pub fn mse(a: &Pixels, b: &Pixels) -> f64 {
    check_sizes(a, b);
    let width = a.size[0] as usize;
    let rows = by_row(0..a.size[1] as usize, |y| {
        let row = y * width..(y + 1) * width;
        let pixels = a.rgba[row.clone()].iter().zip(&b.rgba[row]);
        let square = |(x, y): (f32, f32)| (f64::from(x) - f64::from(y)).powi(2);
        pixels.flat_map(|(p, q)| channels(p, q)).map(square).sum::<f64>()
    });
    rows.iter().sum::<f64>() / (a.rgba.len() * 3) as f64
}

/// Peak signal-to-noise ratio of the colour channels in dB for a peak of 1; the channels are not clamped. Infinite for
/// equal images.
pub fn psnr(a: &Pixels, b: &Pixels) -> f64 {
    -10.0 * mse(a, b).log10()
}

/// Fraction of the pixels whose largest channel difference exceeds the threshold. NaN exceeds every threshold.
pub fn fraction_over(a: &Pixels, b: &Pixels, threshold: f32) -> f64 {
    let count = pairs(a, b).filter(|(p, q)| largest(p, q) > threshold).count();
    count as f64 / a.rgba.len() as f64
}

/// Fraction of the colour values that differ in 8 bits.
pub fn changed8(a: &Pixels, b: &Pixels) -> f64 {
    let count: usize = pairs(a, b).map(|(p, q)| steps(p, q).filter(|step| *step > 0).count()).sum();
    count as f64 / (a.rgba.len() * 3) as f64
}

/// The largest difference of a colour value in 8 bits.
pub fn largest_step(a: &Pixels, b: &Pixels) -> u8 {
    pairs(a, b).filter_map(|(p, q)| steps(p, q).max()).max().unwrap_or(0)
}

/// Number of pixels with an infinite or NaN colour value in either image.
pub fn non_finite(a: &Pixels, b: &Pixels) -> u64 {
    pairs(a, b).filter(|(p, q)| !is_finite(p) || !is_finite(q)).count() as u64
}

fn pairs<'a>(a: &'a Pixels, b: &'a Pixels) -> impl ParallelIterator<Item = (&'a [f32; 4], &'a [f32; 4])> {
    check_sizes(a, b);
    a.rgba.par_iter().zip(&b.rgba)
}

fn channels(p: &[f32; 4], q: &[f32; 4]) -> impl Iterator<Item = (f32, f32)> {
    [(p[0], q[0]), (p[1], q[1]), (p[2], q[2])].into_iter()
}

/// Largest difference of a channel; infinite for NaN.
fn largest(p: &[f32; 4], q: &[f32; 4]) -> f32 {
    let difference = |(x, y): (f32, f32)| if x == y { 0.0 } else { (x - y).abs() };
    let worse = |most: f32, d: f32| if d.is_nan() { f32::INFINITY } else { most.max(d) };
    channels(p, q).map(difference).fold(0.0, worse)
}

/// Differences of the channels in 8 bits.
fn steps(p: &[f32; 4], q: &[f32; 4]) -> impl Iterator<Item = u8> {
    channels(p, q).map(|(x, y)| to_byte(x).abs_diff(to_byte(y)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(values: &[f32]) -> Pixels {
        Pixels { size: [values.len() as u32, 1], rgba: values.iter().map(|v| [*v, *v, *v, 1.0]).collect() }
    }

    #[test]
    fn psnr_of_a_constant_difference_is_its_logarithm() {
        let (a, b) = (grey(&[0.5, 0.25]), grey(&[0.6, 0.35]));
        assert!((psnr(&a, &b) - 20.0).abs() < 1e-5);
        assert!((mse(&a, &b) - 0.01).abs() < 1e-8);
        assert_eq!(psnr(&a, &a), f64::INFINITY);
        assert_eq!(mse(&grey(&[3.0]), &grey(&[-1.0])), 16.0, "values are not clamped");
        assert!(mse(&grey(&[f32::NAN]), &grey(&[0.5])).is_nan());
    }

    #[test]
    fn max_error_sees_a_single_bad_value() {
        assert_eq!(max_error(&grey(&[0.5, 0.25]), &grey(&[0.5, 0.75])), 0.5);
        assert_eq!(max_error(&grey(&[f32::NAN]), &grey(&[0.5])), f32::INFINITY);
        assert_eq!(max_error(&grey(&[0.5]), &grey(&[0.5])), 0.0);
    }

    #[test]
    fn fractions_count_pixels_and_values() {
        let (a, mut b) = (grey(&[0.0, 0.25, 0.5, f32::NAN]), grey(&[0.0, 0.25, 0.75, 0.0]));
        b.rgba[0][1] = 0.5;
        assert_eq!(fraction_over(&a, &b, 0.2), 0.75);
        assert_eq!(fraction_over(&a, &b, 0.25), 0.5, "a difference equal to the threshold does not exceed it");
        // One value of the first pixel and three of the third differ; NaN is 0 in 8 bits.
        assert_eq!(changed8(&a, &b), 4.0 / 12.0);
        assert_eq!(largest_step(&a, &b), 128);
        assert_eq!(non_finite(&a, &b), 1);
    }

    #[test]
    fn alpha_is_ignored() {
        let (a, mut b) = (grey(&[0.5]), grey(&[0.5]));
        b.rgba[0][3] = f32::NAN;
        assert_eq!((max_error(&a, &b), mse(&a, &b), non_finite(&a, &b)), (0.0, 0.0, 0));
    }
}
