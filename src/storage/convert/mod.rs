//! Writes page files, of scenes of any size in bounded memory.

mod buckets;
mod job;
mod output;
mod records;
mod state;

pub use job::{Blocks, Finished, Job, LEAST_MEMORY, Settings, Take, write_blocks, write_in_order, write_whole};
