//! The pipeline on the GPU: a scene's buffers, two paths that draw it, and the facade that chooses between them.

mod capacity;
mod constants;
mod fast;
mod frame;
mod frame_queue;
mod inspect;
mod lod;
mod pack;
mod pages;
mod path;
mod path_choice;
mod portable;
mod prune;
mod readback;
mod recorded;
mod renderer;
mod scene;
mod self_test;
#[doc(hidden)]
pub mod shaders;
mod slabs;
mod streaming;
mod upscale;

#[doc(hidden)]
pub use capacity::Capacity;
#[doc(hidden)]
pub use fast::{BLOCK_HEIGHTS, BinGrid, FastPipeline, FastWorkspace};
#[doc(hidden)]
pub use frame::{Shot, Target, Variation};
pub(crate) use frame::{depth_bits, tiles};
#[doc(hidden)]
pub use frame_queue::{Finished, Form, FrameOutputs, FrameQueue, HostFrame, QueuedFrame};
pub use inspect::{Attribute, Explained, Explanation, Inspection, Look, Work, depths};
#[doc(hidden)]
pub use inspect::{Compare, Display, Picture, Quantity, Scale, false_colour, upload_pixels};
pub use lod::Detailed;
#[doc(hidden)]
pub use pack::Packer;
pub use path::Path;
#[doc(hidden)]
pub use portable::{Pairs, PortableStages, PortableWorkspace, RadixSort, SortRange, SortScratch};
#[doc(hidden)]
pub use prune::{Bounds as PruneBounds, Pruner, Share};
pub use recorded::Frame;
#[doc(hidden)]
pub use recorded::{Recorded, Started};
pub use renderer::Renderer;
pub use scene::{Content, GpuScene, NoLevels, PagesRead, SceneSource};
#[doc(hidden)]
pub use shaders::Splat;
pub use shaders::Totals;
pub use slabs::SlabReport;
pub use streaming::Residency;
