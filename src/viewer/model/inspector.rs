//! Inspection of the pictures: the view mode, pixel values read back, marked points, and an explained pixel.

use std::sync::Arc;

use glam::DVec3;

use super::plan::Side;
use super::snapshot::{Area, Snapshot, fitted_range};
use super::view_modes::InspectionSettings;
use crate::camera::Camera;
use crate::pixels::Pixels;
use crate::render::Explanation;

/// Most marks: three points define a plane.
const MARKS: usize = 3;

/// The inspection of the pictures.
pub struct Inspector {
    pub settings: InspectionSettings,
    /// The pictures, read back while they are at rest and their values are needed.
    pub snapshot: Option<Snapshot>,
    /// Number of the last snapshot.
    last_snapshot: u64,
    /// The points that were marked last, in world units.
    pub marks: Vec<DVec3>,
    pub explanation: Option<ExplainedPixel>,
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
        Self { settings, snapshot: None, last_snapshot: 0, marks: Vec::new(), explanation: None }
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

    /// Marks a point, in place of the oldest mark if there are three. Returns the distance from the mark before, in
    /// world units.
    pub fn mark(&mut self, point: DVec3) -> Option<f64> {
        if self.marks.len() == MARKS {
            self.marks.remove(0);
        }
        let distance = self.marks.last().map(|before| before.distance(point));
        self.marks.push(point);
        distance
    }

    /// Removes the explanation and draws all Gaussians again.
    pub fn clear_explanation(&mut self) {
        self.explanation = None;
        self.settings.isolated = None;
    }
}
