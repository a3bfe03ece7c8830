//! All difference measures of two images together.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::errors::{changed8, fraction_over, largest_step, max_error, mse, non_finite};
use super::flip::{Flip, PIXELS_PER_DEGREE, flip};
use super::ssim::ssim;
use crate::pixels::Pixels;

/// The difference of two images. Colours are compared, alpha is ignored. If either image has a pixel that is not
/// finite, max_error, mse, psnr_db, ssim and flip have their worst values: the largest 32-bit float, its square, the
/// PSNR of that,
/// -1 and 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Difference {
    /// Largest absolute difference of a colour value. White is 1, and nothing is clamped.
    pub max_error: f32,
    /// Mean squared difference of the colour values, not clamped.
    pub mse: f64,
    /// Peak signal-to-noise ratio in dB for a peak of 1, not clamped; null if the images are equal.
    pub psnr_db: Option<f64>,
    /// Mean structural similarity of the channels, which are clamped to 0 and 1; null if a side is shorter than 11
    /// pixels.
    pub ssim: Option<f64>,
    /// Mean LDR-FLIP of the images clamped to 0 and 1: 0 for equal images, at most 1.
    pub flip: f64,
    pub over: Over,
    /// Fraction of the colour values that differ in 8 bits.
    pub changed8: f64,
    /// Largest difference of a colour value in 8 bits, in steps.
    pub largest_step: u8,
    /// Number of pixels with an infinite or NaN colour value in either image.
    pub non_finite: u64,
}

/// Fractions of the pixels whose largest channel difference exceeds 1, 4 and 16 steps of 1/255.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Over {
    pub steps_1: f64,
    pub steps_4: f64,
    pub steps_16: f64,
}

impl Difference {
    /// Measures the difference of two images, with FLIP at [`PIXELS_PER_DEGREE`].
    ///
    /// # Panics
    /// If the images differ in size.
    pub fn between(a: &Pixels, b: &Pixels) -> Self {
        Self::with_flip(a, b, &flip(a, b, PIXELS_PER_DEGREE))
    }

    /// As [`Difference::between`], with the [`Flip`] of these images computed before.
    ///
    /// # Panics
    /// If the images differ in size.
    pub fn with_flip(a: &Pixels, b: &Pixels, flip: &Flip) -> Self {
        let (largest, non_finite) = (f64::from(f32::MAX), non_finite(a, b));
        let is_finite = non_finite == 0;
        let mse = if is_finite { mse(a, b) } else { largest * largest };
        Self {
            // The difference of finite values may overflow; JSON has no infinity.
            max_error: if is_finite { max_error(a, b).min(f32::MAX) } else { f32::MAX },
            mse,
            psnr_db: (mse > 0.0).then(|| -10.0 * mse.log10()),
            ssim: ssim(a, b).map(|ssim| if is_finite { ssim } else { -1.0 }),
            flip: if is_finite { flip.mean } else { 1.0 },
            over: Over::of(a, b),
            changed8: changed8(a, b),
            largest_step: largest_step(a, b),
            non_finite,
        }
    }

    /// The worst value of each measure; `None` without differences.
    pub fn worst<'a>(all: impl IntoIterator<Item = &'a Self>) -> Option<Self> {
        all.into_iter().cloned().reduce(|x, y| Self {
            max_error: x.max_error.max(y.max_error),
            mse: x.mse.max(y.mse),
            psnr_db: least(x.psnr_db, y.psnr_db),
            ssim: least(x.ssim, y.ssim),
            flip: x.flip.max(y.flip),
            over: Over {
                steps_1: x.over.steps_1.max(y.over.steps_1),
                steps_4: x.over.steps_4.max(y.over.steps_4),
                steps_16: x.over.steps_16.max(y.over.steps_16),
            },
            changed8: x.changed8.max(y.changed8),
            largest_step: x.largest_step.max(y.largest_step),
            non_finite: x.non_finite.max(y.non_finite),
        })
    }
}

/// The smaller of two values, or the only one.
fn least(x: Option<f64>, y: Option<f64>) -> Option<f64> {
    x.into_iter().chain(y).reduce(f64::min)
}

/// The difference of two 8-bit values in f32 is a multiple of 1/255 only up to this rounding error.
const ROUNDING: f32 = 1e-6;

impl Over {
    fn of(a: &Pixels, b: &Pixels) -> Self {
        let over = |steps: f32| fraction_over(a, b, steps / 255.0 + ROUNDING);
        Self { steps_1: over(1.0), steps_4: over(4.0), steps_16: over(16.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::metrics::samples::{blocks, noise, noisy};

    fn grey(values: &[f32]) -> Pixels {
        Pixels { size: [values.len() as u32, 1], rgba: values.iter().map(|v| [*v, *v, *v, 1.0]).collect() }
    }

    #[test]
    fn difference_of_equal_images_is_zero() {
        let found = Difference::between(&noise(1), &noise(1));
        let over = Over { steps_1: 0.0, steps_4: 0.0, steps_16: 0.0 };
        let expected = Difference {
            max_error: 0.0,
            mse: 0.0,
            psnr_db: None,
            ssim: Some(1.0),
            flip: 0.0,
            over,
            changed8: 0.0,
            largest_step: 0,
            non_finite: 0,
        };
        assert_eq!(found, expected);
    }

    #[test]
    fn difference_holds_the_values_of_the_measures() {
        let (a, b) = (blocks(1), noisy(&blocks(1)));
        let found = Difference::between(&a, &b);
        // Computed with NumPy in f64 from the same images.
        assert!((found.mse - 0.002730928481).abs() < 1e-9 && (found.psnr_db.unwrap() - 25.636896733).abs() < 1e-5);
        assert_eq!((found.ssim, found.max_error), (ssim(&a, &b), max_error(&a, &b)));
        assert_eq!(found.flip, flip(&a, &b, 67.0).mean);
        assert!(found.over.steps_1 > found.over.steps_4 && found.over.steps_4 > found.over.steps_16);
        assert_eq!(found.largest_step, (found.max_error * 255.0).round() as u8);
    }

    #[test]
    fn difference_of_whole_steps_does_not_depend_on_rounding() {
        for steps in [1, 4, 16] {
            let apart = |by: i32| {
                let values = |from: i32| (from..from + 239).map(|v| v as f32 / 255.0).collect::<Vec<_>>();
                Over::of(&grey(&values(0)), &grey(&values(by)))
            };
            let of = |over: Over| [(1, over.steps_1), (4, over.steps_4), (16, over.steps_16)];
            let fraction = |over: Over| of(over).into_iter().find(|(s, _)| *s == steps).map(|(_, f)| f);
            assert_eq!(fraction(apart(steps)), Some(0.0), "{steps}");
            assert_eq!(fraction(apart(steps + 1)), Some(1.0), "{steps}");
        }
    }

    #[test]
    fn difference_with_a_pixel_that_is_not_finite_is_the_worst() {
        for value in [f32::NAN, f32::INFINITY] {
            let mut bad = noise(1);
            bad.rgba[5][2] = value;
            // Also if both images are the same.
            for other in [&noise(1), &bad] {
                let found = Difference::between(&bad, other);
                assert_eq!(found.non_finite, 1);
                assert_eq!((found.max_error, found.flip, found.ssim), (f32::MAX, 1.0, Some(-1.0)));
                assert!(found.psnr_db < Some(-700.0));
                let back: Difference = serde_json::from_str(&serde_json::to_string(&found).unwrap()).unwrap();
                assert_eq!((back.max_error, back.non_finite), (f32::MAX, 1));
            }
        }
        let far = Difference::between(&grey(&[f32::MAX]), &grey(&[f32::MIN]));
        assert_eq!((far.max_error, far.non_finite, far.ssim), (f32::MAX, 0, None));
    }

    #[test]
    fn the_worst_is_taken_measure_by_measure() {
        let (same, other) = (Difference::between(&noise(1), &noise(1)), Difference::between(&noise(2), &noise(3)));
        assert_eq!(Difference::worst([&same, &other]), Some(other.clone()));
        assert_eq!(Difference::worst([&other, &same]), Some(other));
        assert_eq!(Difference::worst([]), None);
    }
}
