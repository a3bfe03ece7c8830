//! Attributes of Gaussians in words, as the GPU and page files hold them.
//!
//! - `statistics` - [`Statistics`] of a whole scene, from one pass over its Gaussians
//! - `layout` - [`Layout`], the number formats that follow from them; packs and unpacks words
//! - `planes`, `widths` - the planes of words of many Gaussians, and the words of one in each
//! - `halves` - floats and scales in 16 bits

mod halves;
mod layout;
mod planes;
mod statistics;
mod widths;

pub use layout::{Layout, MAX_FLOATS, Packing};
pub(crate) use planes::put;
pub use planes::{Shape, pack_sh, pack_shapes, reach, take};
pub use statistics::{Accumulator, EXAMINED, NOTHING, Statistics};
pub use widths::{SH_PLANES, plane_widths};
