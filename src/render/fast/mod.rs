//! The fast path: splats are listed and sorted in bins of 8x4 blocks, and each block is blended by a subgroup.
//!
//! | word | meaning |
//! |---|---|
//! | block | 8 pixels wide and 4, 8 or 16 high: what one subgroup blends |
//! | bin | 8x4 blocks: what splats are listed in |
//! | entry | one splat in the list of one bin |
//! | share | the entries that one chunk of splats has in the list of one bin; an unsorted list is its shares |
//! | run | up to 2048 entries of a list that one workgroup sorts |
//! | piece | a sorted part of a list that a merge level takes: a run, or 16 pieces of the level before |
//! | stretch | up to 1024 entries of a sorted list whose block masks lie together |
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
