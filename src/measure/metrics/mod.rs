//! Measures of the difference of two images: of colours, of coverage, and of one number per pixel.
//!
//! - `errors` - measures of single values: largest error, PSNR, steps of 8 bits
//! - `ssim`, `flip` - structural similarity; perceived difference
//! - `filter` - separable filters, for both
//! - `difference` - all measures of colours together
//! - `numbers` - measures of alpha, and of images of one number per pixel
//! - `scored` - measures of the pixels that a camera sees
//! - `report` - the report of a comparison as JSON
//! - `samples` - images for tests

mod difference;
mod errors;
mod filter;
mod flip;
mod numbers;
mod report;
#[cfg(test)]
mod samples;
mod scored;
mod ssim;

pub use difference::{Difference, Over};
pub use errors::{changed8, fraction_over, largest_step, max_error, mse, non_finite, psnr};
pub use flip::{Flip, PIXELS_PER_DEGREE, flip};
pub use numbers::{AlphaDifference, NumberDifference, OverRelative, relative_errors};
pub use report::{Pair, Report};
pub use scored::Scored;
pub use ssim::ssim;

use std::ops::Range;

use rayon::prelude::*;

use crate::pixels::Pixels;

/// Bytes per pixel that the measures of a pair need at once, besides the images: planes of FLIP and SSIM, a heatmap.
pub const BYTES_PER_PIXEL: u64 = 64;

fn check_sizes(a: &Pixels, b: &Pixels) {
    assert_eq!(a.size, b.size, "compared images have the same size");
}

/// True if all colour channels are finite; alpha is ignored.
fn is_finite(pixel: &[f32; 4]) -> bool {
    pixel[..3].iter().all(|v| v.is_finite())
}

/// The value clamped to the display's range 0 to 1. NaN becomes 0, as in 8 bits.
fn displayed(value: f32) -> f32 {
    if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) }
}

/// The results of `of_row` in the order of the rows. They are computed in parallel, but a sum over them is
/// reproducible.
fn by_row<T: Send>(rows: Range<usize>, of_row: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    rows.into_par_iter().map(of_row).collect()
}
