//! Pages of Gaussians in a frame: culling, the draw list, and the projection of its pages.
//!
//! - `visibility` - bounds of a page in the image and in depth, and tests of pages against open bins, for frames in
//!   depth slabs. Every frame first culls pages on the GPU (`glsl/lod/cull_pages.comp`, `lod/selection`)
//! - `draw_list` - the views and pages of a dispatch, as the shaders read them
//! - `projection` - the stage `project` of the fast path for the pages of a draw list
//!
//! The page cache, which loads and evicts pages, is `scene/page_cache`; the requests of streamed frames are handled in
//! `streaming`. The shaders are in `glsl/pages`.

mod draw_list;
mod projection;
mod visibility;

pub(crate) use draw_list::{DrawList, Element, PageDraw, first_page, max_pages, number_of_pages, views_of};
pub(crate) use projection::{PageCount, PageProjection};
pub(crate) use visibility::{OpenBinTable, PageCuller, PlacedCamera, VisiblePage};
