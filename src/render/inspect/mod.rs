//! Views into the portable path: pictures of attributes and of work, the explanation of a pixel, pictures on a screen.
//!
//! - `inspector` - frames that show attributes or work instead of colours
//! - `pick` - the splats that a pixel consists of
//! - `display` - pictures on a screen: side by side, their difference, false colours

mod display;
mod inspector;
mod pick;

pub use display::{Compare, Display, Picture, Quantity, Scale, false_colour, upload_pixels};
pub use inspector::{Attribute, Inspection, Inspector, Look, Work, depths};
pub use pick::{Explained, Explanation};
pub(super) use pick::{Listed, Picker};
