//! The portable path: splats are listed in tiles of 16x16 pixels, sorted by depth and tile, and blended tile by tile.
//!
//! It makes no assumption about the subgroup size and runs on every device.
//!
//! - `pipeline` - [`PortablePipeline`]: the stages of a frame, one method per stage
//! - `blend` - the walk along the lists of all tiles, and the blend with it
//! - `sort` - the radix sort
//! - `workspace` - every intermediate buffer of a frame
//! - `least_bytes` - the fewest bytes that each stage moves
//! - `stages` - [`PortableStages`]: the stages one at a time, for the ladder (`benches/ladder`)

mod blend;
mod least_bytes;
mod pipeline;
mod sort;
mod stages;
mod workspace;

pub(super) use blend::{Pass, Walk, unlisted};
pub(super) use pipeline::{PortablePipeline, chunks};
pub(super) use sort::digit_bits;
pub use sort::{Pairs, RadixSort, SortRange, SortScratch};
pub use stages::PortableStages;
pub use workspace::PortableWorkspace;
