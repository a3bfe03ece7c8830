//! smalto: a renderer of 3D Gaussian splatting scenes on hand-written Vulkan compute pipelines.
//!
//! A program opens a scene, uploads it to a device, renders it from a camera, and reads the pixels. The scene may be a
//! file of any format: a page file (`.smalto`) stays on the disk and is loaded page by page, so it may be larger than
//! the memory of the device.
//!
//! ```no_run
//! use smalto::camera::Camera;
//! use smalto::gpu::{Device, DeviceChoice, Validation};
//! use smalto::options::Options;
//! use smalto::pixels::Alpha;
//! use smalto::render::{Renderer, SceneSource};
//! use smalto::rules::Background;
//!
//! # fn main() -> anyhow::Result<()> {
//! let source = SceneSource::open("garden.smalto")?;
//! // A budget of 2 million splats, if the file has levels of detail.
//! let options = source.suited(&Options { splats: 2_000_000, ..Options::BALANCED });
//! let focus = source.focus();
//! let camera = Camera::framing(focus.centre.into(), focus.radius, [1920, 1080]);
//!
//! // Within 4 GiB of device memory.
//! let device = Device::open(&DeviceChoice::Best, Validation::Off)?.with_memory_limit(Some(4 << 30))?;
//! let scene = source.upload(&device, &options)?;
//! let mut renderer = Renderer::new(&device, &options, &scene)?;
//! renderer.render(&camera, Background::BLACK)?;
//! renderer.pixels()?.write("garden.png", Alpha::Opaque)?;
//! # Ok(())
//! # }
//! ```
//!
//! `examples/render.rs` is the same as a program. [`formats::read`] reads a file into memory, whose Gaussians a program
//! can look at and change; [`SceneSource::of`](render::SceneSource::of) draws them.
//!
//! | module | holds |
//! |---|---|
//! | [`formats`] | file formats of scenes: reading and writing |
//! | [`scene`] | Gaussians in memory |
//! | [`camera`] | cameras, camera files, camera paths |
//! | [`rules`] | the rules of a picture |
//! | [`options`] | the knobs that trade accuracy for speed, and the presets |
//! | [`gpu`] | Vulkan for compute; it knows no Gaussians |
//! | [`render`] | scenes on the GPU, and the pipelines that draw them |
//! | [`mod@reference`] | the pipelines on the CPU in f64: the oracle |
//! | [`pixels`] | images in memory and in files |
//! | [`measure`] | speed, accuracy, and what one costs the other |
//!
//! Items that these pages do not show are public for the program, its tests and its benches, and may change in any
//! version.

#![deny(unsafe_code)]

pub mod camera;
#[doc(hidden)]
pub mod cli;
#[doc(hidden)]
pub mod files;
pub mod formats;
#[allow(unsafe_code)]
pub mod gpu;
#[allow(unsafe_code)]
#[doc(hidden)]
pub mod host_memory;
#[doc(hidden)]
pub mod lod;
pub mod measure;
pub mod options;
#[doc(hidden)]
pub mod packing;
#[doc(hidden)]
pub mod pagefile;
pub mod pixels;
#[doc(hidden)]
pub mod procedural;
mod quantities;
pub mod reference;
pub mod render;
pub mod rules;
pub mod scene;
#[cfg(feature = "serve")]
#[doc(hidden)]
pub mod serve;
#[doc(hidden)]
pub mod threads;
#[cfg(feature = "viewer")]
#[doc(hidden)]
pub mod viewer;
