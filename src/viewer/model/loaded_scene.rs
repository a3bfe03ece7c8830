//! The Gaussians of open scenes, in memory or in a page file.

use std::sync::Arc;

use crate::pagefile::PageFile;
use crate::scene::{Focus, Gaussians, Scene, Transform};

/// A scene that a job has opened.
pub enum OpenedScene {
    Whole(Box<Scene>),
    /// A page file with levels of detail, whose pages are read while frames are drawn.
    Paged(Arc<PageFile>),
}

/// The Gaussians of an open scene, whole or paged. A clone shares them.
#[derive(Clone)]
pub enum LoadedScene {
    Whole(Arc<Gaussians>),
    Paged(Arc<PageFile>),
}

/// True if both lists contain the same scenes with the same transforms.
pub fn are_same(scenes: &[(LoadedScene, Transform)], others: &[(LoadedScene, Transform)]) -> bool {
    scenes.len() == others.len() && scenes.iter().zip(others).all(|(a, b)| a.0.is_same(&b.0) && a.1 == b.1)
}

impl LoadedScene {
    /// True if both are the same scene.
    pub fn is_same(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Whole(one), Self::Whole(other)) => Arc::ptr_eq(one, other),
            (Self::Paged(one), Self::Paged(other)) => Arc::ptr_eq(one, other),
            _ => false,
        }
    }

    /// Number of Gaussians.
    pub fn count(&self) -> usize {
        match self {
            Self::Whole(gaussians) => gaussians.len(),
            Self::Paged(file) => file.header().statistics.count,
        }
    }

    /// Bounds of the main content.
    pub fn focus(&self) -> Focus {
        match self {
            Self::Whole(gaussians) => Focus::of(gaussians),
            Self::Paged(file) => file.header().statistics.focus,
        }
    }
}
