//! Selection of levels of detail: the pages and error limits of a frame, chosen on the GPU (`glsl/lod`).
//!
//! - `selection` - the stages: cull pages, search an error limit, select pages, finalize the dispatch; page requests
//! - `target` - the error limit, splat budget or PSNR that the options set, and the report of the selected levels
//! - `tables` - the page table on the device: bounds and errors of all pages
//! - `occlusion` - what is hidden behind a picture, so that it is drawn coarser
//! - `frame` - frames of paged scenes on the fast path in one submission, and the load of missing pages when a frame
//!   waits for them
//!
//! The clamp of a level whose children are missing: `glsl/lod/select_pages.comp`, with the limits that
//! `FallbackLimits` of `streaming/fallback` computes. Opacities of cross-fading nodes: `glsl/lod/nodes.glsl`. The
//! mathematics of nodes and error codes is in `crate::lod`.

mod frame;
mod occlusion;
mod selection;
mod tables;
mod target;

#[cfg(test)]
pub(crate) mod fixtures;
#[cfg(test)]
mod frame_tests;
#[cfg(test)]
mod occlusion_tests;
#[cfg(test)]
mod selection_tests;

pub(crate) use frame::{PagedFrame, load_missing};
pub(crate) use occlusion::Occlusion;
pub(crate) use selection::{LodSelector, SelectedPage, Selection, SelectionParams};
pub(crate) use target::drawn_fraction;
pub use target::{LodReport, SampledPsnr};
