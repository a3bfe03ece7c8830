//! The fast path along rays: cameras with lenses, drawn as the rays path draws them, with the lists of the fast path.
//!
//! Splats are ray splats, listed in bins. Where a lens is smooth, the bins of a splat follow from the ellipse of its
//! affine picture, grown by a bound of what the lens bends; elsewhere from the rays of the bins. Blend scales the rays
//! of a block to end on one plane, where the response along rays has no more lens in it.
//!
//! - `cells` - [`LensCells`](cells::LensCells): the places of directions on the picture
//! - `tables` - [`BinTables`]: the cells, and the rays of bins
//! - `pipeline` - [`FastRaysPipeline`]: the stages that differ from the fast path's

mod cells;
mod pipeline;
mod tables;

pub(super) use pipeline::{FastRaysFrame, FastRaysPipeline};
pub(super) use tables::BinTables;
