//! The portable path: splats are listed in tiles of 16x16 pixels, sorted by depth and tile, and blended tile by tile.
//!
//! It makes no assumption about the subgroup size and runs on every device.

mod blend;
mod least_bytes;
mod pipeline;
mod sort;
mod stages;
mod workspace;

pub(super) use blend::{Pass, Walk};
pub(super) use pipeline::{PortablePipeline, chunks};
pub(super) use sort::digit_bits;
pub use sort::{Pairs, RadixSort, SortRange, SortScratch};
pub use stages::PortableStages;
pub use workspace::PortableWorkspace;
