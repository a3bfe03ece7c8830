//! Nodes of levels of detail, fitted to pictures of their children: a [`Fitter`] with the bits of the host.
//!
//! - `fitter` - the stages, and groups of nodes that are fitted together
//! - `workspace` - the buffers of a group
//!
//! [`Fitter`]: crate::lod::Fitter

mod fitter;
mod workspace;

pub use fitter::DeviceFitter;
