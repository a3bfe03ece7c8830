//! Nodes of levels of detail, fitted to pictures of their children: the twin of [`Fitter`] on the host, with its bits.
//!
//! - `fitter` - the stages, and groups of nodes that are fitted together
//! - `workspace` - the buffers of a group
//!
//! [`Fitter`]: crate::lod::Fitter

mod fitter;
mod workspace;

pub use fitter::DeviceFitter;
