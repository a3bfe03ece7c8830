//! Writes page files, of scenes of any size in bounded memory.

mod buckets;
mod checkpoint;
mod convert;
mod group_checkpoint;
mod hierarchy;
mod hierarchy_layout;
mod in_order;
mod output;
mod records;

pub use convert::{Blocks, Finished, Job, LEAST_MEMORY, Settings, Take, write_blocks, write_whole};
pub use hierarchy_layout::{LevelsOfPart, levels_of_pages, parts};
pub use in_order::write_in_order;
