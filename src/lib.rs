//! smalto: a renderer of 3D Gaussian splatting scenes on hand-written Vulkan compute pipelines.
//!
//! The public interface reads a scene, takes a camera and options, renders, and gives pixels:
//!
//! ```no_run
//! use smalto::camera::Camera;
//! use smalto::gpu::{Device, DeviceChoice, Validation};
//! use smalto::options::Options;
//! use smalto::render::{GpuScene, Renderer};
//! use smalto::rules::Background;
//!
//! # fn main() -> anyhow::Result<()> {
//! let scene = smalto::formats::read("garden.ply".as_ref())?;
//! let camera = Camera::looking_at([0.0, -1.0, -4.0].into(), [0.0; 3].into(), [1920, 1080], 0.9);
//! let options = Options::BALANCED;
//!
//! let device = Device::open(&DeviceChoice::Best, Validation::Off)?;
//! let on_gpu = GpuScene::new(&device, &scene.gaussians, &options)?;
//! let mut renderer = Renderer::new(&device, &options, &on_gpu)?;
//! renderer.render(&camera, Background::BLACK)?;
//! renderer.pixels()?.write("garden.png".as_ref(), false)?;
//! # Ok(())
//! # }
//! ```
//!
//! | module | holds |
//! |---|---|
//! | [`scene`] | Gaussians and the file formats they come in |
//! | [`camera`] | cameras, camera files, camera paths |
//! | [`rules`] | the rules of a picture |
//! | [`options`] | the knobs that trade accuracy for speed, and the presets |
//! | [`gpu`] | Vulkan for compute; it knows no Gaussians |
//! | [`render`] | the pipelines on the GPU |
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
pub mod reference;
pub mod render;
pub mod rules;
pub mod scene;
#[cfg(feature = "viewer")]
#[doc(hidden)]
pub mod viewer;
