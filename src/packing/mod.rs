//! How Gaussians are stored in words: on the GPU, and in page files.
//!
//! [`Statistics`] are all that has to be known of a whole scene, [`Layout`] is the number formats that follow from
//! them, and the planes of `planes.rs` are the words themselves.

mod halves;
mod layout;
mod planes;
mod statistics;

pub use layout::{Layout, Packing};
pub(crate) use planes::put;
pub use planes::{Shape, pack_sh, pack_shapes, reach, share, take};
pub use statistics::{Accumulator, FOCUSED, Statistics};
