//! Page files, in which a scene is read a page at a time, and the pages that a renderer sees.

mod bytes;
mod fault;
mod header;
mod level;
mod nodes;
mod page;
mod page_file;
mod read_back;
mod source;
mod static_level;

pub use fault::{ReadFault, simulate};
pub use header::{HEADER, Header, LevelParts};
pub use level::{LEVEL_WORDS, Level, NO_NODE, NO_PAGE, PARTS, SAMPLES, level_words};
pub use nodes::nodes_of;
pub use page::{Entry, PADDING, PAGE, Page, PageRecord, PageWords};
pub use page_file::{PageFile, is_page_file};
pub use read_back::read;
pub use source::Pages;
pub use static_level::static_level;
