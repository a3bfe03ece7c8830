//! The pipeline on the GPU: a scene's buffers, the frame's buffers, and the renderer that dispatches the stages.

mod gpu_scene;
mod renderer;
mod shaders;
mod sort;
mod still;
mod workspace;

pub use gpu_scene::GpuScene;
pub use renderer::{Renderer, Variation};
pub(crate) use renderer::{depth_bits, tiles, view};
pub use shaders::*;
pub use sort::{Pairs, RadixSort, SortRange, SortScratch};
pub(crate) use still::read_pixels;
pub use still::{Frame, Started, Still};
pub use workspace::{Demand, Workspace};
