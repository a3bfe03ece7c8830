//! PLY: scenes of the original 3DGS, compressed PLY of PlayCanvas, and point clouds.
//!
//! - `read` - selects one of the three by the header, and reads Gaussians with 32-bit floats
//! - `header` - elements and properties of the header
//! - `layout` - positions of the attributes in a row
//! - `dialects` - properties that trainers and tools write beside them
//! - `rows` - rows of an element, binary or text
//! - `points` - point clouds, drawn as small Gaussians
//! - `write` - 32-bit floats
//! - `compressed_read`, `compressed_write` - 16 bytes per Gaussian, and one per coefficient of degrees 1 and up

mod compressed_read;
pub(crate) mod compressed_write;
mod dialects;
mod header;
mod layout;
mod points;
mod read;
mod rows;
mod write;

pub(crate) use header::{background_notice, kernel_notice};
pub(crate) use read::{comes_in_blocks, read, read_blocks};
pub(crate) use write::write;
