//! The pipeline on the GPU: a scene's buffers, the frame's buffers, and the renderer that dispatches the stages.

mod blending;
mod display;
mod explain;
mod fast;
mod fast_workspace;
mod gpu_scene;
mod inspect;
mod layout;
mod paths;
mod renderer;
mod self_test;
mod shaders;
mod sort;
mod still;
mod view;
mod workspace;

pub use blending::{Target, Variation};
pub use display::{Compare, Display, Picture, Quantity, Scale, false_colour, upload_pixels};
pub use explain::{Explained, Explanation};
pub use gpu_scene::GpuScene;
pub use inspect::{Attribute, Inspection, Inspector, Look, Work, depths};
pub use layout::{Layout, Packing};
pub use renderer::Renderer;
pub use shaders::*;
pub use sort::{Pairs, RadixSort, SortRange, SortScratch};
pub(crate) use still::read_pixels;
pub use still::{Frame, Recorded, Started, Still};
pub(crate) use view::{depth_bits, tiles};
pub use workspace::{Demand, Workspace};
