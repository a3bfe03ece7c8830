//! MAP

mod codebook;
mod files;
mod folder;
mod kmeans;
mod meta;
mod read;
mod read_streamed;
mod texture;
mod unit;
mod write;
mod write_streamed;

pub use folder::write_sog_folder;
pub(crate) use read::{in_folder, read_bundle, read_json};
pub(crate) use write::write;
pub use write_streamed::{Streamed, WrittenLevels, write_streamed_sog};

/// The name that readers know a streamed SOG by.
pub const LOD_META: &str = "lod-meta.json";
