//! The Gaussians of open scenes, in memory or in a page file.

use std::sync::Arc;

use crate::pagefile::PageFile;
use crate::scene::{Focus, Gaussians, Scene, Transform};

/// What was opened.
pub enum Opened {
    Whole(Box<Scene>),
    /// A page file with levels of detail, whose pages are read while pictures go on.
    Pages(Arc<PageFile>),
}

/// The Gaussians of an open scene. A clone shares them.
#[derive(Clone)]
pub enum Held {
    Whole(Arc<Gaussians>),
    Pages(Arc<PageFile>),
}

/// True if both lists are of the same scenes with the same transforms.
pub fn are_same(parts: &[(Held, Transform)], others: &[(Held, Transform)]) -> bool {
    parts.len() == others.len() && parts.iter().zip(others).all(|(a, b)| a.0.is_same(&b.0) && a.1 == b.1)
}

impl Held {
    /// True if both are the same scene.
    pub fn is_same(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Whole(one), Self::Whole(other)) => Arc::ptr_eq(one, other),
            (Self::Pages(one), Self::Pages(other)) => Arc::ptr_eq(one, other),
            _ => false,
        }
    }

    /// Number of Gaussians.
    pub fn count(&self) -> usize {
        match self {
            Self::Whole(gaussians) => gaussians.len(),
            Self::Pages(file) => file.header().statistics.count,
        }
    }

    /// Where most of the scene lies.
    pub fn focus(&self) -> Focus {
        match self {
            Self::Whole(gaussians) => Focus::of(gaussians),
            Self::Pages(file) => file.header().statistics.focus,
        }
    }
}
