//! SPZ of Niantic: quantized planes.
//!
//! - `read` - versions 1 to 3, one gzip stream, and 4, a zstd stream per plane
//! - `write` - versions 3 and 4

mod read;
mod write;

pub(crate) use read::read;
pub(crate) use write::write;
