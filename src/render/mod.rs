//! The renderer: scenes in device memory, the two paths that draw them, and the facade that chooses between them.
//!
//! Each room uses only rooms above it in this list; `->` names them, without the rooms that those use in turn.
//! `RENDER_ROOMS` in `tests/architecture/layers.rs` is the whole table.
//!
//! **Ground.** `shaders` are the typed interfaces of `glsl/`, written by `build.rs`. `capacity` counts the elements of
//! buffers, and their growth. `band` and `patches` are parts of a picture that a frame draws, `path` the path and the
//! limits of a frame. `readback`, `pack` and `upscale` handle images. -> `gpu`
//!
//! **`scene`.** A scene before and in device memory, whole or as a cache of pages; `frame` has the view, the target and
//! the depth keys of a frame, and `constants` maps options to specialization constants, with a code of `frame`.
//! -> `shaders`
//!
//! **`arrays`.** Scenes that are packed on the device, from arrays that another API wrote there. -> `scene`,
//! `constants`
//!
//! **`portable`.** The path that runs on every device: cull, project, sort by depth, list in tiles, blend.
//! -> `scene`, `frame`, `constants`, `capacity`
//!
//! **`rays`.** The portable path along the rays of pixels, for cameras with lenses: stages of `portable` between its
//! own. -> `portable`
//!
//! **`fast`.** The path for subgroups of a known size: project, list in bins, sort and merge each list, blend.
//! -> `portable` (the size of sort digits)
//!
//! **`fast_rays`.** The fast path along rays: stages of `fast` between its own. -> `rays`, `fast`
//!
//! **`inspect`.** Pictures of attributes and of work, the explanation of a pixel, pictures on a screen. -> `portable`
//!
//! **`prune`.** The contribution of each Gaussian to pictures, and bounds on pictures without some.
//! -> `portable`, `readback`
//!
//! **`fit`.** Shapes of nodes of levels of detail, fitted to pictures. -> `shaders`
//!
//! **`marks`.** Gaussians that are left out of pictures or selected, as bits on the device. -> `scene`, `frame`
//!
//! **`pages`.** The pages in view, the list of pages that a dispatch draws, and their projection.
//! -> `fast`, `inspect`
//!
//! **`lod`.** The selection of pages and LOD nodes on the GPU, and frames of a scene in pages. -> `pages`
//!
//! **`streaming`.** Requests, loads and evictions of pages beside frames that do not wait for them. -> `lod`
//!
//! **`slabs`.** Frames that do not fit into memory at once, drawn in depth slabs on either path. -> `lod`
//!
//! **`path_choice`.** The two engines, and the choice of the one that draws a frame; `recorded` has its counts and
//! `self_test` compares the pictures of both paths at the start. -> `slabs`, `streaming`, `path`, `readback`
//!
//! **`sample`.** The PSNR of levels of detail, measured on patches of a picture. -> `self_test`
//!
//! **`renderer`.** The facade: a frame from camera to pixels, repeated until it fits.
//! -> `path_choice`, `sample`, `upscale`
//!
//! **`frame_queue`.** Several frames in flight, and their pixels on the host. -> `renderer`, `pack`
//!
//! **`split`.** One frame on several devices, a band on each. -> `frame_queue`

mod arrays;
mod band;
mod capacity;
mod constants;
mod fast;
mod fast_rays;
mod fit;
mod frame;
mod frame_queue;
mod inspect;
mod lod;
mod marks;
mod pack;
mod pages;
mod patches;
mod path;
mod path_choice;
mod portable;
mod prune;
mod rays;
mod readback;
mod recorded;
mod renderer;
mod sample;
mod scene;
mod self_test;
#[doc(hidden)]
pub mod shaders;
mod slabs;
mod split;
mod streaming;
mod upscale;

#[doc(hidden)]
pub use arrays::{DeviceArrays, Examination, HostNeeded};
pub use band::{BAND_ROWS, Band};
#[doc(hidden)]
pub use capacity::Capacity;
#[doc(hidden)]
pub use fast::{BLOCK_FORMS, BinGrid, BlockForm, FastPipeline, FastWorkspace, flushes_denormals};
#[doc(hidden)]
pub use fit::DeviceFitter;
#[doc(hidden)]
pub use frame::{Shot, Target, Variation, view};
pub(crate) use frame::{depth_bits, tiles};
#[doc(hidden)]
pub use frame_queue::{Finished, Form, FrameOutputs, FrameQueue, HostFrame, QueuedFrame};
pub use inspect::{Attribute, Explained, Explanation, Inspection, Look, Work, depths};
#[doc(hidden)]
pub use inspect::{Compare, Display, Picture, Quantity, Scale, false_colour, upload_pixels};
pub use lod::{LodReport, SampledPsnr};
#[doc(hidden)]
pub use marks::{Aim, Figure, Marker, Outline, SelectionMode, from_segment};
pub use pack::{Packer, Unpacker};
#[doc(hidden)]
pub use patches::Patches;
pub use path::Path;
#[doc(hidden)]
pub use portable::{Pairs, PortableStages, PortableWorkspace, RadixSort, SortRange, SortScratch};
#[doc(hidden)]
pub use prune::{Bounds as PruneBounds, Pruner, Share};
pub use recorded::Frame;
#[doc(hidden)]
pub use recorded::{Recorded, Started};
pub use renderer::{RayCertifier, Renderer, UndrawableLens};
#[doc(hidden)]
pub use sample::{LimitSearch, PATCHES, PsnrMeasurement, Step};
#[doc(hidden)]
pub use scene::Content;
pub use scene::{Features, GpuScene, JoinedScenes, NoLevels, PagesRead, SceneSource, Upload};
#[doc(hidden)]
pub use shaders::Splat;
pub use shaders::Totals;
pub use slabs::SlabReport;
#[doc(hidden)]
pub use split::{Balance, DeviceBand, DrawnBand, LostDevice, OtherDevices, SplitFrame, SplitRenderer};
pub use streaming::Residency;
