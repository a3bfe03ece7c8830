//! Scenes with levels of their own.

use std::ops::Range;

use crate::scene::{Gaussians, Scene};

/// All levels of a scene.
pub struct SourceLevels {
    /// The finest level of every leaf, and the environment.
    pub scene: Scene,
    /// All Gaussians of coarser levels.
    pub coarser: Gaussians,
    pub leaves: Vec<Leaf>,
}

/// The Gaussians of a leaf: a part of the scene, and what may be drawn in its place.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Leaf {
    /// Indices in the scene.
    pub finest: Range<usize>,
    /// Indices among the coarser Gaussians of each further level.
    pub coarser: Vec<Range<usize>>,
}
