//! Measurements of the renderer.
//!
//! - `bench` - speed: frames, stages, counts, memory
//! - `metrics` - differences of images: largest error, PSNR, SSIM, FLIP
//! - `trade` - time, memory and error of options, and the fastest options within an error budget
//! - `prune` - the Gaussians that some views do not need
//! - `plot` - plots of `bench` and `trade`

pub mod bench;
pub mod metrics;
#[cfg(feature = "plots")]
#[doc(hidden)]
pub mod plot;
pub mod prune;
pub mod trade;
