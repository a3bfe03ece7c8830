//! Inspection of the pictures: the view mode, pixel values read back, and an explained pixel.

use std::sync::Arc;

use glam::DVec2;

use super::plan::Side;
use super::snapshot::{Area, Snapshot, fitted_range};
use super::view_modes::InspectionSettings;
use crate::camera::Camera;
use crate::pixels::Pixels;
use crate::render::Explanation;

/// The inspection of the pictures.
pub struct Inspector {
    pub settings: InspectionSettings,
    /// The pictures, read back while they are at rest and their values are needed.
    pub snapshot: Option<Snapshot>,
    /// The depths of the first picture at rest, while guides are shown.
    pub depths: Option<Arc<Depths>>,
    /// Number of the last snapshot.
    last_snapshot: u64,
    pub explanation: Option<ExplainedPixel>,
}

/// The depths of a picture.
pub struct Depths {
    pub view: Camera,
    /// The mean depth of each pixel in world units, weighted by the shares of its splats; infinite where less than half
    /// of the light is the scene's.
    pub pixels: Vec<f32>,
}

impl Depths {
    /// True if the picture hides a point at a position in pixels and a depth.
    pub fn hides(&self, place: DVec2, depth: f64) -> bool {
        let [width, height] = self.view.size_px;
        let [x, y] = place.to_array().map(|side| side.floor());
        let is_inside = x >= 0.0 && y >= 0.0 && x < f64::from(width) && y < f64::from(height);
        let pixel = || self.pixels.get(y as usize * width as usize + x as usize);
        is_inside && pixel().is_some_and(|seen| f64::from(*seen) < depth)
    }
}

/// The explanation of a pixel, for the view at which it was requested.
pub struct ExplainedPixel {
    pub pixel: [u32; 2],
    pub side: Side,
    pub view: Camera,
    pub explanation: Explanation,
}

impl Inspector {
    /// `view_mode`: index of the view mode.
    pub fn new(view_mode: usize) -> Self {
        let settings = InspectionSettings { mode: view_mode, ..InspectionSettings::default() };
        Self { settings, snapshot: None, depths: None, last_snapshot: 0, explanation: None }
    }

    /// Stores the pictures that were read back, with the next number.
    pub fn set_snapshot(&mut self, first: Arc<Pixels>, second: Option<Arc<Pixels>>, covered: Option<Area>) {
        self.last_snapshot += 1;
        self.snapshot = Some(Snapshot { number: self.last_snapshot, first, second, covered });
    }

    /// Fits the ends of the scale to the values of the first picture. Returns false without values.
    pub fn fit_range(&mut self) -> bool {
        let quantity = self.settings.quantity();
        let range = self.snapshot.as_ref().and_then(|snapshot| fitted_range(&snapshot.first, quantity));
        range.inspect(|range| self.settings.ranges[self.settings.mode] = *range).is_some()
    }

    /// Removes the explanation and draws all Gaussians again.
    pub fn clear_explanation(&mut self) {
        self.explanation = None;
        self.settings.isolated = None;
    }
}
