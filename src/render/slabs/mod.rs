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

mod at_once;
mod chooser;
mod course;
mod detail;
mod draw;
mod ends;
mod family;
mod fast;
mod feed;
mod listed;
mod page_projection;
mod parts;
mod plan;
mod pool;
mod portable;
mod supply;
mod table;
mod trail;
mod visible;

#[cfg(test)]
mod chooser_tests;
#[cfg(test)]
mod feed_tests;
#[cfg(test)]
mod levels_tests;
#[cfg(test)]
mod placed_tests;
#[cfg(test)]
mod tests;

pub(super) use at_once::{AtOnce, bring_missing};
pub(super) use chooser::Chooser;
pub(super) use course::Drawn;
pub use detail::Detailed;
pub(super) use draw::Slabs;
pub use feed::Residency;
pub(super) use feed::{Demand, Feed};
pub use parts::Parts;
pub use pool::PagesRead;
pub(super) use pool::Pool;
pub(super) use portable::PortableSlabs;
