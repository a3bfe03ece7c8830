//! MAP

mod read;
mod write;

pub(crate) use read::{colour, floats, read, read_blocks};
pub(crate) use write::write;
