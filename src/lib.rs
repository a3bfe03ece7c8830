//! smalto: a renderer of 3D Gaussian splatting scenes on hand-written Vulkan compute pipelines.
//!
//! | module | holds |
//! |---|---|
//! | [`scene`] | Gaussians and the file formats they come in |
//! | [`camera`] | cameras, camera files, camera paths |
//! | [`rules`] | the rules of a picture |
//! | [`options`] | the knobs that trade accuracy for speed, and the presets |
//! | [`mod@reference`] | the pipelines on the CPU in f64: the oracle |
//! | [`gpu`] | Vulkan for compute; it knows no Gaussians |
//! | [`render`] | the pipelines on the GPU |
//! | [`pixels`] | images in memory and in files |
//! | [`measure`] | speed, accuracy, and what one costs the other |
//! | [`viewer`] | the window |
//! | [`cli`] | the commands |
//! | [`files`], [`host_memory`] | atomic writes, and allocations that fail with an error |

#![deny(unsafe_code)]

pub mod camera;
pub mod cli;
pub mod files;
#[allow(unsafe_code)]
pub mod gpu;
#[allow(unsafe_code)]
pub mod host_memory;
pub mod measure;
pub mod options;
pub mod pixels;
pub mod reference;
pub mod render;
pub mod rules;
pub mod scene;
pub mod viewer;
