//! The cameras of the camera file with their photographs.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec2;

use super::evaluation::Evaluation;
use super::photographs::Photographs;
use crate::camera::{Camera, NamedCamera};
use crate::pixels::Pixels;

/// The cameras of the file, and their photographs.
#[derive(Default)]
pub struct Cameras {
    pub list: Vec<NamedCamera>,
    pub file: Option<PathBuf>,
    /// The cameras or their photographs are being read.
    pub are_loading: bool,
    pub photographs: Option<Arc<Photographs>>,
    /// Reduced photographs by camera index; `None` while one is read, or if it cannot be read.
    pub thumbnails: BTreeMap<usize, Option<Pixels>>,
    /// The last comparison of all cameras with their photographs.
    pub evaluation: Option<Evaluation>,
}

impl Cameras {
    /// The file with the photograph of a camera.
    pub fn photograph_of(&self, index: usize) -> Option<PathBuf> {
        let camera = self.list.get(index)?;
        self.photographs.as_ref()?.of(camera).map(Path::to_owned)
    }

    /// True if a camera has a photograph.
    pub fn have_photographs(&self) -> bool {
        self.photographs.as_ref().is_some_and(|known| known.count_of(&self.list) > 0)
    }

    /// Index of the camera whose position in the picture of `view` is nearest to `pixel`, at most `within` pixels away.
    pub fn at(&self, view: &Camera, pixel: DVec2, within: f64) -> Option<usize> {
        let distance = |camera: &NamedCamera| {
            let (at, _) = view.projected(camera.camera.position)?;
            Some(at.distance(pixel)).filter(|distance| *distance <= within)
        };
        let near = self.list.iter().enumerate().filter_map(|(i, camera)| Some((i, distance(camera)?)));
        near.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(i, _)| i)
    }
}
