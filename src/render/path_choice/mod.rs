//! The three engines, and the choice of the one that draws a frame.
//!
//! The choice prepares each frame, which decides its path and whether slabs draw it; then the frame is recorded, or
//! drawn slab by slab; then its counts are judged, which enlarges buffers or loads missing pages for the next attempt.
//!
//! - `choice` - [`PathChoice`]: prepare, record or draw slabs, judge; LOD selector and page streamer
//! - `fast_engine` - the fast path: pipeline, buffers, frames from pages, slabs
//! - `fast_rays_engine` - the fast path along rays: pipeline, buffers, tables of a lens
//! - `rays_engine` - the rays path: pipeline, buffers, tables of a lens
//! - `portable_engine` - the portable path: pipeline, buffers, slabs

mod choice;
mod fast_engine;
mod fast_rays_engine;
mod portable_engine;
mod rays_engine;

pub(crate) use choice::PathChoice;
