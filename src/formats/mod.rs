//! MAP

mod gltf;
mod input;
mod ksplat;
mod linked_file;
mod loss;
mod ply;
mod read;
mod rows;
mod sog;
mod splat;
mod spz;
mod write;
mod write_file;

pub use loss::Loss;
pub use read::{Reading, in_folder, read};
pub use sog::{LOD_META, Streamed, WrittenLevels, write_sog_folder, write_streamed_sog};
pub use write::SceneFile;
pub use write_file::{WrittenFile, write_file};
