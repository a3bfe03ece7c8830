//! Vulkan for compute: devices, typed buffers, stages, commands. It knows nothing of Gaussians.
//!
//! The crate denies `unsafe` outside this module, with two exceptions: the call of `madvise` in `host_memory`, and the
//! implementations of [`Shader`], [`Bindings`] and [`Constants`] that `build.rs` generates.
//!
//! `device`, `submission` and `buffer` import each other: a device pools the slots of its submissions, a slot owns a
//! buffer for stage markers, and a buffer keeps its device. No other files of this folder form a circle.
//!
//! # Safety contract
//!
//! Each `SAFETY` line in this module cites one of these clauses.
//!
//! 1. *Alive.* Every handle is owned by an object that keeps an [`Arc`](std::sync::Arc) of its device; the device and
//!    the instance are destroyed after the last of them.
//! 2. *Idle.* A command buffer keeps everything it uses until the timeline value of its submission is reached, so
//!    nothing is destroyed, reset or read by the host while the GPU may still use it.
//! 3. *Exclusive.* What Vulkan wants externally synchronized (queue, allocator, command pools) is behind a mutex or
//!    reached through `&mut`.
//! 4. *Matching.* Pipelines, layouts and descriptors are built from the same reflected interface that types the
//!    arguments of a dispatch, and lengths are checked against device limits when a resource or stage is made.
//! 5. *Trusted shaders and pipelines.* SPIR-V comes from `build.rs`, or with the feature `reload` from a developer's
//!    folder of shaders, compiled by the same code and only with the same interface. The shaders bounds-check their own
//!    indices; in checked mode the device's robust buffer access is on as well. The pipeline cache of a driver is
//!    loaded only if its hash is intact, so that the driver gets only data that it wrote itself.
//! 6. *Plain data.* Only `bytemuck::Pod` types cross between host and device.
//!
//! Public functions are safe under these clauses, with two preconditions that types do not express:
//! [`Commands::dispatch_indirect`] needs workgroup counts that a shader of this crate wrote, and commands of two
//! devices must not use memory of [`Staging::shared`] at the same time.

mod buffer;
mod capabilities;
mod commands;
mod device;
mod dispatch_size;
mod element;
mod error;
mod exported;
#[cfg(feature = "reload")]
#[allow(dead_code, reason = "build.rs uses the rest")]
mod glsl;
mod hazards;
mod id;
mod image;
mod image_commands;
mod instance;
mod memory_budget;
mod memory_limit;
#[cfg(feature = "viewer")]
mod overlay;
#[cfg(feature = "viewer")]
mod overlay_memory;
mod pipeline_cache;
mod pipeline_statistics;
mod pipelines;
mod reload;
mod resource;
mod scopes;
mod semaphores;
mod shader;
mod shared_host;
#[cfg(feature = "reload")]
#[allow(dead_code, reason = "build.rs uses the rest")]
mod spirv;
mod stage;
mod staging;
mod submission;
mod surface;
mod survey;
mod timings;

#[doc(hidden)]
pub use buffer::Buffer;
pub use capabilities::{Capabilities, DeviceKind, Feature, Limits};
#[doc(hidden)]
pub use commands::Commands;
pub use commands::Timestamps;
pub use device::{Device, different_kinds, names_of};
#[doc(hidden)]
pub use dispatch_size::{DispatchSize, FOLD};
#[doc(hidden)]
pub use element::{Element, Scalar};
pub use error::{DeviceLost, TooLarge, Unavailable};
#[doc(hidden)]
pub use exported::Handle;
#[doc(hidden)]
pub use hazards::Access;
#[doc(hidden)]
pub use image::Image;
pub use instance::Validation;
pub use memory_budget::MemoryUse;
#[cfg(feature = "viewer")]
#[doc(hidden)]
pub use overlay::Overlay;
#[doc(hidden)]
pub use pipeline_cache::{CachedPipelines, Check};
pub use pipeline_statistics::Executable;
#[doc(hidden)]
pub use resource::Resource;
#[doc(hidden)]
pub use shader::{Binding, BindingKind, Bindings, Constants, Shader};
#[doc(hidden)]
pub use stage::Stage;
#[doc(hidden)]
pub use staging::Staging;
#[doc(hidden)]
pub use submission::{Capture, InFlight, Readback, Results};
#[doc(hidden)]
pub use surface::{Acquired, Acquisition, Presentation, Swapchain, Vsync};
pub use survey::{DeviceChoice, survey};
pub use timings::Timing;
