//! The PSNR of levels of detail, measured on a sample of a picture: patches that are drawn with all Gaussians, too.
//!
//! - `estimate` - which patches are drawn, and the estimate of the error of the whole picture
//! - `limit_search` - [`LimitSearch`]: the largest error limit that keeps a PSNR
//! - `touched` - the patches that may show anything
//! - `sampler` - [`LevelSampler`]: draws the patches

mod estimate;
mod limit_search;
mod sampler;
mod touched;

pub use limit_search::{FIRST_LIMIT, LimitSearch, Step};
pub use sampler::PsnrMeasurement;
pub(crate) use sampler::{FoundLimit, LevelSampler};

/// The number of patches on which a PSNR is measured if none is given.
pub const PATCHES: u32 = 64;
