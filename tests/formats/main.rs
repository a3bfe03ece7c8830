//! Scene and camera files: reading, refusing, writing and converting.

#[path = "../common/mod.rs"]
mod common;

mod agreement;
mod camera_choice;
mod camera_errors;
mod cameras;
mod convert;
mod degree_4;
mod dialects;
mod example;
mod georeferenced;
mod gltf_nodes;
mod independent;
mod kept_levels;
mod lenses;
mod named_files;
mod packed;
mod pages;
mod rad;
mod rad_levels;
mod sog;
mod sog_levels;
mod sog_write;
mod splat;
mod variants;
mod watched;
mod written;
