//! Writes page files, of scenes of any size in bounded memory.

mod buckets;
mod hierarchy;
mod in_order;
mod job;
mod output;
mod records;
mod state;
mod storeys;
mod tops;

pub use in_order::write_in_order;
pub use job::{Blocks, Finished, Job, LEAST_MEMORY, Settings, Take, write_blocks, write_whole};
pub use storeys::{LevelsOfPart, levels_of_pages, parts};
