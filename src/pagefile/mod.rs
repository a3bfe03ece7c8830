//! Page files, from which a scene is read page by page: the format, reading, and the pages of a renderer.
//!
//! - `header`, `bytes` - the header, and its encoding
//! - `page` - a page: its bounds, its words, its table entry
//! - `page_lod` - a page with levels of detail: its entry in the table of levels, and the words of its nodes
//! - `reader` - an open page file; `fault` - simulated faults of reading
//! - `pages` - the pages of a scene in the layout of a renderer, from a file or from memory
//! - `read_whole` - a whole scene in memory
//! - `nodes`, `static_lod` - nodes and one level of detail as Gaussians
//! - `write/` - writes page files in bounded memory, and builds their levels of detail

mod bytes;
mod fault;
mod header;
mod nodes;
mod page;
mod page_lod;
mod pages;
mod read_whole;
mod reader;
mod static_lod;
pub mod write;

pub use fault::{ReadFault, simulate};
pub use header::{HEADER, Header, LodSections};
pub use nodes::nodes_of;
pub use page::{Entry, PADDING, PAGE, Page, PageWords};
pub use page_lod::{LEVEL_WORDS, NO_NODE, NO_PAGE, PARTS, PageLod, SAMPLES, level_words};
pub use pages::{PagedScene, Pages};
pub use read_whole::read;
pub use reader::{PageFile, is_page_file};
pub use static_lod::static_level;
