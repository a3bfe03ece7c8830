//! Vulkan for compute: devices, typed buffers, stages, commands. It knows no Gaussians and is the only place with `unsafe`.
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
//! 5. *Trusted shaders.* SPIR-V comes from `build.rs` alone. The shaders bounds-check their own indices; in checked
//!    mode the device's robust buffer access is on as well.
//! 6. *Plain data.* Only `bytemuck::Pod` types cross between host and device.
//!
//! Public functions are safe under these clauses.

mod buffer;
mod commands;
mod device;
mod dispatch_size;
mod error;
mod executables;
#[cfg(feature = "reload")]
#[allow(dead_code, reason = "build.rs uses the rest")]
mod glsl;
mod element;
mod capabilities;
mod hazards;
mod id;
mod image;
mod image_commands;
mod instance;
mod overlay;
mod overlay_memory;
mod reload;
mod resource;
mod scopes;
mod semaphores;
mod shader;
#[cfg(feature = "reload")]
#[allow(dead_code, reason = "build.rs uses the rest")]
mod spirv;
mod stage;
mod staging;
mod submission;
mod surface;
mod survey;
mod timings;

pub use buffer::Buffer;
pub use capabilities::{Capabilities, DeviceKind, Feature, Limits};
pub use commands::{Commands, Timestamps};
pub use device::Device;
pub use dispatch_size::{DispatchSize, FOLD};
pub use element::{Element, Scalar};
pub use error::{DeviceLost, Unavailable};
pub use executables::Executable;
pub use hazards::Access;
pub use image::Image;
pub use instance::Validation;
pub use overlay::Overlay;
pub use resource::Resource;
pub use shader::{Binding, BindingKind, Bindings, Constants, Shader};
pub use stage::Stage;
pub use staging::Staging;
pub use submission::{Capture, InFlight, Readback, Results};
pub use surface::{Acquired, Acquisition, Presentation, Swapchain, Vsync};
pub use survey::{DeviceChoice, survey};
pub use timings::Timing;
