//! `--measure-levels`: the PSNR of pictures by levels of detail.

use anyhow::{Context, Result};

use crate::camera::Camera;
use crate::measure::metrics::psnr;
use crate::pixels::Pixels;
use crate::render::{LodReport, PATCHES, Renderer};
use crate::rules::Background;

/// What is drawn with all Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Measurement {
    Whole,
    /// About so many patches.
    Sample(u32),
}

/// Parses the value of `--measure-levels`.
pub(super) fn parse_measurement(text: &str) -> Result<Measurement> {
    let number = |text: &str| text.parse().ok().filter(|number| *number >= 2);
    let found = match text.split_once(':') {
        None if text == "whole" => Some(Measurement::Whole),
        None if text == "sample" => Some(Measurement::Sample(PATCHES)),
        Some(("sample", patches)) => number(patches).map(Measurement::Sample),
        _ => None,
    };
    found.context("expected sample, sample:N with N of at least 2, or whole")
}

impl Measurement {
    /// The report of a picture that the renderer has just drawn, with its PSNR.
    pub fn of(
        self,
        renderer: &mut Renderer,
        (camera, background): (&Camera, Background),
        pixels: &Pixels,
        detail: LodReport,
    ) -> Result<LodReport> {
        if let Self::Sample(patches) = self {
            return Ok(detail.with(&renderer.sample_psnr(camera, background, patches)?));
        }
        renderer.set_finest(true);
        let whole = renderer.render(camera, background).and_then(|_| renderer.pixels());
        renderer.set_finest(false);
        let measured = Some(psnr(pixels, &whole?)).filter(|db| db.is_finite());
        Ok(LodReport { measured_psnr: measured, standard_error: None, patches: None, ..detail })
    }
}

/// A measured PSNR and its standard error as text, like 43.8 dB +- 0.6.
pub(super) fn decibels(psnr: f64, standard_error: Option<f64>) -> String {
    let error = standard_error.map_or_else(String::new, |error| format!(" +- {error:.1}"));
    format!("{psnr:.1} dB{error}")
}
