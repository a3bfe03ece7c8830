//! Measurements in the window: costs of knobs, options for an error budget, cameras against photographs.

use std::ops::RangeInclusive;
use std::time::Instant;

use super::comparison::PictureContent;
use crate::viewer::jobs::{Cancel, KnobCosts};

/// The running measurement, and the results of earlier ones.
#[derive(Default)]
pub struct Measuring {
    /// Costs of knobs, and the content of the picture that was measured.
    pub costs: Option<(KnobCosts, Option<PictureContent>)>,
    pub running: Option<Measurement>,
    pub budget: BudgetInput,
}

/// The error budget that the panel edits.
pub struct BudgetInput {
    /// The budget is a PSNR, not a largest error.
    pub is_psnr: bool,
    /// Largest difference of a colour channel, in colour values from 0 to 1.
    pub max_error: f64,
    /// In dB.
    pub min_psnr: f64,
    /// A text about the options chosen last.
    pub chosen: Option<String>,
}

impl Default for BudgetInput {
    fn default() -> Self {
        Self { is_psnr: false, max_error: 0.02, min_psnr: 60.0, chosen: None }
    }
}

/// The result that a measurement is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// The costs of knobs.
    Costs,
    /// Options within a budget.
    Choice,
    /// The cameras against their photographs.
    Evaluation,
}

/// The budgets that can be kept.
pub const MAX_ERRORS: RangeInclusive<f64> = 1e-5..=1.0;
pub const MIN_PSNRS: RangeInclusive<f64> = 20.0..=120.0;

/// A running measurement.
pub struct Measurement {
    pub purpose: Purpose,
    /// The content of the picture that is measured.
    pub content: Option<PictureContent>,
    /// The fraction done, 0 to 1.
    pub fraction: f64,
    pub since: Instant,
    pub cancel: Cancel,
}

impl Measuring {
    /// The fraction of choosing options that is done, while they are chosen.
    pub fn choosing(&self) -> Option<f64> {
        self.running.as_ref().filter(|running| running.purpose == Purpose::Choice).map(|running| running.fraction)
    }

    /// Registers a measurement and cancels the one that runs.
    pub fn begin(&mut self, purpose: Purpose, content: Option<PictureContent>) -> Cancel {
        let (since, cancel) = (Instant::now(), Cancel::default());
        let measurement = Measurement { purpose, content, fraction: 0.0, since, cancel: cancel.clone() };
        if let Some(before) = self.running.replace(measurement) {
            before.cancel.cancel();
        }
        cancel
    }
}
