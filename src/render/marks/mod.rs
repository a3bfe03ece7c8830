//! Marks of Gaussians on the device: left out of pictures, selected. They are bits of the scene's bounds, which every
//! path reads anyway, so that a change of marks uploads no Gaussian.
//!
//! - `figure` - figures that select Gaussians, in the picture, in the world, or of values
//! - `marker` - sets marks, and selects on the device

mod figure;
mod marker;

pub use figure::{Figure, Outline, SelectionMode, from_segment};
pub use marker::{Aim, Marker};
