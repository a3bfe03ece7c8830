//! Frames drawn in parts: what does not fit into memory at once is drawn slab by slab, front to back, and shows the
//! same bits.
//!
//! | word | meaning |
//! |---|---|
//! | place | the position of a splat in the total order: depth key, then index of its Gaussian |
//! | slab | the splats from one place up to another: they are projected, listed, sorted and blended together |
//! | state | the colour and the transmittance of a pixel between two slabs |
//! | open bin | a bin with a pixel that has not stopped; the others take no more splats |
//! | page | 1024 Gaussians that are stored, read and listed together |
//! | slot | the room of a page in device memory |
//!
//! A splat belongs to the slab of its own place, wherever its footprint reaches, so each pixel sees the same splats in
//! the same order as in a frame that is drawn at once. A slab whose demand exceeds the capacity blends nothing; it is
//! drawn again, shorter.

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

pub(crate) use fast_frame::Slabs;
pub(crate) use partition::{Place, place_of, slab};
pub(crate) use portable_frame::PortableSlabs;
pub(crate) use progress::Drawn;
pub use report::Parts;
