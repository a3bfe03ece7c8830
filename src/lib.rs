//! smalto: a renderer of 3D Gaussian splatting scenes on hand-written Vulkan compute pipelines.
//!
//! | module | is |
//! |---|---|
//! | [`scene`] | what is drawn |
//! | [`camera`] | from where |
//! | [`options`] | with which trade-offs |
//! | [`mod@reference`] | the pipeline on the CPU in f64, the oracle |
//! | [`gpu`] | Vulkan for compute; knows no Gaussians |
//! | [`render`] | the pipeline on the GPU |
//! | [`pixels`], [`metrics`] | images, and how far they are apart |
//! | [`mod@bench`] | how fast, measured |
//! | [`trade`] | what accuracy costs, and the cheapest options within a budget |
//! | [`ladder`] | the optimizations one by one, from where the project started |
//! | [`memory`] | running out of it |
//! | [`files`] | that appear whole or not at all |
//! | [`viewer`] | the window |
//! | [`cli`] | the commands |

pub mod bench;
pub mod camera;
pub mod cli;
pub mod environment;
pub mod files;
pub mod gpu;
pub mod ladder;
pub mod memory;
pub mod metrics;
pub mod options;
pub mod pixels;
pub mod reference;
pub mod render;
pub mod scene;
pub mod trade;
pub mod viewer;
