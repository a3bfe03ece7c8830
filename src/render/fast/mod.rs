//! The fast path: splats are listed and sorted in bins of 8x4 blocks, and each block is blended by a subgroup.
//!
//! - `pipeline` - [`FastPipeline`]: the stages of a frame, one method per stage
//! - `denormals` - the test of the device that decides how blend applies the threshold of alphas
//! - `stages` - the constants and the fingerprint of the stages
//! - `workspace` - every intermediate buffer of a frame
//! - `grid` - a picture in bins and blocks
//! - `frame` - the inputs of a frame that is drawn from pages or in slabs
//!
//! The glossary of `docs/architecture.md` has the words: block, bin, entry, chunk list, run, segment.

mod denormals;
mod frame;
mod grid;
mod pipeline;
mod stages;
mod workspace;

pub use denormals::flushes_denormals;
pub(super) use frame::FastFrame;
pub use grid::BinGrid;
pub use pipeline::FastPipeline;
pub(super) use pipeline::between_stages;
pub use stages::{BLOCK_FORMS, BlockForm};
pub use workspace::FastWorkspace;
