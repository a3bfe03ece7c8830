//! Page files, in which a scene is read a page at a time, and the pages that a renderer sees.

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
pub use header::{HEADER, Header, LevelParts};
pub use nodes::nodes_of;
pub use page::{Entry, PADDING, PAGE, Page, PageRecord, PageWords};
pub use page_lod::{LEVEL_WORDS, Level, NO_NODE, NO_PAGE, PARTS, SAMPLES, level_words};
pub use pages::Pages;
pub use read_whole::read;
pub use reader::{PageFile, is_page_file};
pub use static_lod::static_level;
