//! MAP

mod compressed_read;
pub(crate) mod compressed_write;
mod header;
mod layout;
mod points;
mod read;
mod rows;
mod write;

pub(crate) use read::{comes_in_blocks, read, read_blocks};
pub(crate) use write::write;
