//! Streaming: pages are loaded and evicted while frames are drawn, and no frame waits for a page.
//!
//! # Life of a page request
//!
//! 1. **Request**, on the GPU. For each page that the selection needs, `glsl/lod/select_pages.comp` writes the stamp of
//!    the frame and a priority to `last_used`. It requests the page if it is missing. `PageStreamer::record_requests`
//!    (`streamer`) reads the requests back, and also those for the predicted camera.
//! 2. **Snapshot and schedule**. `PageStreamer::handle_requests` (`streamer`) combines the requests with the residency
//!    of all pages in a `ResidencySnapshot`; a worker thread turns that into a `LoadSchedule` (`schedule`): the pages
//!    to load, and the pages to evict for them.
//! 3. **Load**. `PageStreamer::start_loads` (`streamer`) hands the pages to threads, which read them into host memory
//!    with `LoadedPage::read` (`scene/page_cache`). `PageStreamer::poll` collects them.
//! 4. **Insert and evict**. Before the next frame, `PageStreamer::advance` (`streamer`) passes loaded pages to
//!    `PageCache::insert` (`scene/page_cache`), which evicts pages to free their slots and copies the new pages there.
//! 5. **Fallback limits**. `FallbackLimits::set_resident` (`fallback`) computes the least limits with which no missing
//!    child page is needed, where pages changed, and `select_pages.comp` clamps the selected limits to them;
//!    `PageStreamer::fade_limits` (`streamer`) lowers the limits in use gradually, so that finer levels fade in.
//!    `LodSelector::set_fallback_limits` (`lod/selection`) uploads them for the next selection.
//!
//! The motion of the camera is predicted by `CameraMotion::predict` (`prefetch`), in `PageStreamer::advance`.
//!
//! # Files
//!
//! - `streamer` - the state of streaming, and what is done for each frame
//! - `schedule` - which pages to load and to evict
//! - `fallback` - the hierarchy of pages: dependencies of requests, and fallback limits
//! - `prefetch` - prediction of the camera's motion

pub(crate) mod fallback;
mod prefetch;
mod schedule;
mod streamer;

#[cfg(test)]
mod streamer_tests;

pub use streamer::Residency;
pub(crate) use streamer::{PageRequests, PageStreamer};
