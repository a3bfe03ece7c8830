//! The stages of the pipelines and the GPU layer under them.

#[path = "../common/mod.rs"]
mod common;

mod extreme_counts;
mod fast_path;
mod harness;
mod portable;
mod shader_interface;
