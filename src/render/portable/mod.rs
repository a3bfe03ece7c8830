//! The portable path: splats are listed in tiles of 16x16 pixels, sorted by depth and tile, and blended tile by tile.
//!
//! It makes no assumption about the subgroup size and runs on every device.

mod blend;
mod least_bytes;
mod pipeline;
mod sort;
mod workspace;

pub(super) use blend::Walk;
pub use pipeline::PortablePipeline;
pub(super) use pipeline::chunks;
pub(super) use sort::digit_bits;
pub use sort::{Pairs, RadixSort, SortRange, SortScratch};
pub use workspace::PortableWorkspace;
