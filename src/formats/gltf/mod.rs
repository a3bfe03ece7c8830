//! glTF with KHR_gaussian_splatting.
//!
//! - `read` - the Gaussians of a `.glb` or a `.gltf`
//! - `document` - the description: nodes, meshes and where they are shown
//! - `values` - the numbers of accessors
//! - `buffers` - buffers in the file, in other files and in data URIs
//! - `write` - `.glb` with 32-bit floats

mod buffers;
mod document;
mod read;
mod values;
mod write;

pub(crate) use read::{read_binary, read_text};
pub(crate) use write::write;

const MAGIC: u32 = 0x4654_6c67; // "glTF"
const JSON: u32 = 0x4e4f_534a;
const BINARY: u32 = 0x004e_4942;
const EXTENSION: &str = "KHR_gaussian_splatting";
/// The only supported colour space: values are drawn as they are.
const DISPLAY: &str = "srgb_rec709_display";
