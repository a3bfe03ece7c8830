//! The fast path: splats are listed and sorted in bins of 8x4 blocks, and each block is blended by a subgroup.
//!
//! - `pipeline` - [`FastPipeline`]: the stages of a frame, one method per stage
//! - `stages` - the constants and the fingerprint of the stages
//! - `workspace` - every intermediate buffer of a frame
//! - `grid` - a picture in bins and blocks
//! - `frame` - the inputs of a frame that is drawn from pages or in slabs
//!
//! | word | meaning |
//! |---|---|
//! | block | 8 pixels wide and 4, 8 or 16 high: one subgroup blends it |
//! | bin | 8x4 blocks: splats are listed in bins |
//! | entry | one splat in the list of one bin |
//! | chunk list | the entries of one chunk of splats in the list of one bin; together they are the unsorted list |
//! | run | up to 2048 entries of a list that one workgroup sorts |
//! | merge input | a sorted part of a list that a merge level takes: a run, or the output of the level before |
//! | segment | up to 1024 entries of a sorted list whose block masks lie together |
//! | chunk | the Gaussians or splats that one workgroup of a stage handles |

mod frame;
mod grid;
mod pipeline;
mod stages;
mod workspace;

pub(super) use frame::FastFrame;
pub use grid::BinGrid;
pub use pipeline::FastPipeline;
pub(super) use pipeline::between_stages;
pub use stages::BLOCK_HEIGHTS;
pub(super) use stages::blend_constants;
pub use workspace::FastWorkspace;
