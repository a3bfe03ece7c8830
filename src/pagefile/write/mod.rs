//! Writes page files of scenes of any size in bounded memory.
//!
//! - `convert` - from a scene in memory or in blocks; `in_order` - from blocks in Morton order
//! - `buckets` - Gaussians of one part of the Morton curve, in temporary files
//! - `checkpoint` - the state of an interrupted conversion
//! - `output` - the pages of the file
//! - `hierarchy` - builds the levels of detail group by group
//! - `hierarchy_layout` - the pages of each group, and of subtrees
//! - `source_levels` - levels of detail that the source has
//! - `group_checkpoint` - outputs of finished groups, kept for another run

mod buckets;
mod checkpoint;
mod convert;
mod group_checkpoint;
mod hierarchy;
mod hierarchy_layout;
mod in_order;
mod output;
mod source_levels;

pub use convert::{Blocks, Finished, Job, LEAST_MEMORY, Settings, Take, write_blocks, write_whole};
pub use hierarchy_layout::{Subtree, levels_of_pages, subtrees};
pub use in_order::write_in_order;
pub use source_levels::{temporary_levels, write_source_levels};
