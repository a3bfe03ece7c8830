//! Shapes of nodes of levels of detail, fitted to pictures of their children: the twin of [`Descent`], with its bits.
//!
//! - `fitter` - the stages, and groups of nodes that are fitted together
//! - `workspace` - the buffers of a group
//!
//! [`Descent`]: crate::lod::Descent

mod fitter;
mod workspace;

pub use fitter::ShapeFitter;
