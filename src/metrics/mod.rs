//! How far two images are apart. Colours are compared, coverage is not.

mod difference;
mod errors;
mod filter;
mod flip;
mod report;
#[cfg(test)]
mod samples;
mod ssim;

pub use difference::{Difference, Over};
pub use errors::{changed8, fraction_over, largest_step, max_error, mse, non_finite, psnr};
pub use flip::{Flip, PIXELS_PER_DEGREE, flip};
pub use report::{Pair, Report};
pub use ssim::ssim;
