//! SOG of PlayCanvas: WebP textures with one texel per Gaussian, and a `meta.json`.
//!
//! - `read` - an archive, a folder, or levels of a streamed SOG
//! - `read_streamed` - `lod-meta.json`, the tree of a streamed SOG
//! - `meta` - `meta.json` of versions 1 and 2
//! - `unit` - Gaussians of one `meta.json`
//! - `texture` - WebP textures
//! - `files` - access to textures in an archive or a folder
//! - `write` - an archive of version 2
//! - `write_streamed` - a streamed SOG with all levels
//! - `folder` - writes and removes SOGs in folders
//! - `codebook`, `kmeans` - codebooks of 256 values, and the palette of spherical harmonics

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
pub(crate) use read::{in_folder, read_all_levels, read_bundle, read_json, streamed_in};
pub(crate) use write::write;
pub use write_streamed::{Streamed, WrittenLevels, write_streamed_sog};

/// The file name of a streamed SOG.
pub const LOD_META: &str = "lod-meta.json";
