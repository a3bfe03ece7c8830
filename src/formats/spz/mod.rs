//! MAP

mod read;
mod write;
pub(crate) use read::{read_gzip, read_v4};
pub(crate) use write::write;
