//! The PSNR of levels of detail, measured on a sample of a picture: patches that are drawn with all Gaussians, too.
//!
//! - `estimate` - which patches are drawn, and the estimate of the error of the whole picture
//! - `limit_search` - [`LimitSearch`]: the largest error limit that keeps a PSNR
//! - `sampler` - [`LevelSampler`]: draws the patches

mod estimate;
mod limit_search;
mod sampler;

pub use limit_search::{LimitSearch, Step};
pub(crate) use sampler::LevelSampler;
pub use sampler::PsnrMeasurement;
