//! glTF with KHR_gaussian_splatting.
//!
//! - `read` - the document of a `.glb` or a `.gltf`, and its Gaussians
//! - `buffers` - buffers in the file, in other files and in data URIs
//! - `write` - `.glb` with 32-bit floats

mod buffers;
mod read;
mod write;

pub(crate) use read::{read_binary, read_text};
pub(crate) use write::write;
