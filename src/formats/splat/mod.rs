//! `.splat`: 32 bytes per Gaussian.
//!
//! - `read` - the whole scene, or block by block
//! - `write` - the most visible Gaussians first

mod read;
mod write;

pub(crate) use read::{colour, floats, read, read_blocks};
pub(crate) use write::write;
