//! The Gaussians of open scenes, in memory or in a page file.

use std::sync::Arc;

use anyhow::{Result, bail};

use super::appearance::Appearance;
use super::edit::Edit;
use crate::pagefile::PageFile;
use crate::scene::{Focus, Gaussians, Scene, SceneInstances, Transform};

/// A scene that a job has opened.
pub enum OpenedScene {
    Whole(Box<Scene>),
    /// A page file with levels of detail, whose pages are read while frames are drawn, and the notices of the reader.
    Paged(Arc<PageFile>, Vec<String>),
}

/// The Gaussians of an open scene, whole or paged. A clone shares them.
#[derive(Clone)]
pub enum LoadedScene {
    Whole(Arc<Gaussians>),
    Paged(Arc<PageFile>),
}

/// A scene as a picture draws it. A clone shares it.
#[derive(Clone)]
pub struct DrawnScene {
    pub scene: LoadedScene,
    pub transform: Transform,
    /// The places of a list, in the axes before the transform; once without a list.
    pub places: Option<SceneInstances>,
    pub appearance: Appearance,
    /// The hidden and deleted Gaussians, which are not drawn, and the selected ones.
    pub edit: Option<Arc<Edit>>,
}

/// True if both lists contain the same scenes with the same transforms and appearances, edited or not.
pub fn are_same(scenes: &[DrawnScene], others: &[DrawnScene]) -> bool {
    let is_same = |(a, b): (&DrawnScene, &DrawnScene)| {
        let has_same_places = match (&a.places, &b.places) {
            (Some(a), Some(b)) => a.all() == b.all(),
            (a, b) => a.is_none() && b.is_none(),
        };
        a.scene.is_same(&b.scene) && a.transform == b.transform && has_same_places && a.appearance == b.appearance
    };
    scenes.len() == others.len() && scenes.iter().zip(others).all(is_same)
}

/// True if pictures of both lists show the same Gaussians.
pub fn draw_same(scenes: &[DrawnScene], others: &[DrawnScene]) -> bool {
    let pairs = scenes.iter().map(|scene| &scene.edit).zip(others.iter().map(|scene| &scene.edit));
    let leaves_out = |edit: &Option<Arc<Edit>>| edit.as_ref().is_some_and(|edit| edit.leaves_out());
    let is_same = |(a, b): (&Option<Arc<Edit>>, &Option<Arc<Edit>>)| match (a, b) {
        (Some(a), Some(b)) => Arc::ptr_eq(a, b) || a.draws_same(b),
        (a, b) => !leaves_out(a) && !leaves_out(b),
    };
    are_same(scenes, others) && { pairs }.all(is_same)
}

impl DrawnScene {
    /// All Gaussians, in the scene's own axes.
    ///
    /// # Errors
    /// The scene is paged.
    pub fn whole(&self) -> Result<Arc<Gaussians>> {
        match &self.scene {
            LoadedScene::Whole(gaussians) => Ok(gaussians.clone()),
            LoadedScene::Paged(_) => bail!("a scene with levels of detail is not in memory as a whole"),
        }
    }

    /// The Gaussians that are neither hidden nor deleted, in the scene's own axes.
    ///
    /// # Errors
    /// The scene is paged, or memory runs out.
    pub fn drawn(&self) -> Result<Arc<Gaussians>> {
        let whole = self.whole()?;
        let Some(edit) = self.edit.as_ref().filter(|edit| edit.leaves_out()) else { return Ok(whole) };
        Ok(Arc::new(whole.selected(&edit.drawn())?))
    }

    /// The transforms at which the scene is drawn.
    ///
    /// # Errors
    /// Two transforms after each other are none.
    pub fn instances(&self) -> Result<SceneInstances> {
        let Some(places) = &self.places else { return SceneInstances::new(vec![self.transform]) };
        let placed = places.all().iter().map(|place| place.then(&self.transform));
        SceneInstances::new(placed.collect::<Result<_>>()?)
    }

    /// True if not all Gaussians are drawn.
    pub fn leaves_out(&self) -> bool {
        self.edit.as_ref().is_some_and(|edit| edit.leaves_out())
    }
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
