//! The pipeline on the GPU: a scene's buffers, two paths that draw it, and the facade that chooses between them.
//!
//! [`Renderer`] is the facade. `portable/` runs on every device; `fast/` needs subgroups of one known size and draws
//! the same picture in less time; `choice.rs` picks one for each frame. `inspect/` looks inside the portable path.

mod capacity;
mod choice;
mod constants;
mod fast;
mod frame;
mod gpu_scene;
mod inspect;
mod pack;
mod path;
mod portable;
mod prune;
mod readback;
mod recorded;
mod renderer;
#[doc(hidden)]
pub mod shaders;
mod slabs;
mod source;
mod stream;
mod trial;
mod trial_part;
mod upscale;

#[doc(hidden)]
pub use capacity::Capacity;
#[doc(hidden)]
pub use fast::{BLOCK_HEIGHTS, BinGrid, FastPipeline, FastWorkspace};
#[doc(hidden)]
pub use frame::{Shot, Target, Variation};
pub(crate) use frame::{depth_bits, tiles};
pub use gpu_scene::GpuScene;
pub use inspect::{Attribute, Explained, Explanation, Inspection, Look, Work, depths};
#[doc(hidden)]
pub use inspect::{Compare, Display, Picture, Quantity, Scale, false_colour, upload_pixels};
#[doc(hidden)]
pub use pack::Packer;
pub use path::Path;
#[doc(hidden)]
pub use portable::{Pairs, PortablePipeline, PortableWorkspace, RadixSort, SortRange, SortScratch};
#[doc(hidden)]
pub use prune::{Bounds as PruneBounds, Pruner, Share};
pub(crate) use readback::read_pixels;
pub use recorded::Frame;
#[doc(hidden)]
pub use recorded::{Recorded, Started};
pub use renderer::Renderer;
#[doc(hidden)]
pub use shaders::Splat;
pub use shaders::Totals;
pub use slabs::{Detailed, PagesRead, Parts, Residency};
pub use source::{Content, NoLevels, SceneSource};
#[doc(hidden)]
pub use stream::{Finished, Form, HostFrame, Stream, Streamed, Wanted};
