//! MAP

mod buffers;
mod read;
mod write;
pub(crate) use read::{read_binary, read_text};
pub(crate) use write::write;
