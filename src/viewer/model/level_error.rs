//! What is known of the error of a picture by levels of detail.

use crate::render::{PsnrMeasurement, SampledPsnr};

/// The PSNR of the levels of a picture against all Gaussians.
#[derive(Default)]
pub enum LevelError {
    /// Nothing is simplified, or the picture moves or lacks pages.
    #[default]
    Unknown,
    Running(Box<PsnrMeasurement>),
    /// The estimate; `None` if the memory is too small for the measurement.
    Ended(Box<PsnrMeasurement>, Option<SampledPsnr>),
}

impl LevelError {
    /// The measurement that runs or ended last.
    pub fn measurement(&self) -> Option<&PsnrMeasurement> {
        match self {
            Self::Unknown => None,
            Self::Running(measurement) | Self::Ended(measurement, _) => Some(measurement),
        }
    }

    /// Ends a measurement.
    pub fn end(&mut self, found: Option<SampledPsnr>) {
        if let Self::Running(measurement) = std::mem::take(self) {
            *self = Self::Ended(measurement, found);
        }
    }

    /// The PSNR as text, like 43.8 dB +- 0.6; `None` while it is not known.
    pub fn text(&self) -> Option<String> {
        let Self::Ended(_, Some(found)) = self else { return None };
        Some(match found.psnr() {
            db if db.is_finite() => format!("{db:.1} dB +- {:.1}", found.standard_error_db()),
            _ => format!("no difference in {} of {} patches", found.patches[0], found.patches[1]),
        })
    }
}
