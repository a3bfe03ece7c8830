//! The stages of the pipelines and the GPU layer under them.

#[path = "../common/mod.rs"]
mod common;

mod arrays;
mod extreme_counts;
mod fast_blend;
mod fast_input;
mod fast_lists;
mod fast_path;
mod fast_rays;
mod harness;
mod marks;
mod pack;
mod portable;
mod portable_frame;
mod prune;
mod radix_sort;
mod rays;
#[cfg(feature = "reload")]
mod reload;
mod shader_interface;

/// Around the subgroup (8, 32), the workgroup (256), the chunks (1024, 2048), and 16-bit counts.
pub const SIZES: [usize; 24] = [
    0, 1, 7, 8, 9, 31, 32, 33, 255, 256, 257, 1023, 1024, 1025, 2047, 2048, 2049, 4095, 4096, 4097, 65_535, 65_536,
    65_537, 300_000,
];
