//! The difference of images that hold one number per pixel, such as depths, and the difference of coverage.

use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{by_row, check_sizes};
use crate::pixels::Pixels;

/// The difference of two images of one number per pixel, such as depths in world units. Nothing is clamped. The
/// relative error of x and y is |x - y| / max(|x|, |y|). Errors are those of pixels with a finite number in both
/// images.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NumberDifference {
    /// Largest absolute error.
    pub max_error: f64,
    /// Mean absolute error.
    pub mean_error: f64,
    /// Largest relative error.
    pub max_relative: f64,
    /// Mean relative error.
    pub mean_relative: f64,
    pub over: OverRelative,
    /// Number of pixels that have a number in only one image, or that are infinite in only one.
    pub unmatched: u64,
}

/// Fractions of all pixels that are unmatched or whose relative error exceeds 0.1 %, 1 % and 10 %.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OverRelative {
    pub permille_1: f64,
    pub percent_1: f64,
    pub percent_10: f64,
}

/// The difference of the coverage (alpha) of two images.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AlphaDifference {
    /// Largest absolute error. Full coverage is 1.
    pub max_error: f64,
    /// Mean absolute error.
    pub mean_error: f64,
}

/// The number of a pixel of a grey image; `None` where the file has NaN.
fn number(pixel: &[f32; 4]) -> Option<f64> {
    (pixel[3] > 0.0).then_some(f64::from(pixel[0]))
}

/// Absolute and relative error of a pixel. `None` if it is unmatched.
fn errors(a: &[f32; 4], b: &[f32; 4]) -> Option<[f64; 2]> {
    match (number(a), number(b)) {
        (None, None) => Some([0.0; 2]),
        (Some(x), Some(y)) if x == y => Some([0.0; 2]),
        (Some(x), Some(y)) if x.is_finite() && y.is_finite() => {
            let error = (x - y).abs();
            Some([error, error / x.abs().max(y.abs())])
        }
        _ => None,
    }
}

/// The relative error of every pixel, row-major; infinite where only one image has a number.
///
/// # Panics
/// If the images differ in size.
pub fn relative_errors(a: &Pixels, b: &Pixels) -> Vec<f32> {
    check_sizes(a, b);
    let pixels = a.rgba.par_iter().zip(&b.rgba);
    pixels.map(|(p, q)| errors(p, q).map_or(f32::INFINITY, |[_, relative]| relative as f32)).collect()
}

/// Sums and largest values over some pixels.
#[derive(Clone, Copy, Default)]
struct Tally {
    largest: [f64; 2],
    sums: [f64; 2],
    matched: u64,
    unmatched: u64,
    over: [u64; 3],
}

impl Tally {
    fn with(mut self, errors: Option<[f64; 2]>) -> Self {
        match errors {
            Some(errors) => {
                for (i, error) in errors.into_iter().enumerate() {
                    self.largest[i] = self.largest[i].max(error);
                    self.sums[i] += error;
                }
                self.matched += 1;
            }
            None => self.unmatched += 1,
        }
        for (count, limit) in self.over.iter_mut().zip([1e-3, 1e-2, 1e-1]) {
            *count += u64::from(errors.is_none_or(|[_, relative]| relative > limit));
        }
        self
    }

    fn and(self, other: Self) -> Self {
        Self {
            largest: [0, 1].map(|i| self.largest[i].max(other.largest[i])),
            sums: [0, 1].map(|i| self.sums[i] + other.sums[i]),
            matched: self.matched + other.matched,
            unmatched: self.unmatched + other.unmatched,
            over: [0, 1, 2].map(|i| self.over[i] + other.over[i]),
        }
    }

    /// Over all pixels of two images.
    fn of(a: &Pixels, b: &Pixels, errors: impl Fn(&[f32; 4], &[f32; 4]) -> Option<[f64; 2]> + Sync + Send) -> Self {
        check_sizes(a, b);
        let width = a.size[0] as usize;
        let rows = by_row(0..a.size[1] as usize, |y| {
            let row = y * width..(y + 1) * width;
            let pixels = a.rgba[row.clone()].iter().zip(&b.rgba[row]);
            pixels.fold(Self::default(), |tally, (p, q)| tally.with(errors(p, q)))
        });
        rows.into_iter().fold(Self::default(), Self::and)
    }

    fn means(&self) -> [f64; 2] {
        self.sums.map(|sum| sum / self.matched.max(1) as f64)
    }
}

impl NumberDifference {
    /// Measures the difference of two grey images, whose pixels without a number have coverage 0.
    ///
    /// # Panics
    /// If the images differ in size.
    pub fn between(a: &Pixels, b: &Pixels) -> Self {
        let tally = Tally::of(a, b, errors);
        let ([max_error, max_relative], [mean_error, mean_relative]) = (tally.largest, tally.means());
        let [permille_1, percent_1, percent_10] = tally.over.map(|count| count as f64 / a.rgba.len() as f64);
        let over = OverRelative { permille_1, percent_1, percent_10 };
        Self { max_error, mean_error, max_relative, mean_relative, over, unmatched: tally.unmatched }
    }

    /// The worst value of each measure; `None` without differences.
    pub fn worst<'a>(all: impl IntoIterator<Item = &'a Self>) -> Option<Self> {
        all.into_iter().cloned().reduce(|x, y| Self {
            max_error: x.max_error.max(y.max_error),
            mean_error: x.mean_error.max(y.mean_error),
            max_relative: x.max_relative.max(y.max_relative),
            mean_relative: x.mean_relative.max(y.mean_relative),
            over: OverRelative {
                permille_1: x.over.permille_1.max(y.over.permille_1),
                percent_1: x.over.percent_1.max(y.over.percent_1),
                percent_10: x.over.percent_10.max(y.over.percent_10),
            },
            unmatched: x.unmatched.max(y.unmatched),
        })
    }
}

impl AlphaDifference {
    /// Measures the difference of coverage. NaN counts as 0.
    ///
    /// # Panics
    /// If the images differ in size.
    pub fn between(a: &Pixels, b: &Pixels) -> Self {
        let coverage = |p: &[f32; 4]| if p[3].is_nan() { 0.0 } else { f64::from(p[3]) };
        let tally = Tally::of(a, b, |p, q| Some([(coverage(p) - coverage(q)).abs(); 2]));
        // JSON has no infinity.
        let [max_error, mean_error] = [tally.largest[0], tally.means()[0]].map(|error| error.min(f64::from(f32::MAX)));
        Self { max_error, mean_error }
    }

    /// The worst value of each measure; `None` without differences.
    pub fn worst(all: impl IntoIterator<Item = Self>) -> Option<Self> {
        all.into_iter()
            .reduce(|x, y| Self { max_error: x.max_error.max(y.max_error), mean_error: x.mean_error.max(y.mean_error) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A row of these numbers; NaN as the readers of files leave it.
    fn row(values: &[f32]) -> Pixels {
        let pixel = |v: &f32| if v.is_nan() { [0.0; 4] } else { [*v, *v, *v, 1.0] };
        Pixels { size: [values.len() as u32, 1], rgba: values.iter().map(pixel).collect() }
    }

    #[test]
    fn numbers_have_absolute_and_relative_errors() {
        let found = NumberDifference::between(&row(&[5.0, 1.0, 100.0, 0.0]), &row(&[7.0, 1.0, 100.5, 0.0]));
        assert_eq!((found.max_error, found.mean_error), (2.0, 2.5 / 4.0));
        assert!((found.max_relative - 2.0 / 7.0).abs() < 1e-15);
        assert!((found.mean_relative - (2.0 / 7.0 + 0.5 / 100.5) / 4.0).abs() < 1e-15);
        assert_eq!(found.over, OverRelative { permille_1: 0.5, percent_1: 0.25, percent_10: 0.25 });
        assert_eq!(found.unmatched, 0);
    }

    #[test]
    fn a_number_in_only_one_image_is_unmatched() {
        let infinite = f32::INFINITY;
        let (a, b) = (
            row(&[f32::NAN, f32::NAN, 2.0, infinite, infinite, 3.0]),
            row(&[f32::NAN, 1.0, f32::NAN, infinite, 1.0, 3.0]),
        );
        let found = NumberDifference::between(&a, &b);
        assert_eq!((found.unmatched, found.max_error, found.over.percent_10), (3, 0.0, 0.5));
        assert_eq!(relative_errors(&a, &b), [0.0, infinite, infinite, 0.0, infinite, 0.0]);
        assert_eq!(found, NumberDifference::between(&b, &a));
        assert_eq!(NumberDifference::worst([&found, &NumberDifference::between(&a, &a)]), Some(found.clone()));
    }

    #[test]
    fn alpha_has_its_own_error() {
        let image = |alpha: f32| Pixels { size: [2, 1], rgba: vec![[0.5, 0.5, 0.5, alpha], [0.5, 0.5, 0.5, 1.0]] };
        let found = AlphaDifference::between(&image(0.25), &image(1.0));
        assert_eq!(found, AlphaDifference { max_error: 0.75, mean_error: 0.375 });
        assert_eq!(AlphaDifference::worst([found, AlphaDifference::between(&image(1.0), &image(1.0))]), Some(found));
    }
}
