//! How Gaussians are stored in words: on the GPU, and in page files.
//!
//! [`Statistics`] are all that has to be known of a whole scene, [`Layout`] is the number formats that follow from
//! them, and the planes of `planes.rs` are the words themselves.

pub mod convert;
mod halves;
mod layout;
mod pages;
mod planes;
mod statistics;

pub use layout::{Layout, Packing};
pub use pages::{
    Entry, HEADER, Header, LEVEL_WORDS, Level, NO_PAGE, PADDING, PAGE, PARTS, Page, PageFile, PageWords, Pages,
    ReadFault, SAMPLES, is_page_file, nodes_of, read, simulate, static_level,
};
pub use planes::{Shape, pack_sh, pack_shapes, reach, share, take};
pub use statistics::{Accumulator, FOCUSED, Statistics};
