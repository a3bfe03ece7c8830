//! Reads `.rad` of Spark: JSON headers, and chunks of up to 65,536 Gaussians whose properties are compressed planes. Of
//! a file with a tree of levels, the Gaussians of the scene, its leaves, are read, or all levels. The bytes are those
//! that Spark's encoder writes (`rust/spark-lib/src/rad.rs` of github.com/sparkjsdev/spark); there is no specification.
//!
//! - `read` - headers, and the Gaussians of the scene
//! - `chunk` - the encodings of properties
//! - `levels` - levels of parts of the tree

mod chunk;
mod levels;
mod read;

pub(crate) use levels::read_levels;
pub(crate) use read::{SIGNATURE, has_tree, read};
