//! Frames in depth slabs: a frame that does not fit into memory at once is drawn slab by slab, front to back, and shows
//! the same bits.
//!
//! A splat belongs to the slab of its own sort position, wherever its footprint reaches, so each pixel blends the same
//! splats in the same order as in a frame that is drawn at once. A slab whose demand exceeds the capacity blends
//! nothing; it is drawn again, shorter.
//!
//! - `fast_frame` - [`FastSlabs`]: the loop over the slabs of the fast path, with prefetch of pages
//! - `fast_stages` - the stages of the fast path that are other ones in slabs
//! - `portable_frame` - [`PortableSlabs`]: the loop over the slabs of the portable path, with certificates and depths
//! - `partition` - the sort positions at which a frame is cut
//! - `input` - the Gaussians of a slab: the whole scene, or its pages in view
//! - `buffers` - the list of pages, and the sizes kept from frame to frame
//! - `progress` - the sums over the slabs of a frame
//! - `report` - the report of a frame in slabs
//!
//! The *state* of a pixel is its colour and its transmittance between two slabs. The glossary of
//! `docs/architecture.md` has the other words.

mod buffers;
mod fast_frame;
mod fast_stages;
mod input;
mod partition;
mod portable_frame;
mod progress;
mod report;

#[cfg(test)]
mod placed_tests;
#[cfg(test)]
mod tests;

pub(crate) use fast_frame::FastSlabs;
pub(crate) use portable_frame::{PortableFrame, PortableSlabs};
pub(crate) use progress::SlabbedFrame;
pub use report::SlabReport;
