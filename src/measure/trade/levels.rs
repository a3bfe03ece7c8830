//! The trade of levels of detail: presets with all Gaussians and with decreasing splat budgets, compared with the exact
//! picture and with a supersampled one.
//!
//! The exact picture follows the rules at its own pixels. The classic rules widen every footprint by 0.3 pixels
//! squared, so from afar it is too opaque; nodes, each of which stands for many Gaussians, are widened once. The
//! supersampled picture is drawn with pixels of a quarter of the width, which widens footprints by a sixteenth of the
//! area, and each pixel is the mean of its 16 samples: what a camera with square pixels sees of the scene.

use std::time::Duration;

use anyhow::{Context, Result};

use super::measure::{draw, each, worst_of};
use super::report::{LevelPoint, LevelsReport, mark_levels};
use super::timing::Timing;
use crate::camera::Camera;
use crate::gpu::Device;
use crate::measure::bench::Protocol;
use crate::options::Options;
use crate::pixels::Pixels;
use crate::render::{GpuScene, Renderer, SceneSource, Upload};
use crate::rules::Background;

/// Samples of a pixel of supersampled pictures along each side.
pub const SAMPLES_ALONG: u32 = 4;
/// Measured splat budgets: the number of Gaussians in the picture divided by 2, 4, ... up to this power of two.
const HALVINGS: u32 = 6;

/// A scene with levels of detail, the presets and the views.
pub struct LevelTrade<'a> {
    pub device: &'a Device,
    pub source: &'a SceneSource,
    /// Names and options without levels. The first are the exact options.
    pub presets: &'a [(&'a str, Options)],
    pub views: &'a [Camera],
    pub protocol: Protocol,
    /// Time for each kind of frames: fewer frames and views are measured if they take longer. `None`: no limit.
    pub patience: Option<Duration>,
}

/// The pictures that others are compared with.
struct Truth {
    exact: Vec<Pixels>,
    supersampled: Vec<Pixels>,
}

impl LevelTrade<'_> {
    /// Measures every preset with every splat budget. `progress` receives the completed fraction.
    ///
    /// # Errors
    /// If rendering fails, or the scene has no levels.
    pub fn measure(&self, progress: &dyn Fn(f64)) -> Result<LevelsReport> {
        let (_, exact) = &self.presets[0];
        let samples = SAMPLES_ALONG * SAMPLES_ALONG;
        let scene = self.scene(exact, 0, samples)?;
        let mut timing = Timing::new(self.protocol).thorough();
        let mut views = self.views.to_vec();
        if let Some(patience) = self.patience {
            let mut renderer = Renderer::new(self.device, exact, &scene)?;
            timing.within(patience, &mut renderer, (&views[0], Background::BLACK))?;
            views = timing.views(views.len()).map(|i| views[i].clone()).collect();
        }
        let supersampled = self.supersampled(&scene, &views)?;
        let exact_pictures = draw(&mut Renderer::new(self.device, exact, &scene)?, &views, Background::BLACK)?;
        let truth = Truth { exact: exact_pictures, supersampled };
        drop(scene);
        let mut points: Vec<LevelPoint> = Vec::new();
        let all = self.presets.len() * (HALVINGS as usize + 1);
        for (preset, options) in self.presets {
            // Without a splat budget the scene is loaded without pages of nodes, as always when all Gaussians are
            // drawn.
            let mut scene = self.scene(options, 0, 1)?;
            for halvings in 0..=HALVINGS {
                if halvings == 1 {
                    drop(scene);
                    scene = self.scene(options, 1, 1)?;
                }
                progress((points.len() + 1) as f64 / (all + 1) as f64);
                let visible = points.first().map_or(0.0, |exact| exact.visible);
                let splats = if halvings == 0 { 0 } else { two_digits(visible / f64::from(1 << halvings)) };
                let options = Options { splats, ..*options };
                let mut renderer = Renderer::new(self.device, &options, &scene)?;
                points.push(point((preset, &options), &mut renderer, (&views, &truth), &timing)?);
            }
        }
        mark_levels(&mut points);
        let Protocol { warmup, frames } = timing.protocol;
        Ok(LevelsReport { views: views.len(), warmup, frames, samples, points })
    }

    /// The scene on the device, with memory reserved for pictures of `samples` samples per pixel.
    fn scene(&self, options: &Options, splats: u32, samples: u32) -> Result<GpuScene> {
        let pixels: u64 = self.views[0].size_px.map(u64::from).iter().product();
        let reserve = 4 * 16 * pixels * u64::from(samples);
        self.source.upload_with(self.device, &Options { splats, ..*options }, Upload::reserving(reserve))
    }

    /// The views by the exact options, each pixel the mean of its samples.
    fn supersampled(&self, scene: &GpuScene, views: &[Camera]) -> Result<Vec<Pixels>> {
        let mut renderer = Renderer::new(self.device, &self.presets[0].1, scene)?;
        let picture = |view: &Camera| {
            let fine = view.sampled(view.size_px.map(|side| SAMPLES_ALONG * side));
            let drawn = renderer.render(&fine, Background::BLACK).and_then(|_| renderer.pixels());
            let [width, height] = fine.size_px;
            let what = || format!("the picture with {SAMPLES_ALONG} by {SAMPLES_ALONG} samples, {width}x{height}");
            Ok(drawn.with_context(what)?.averaged(SAMPLES_ALONG))
        };
        views.iter().map(picture).collect()
    }
}

/// Rounds a splat budget to two digits, at least 1.
fn two_digits(nodes: f64) -> u32 {
    let unit = 10_f64.powf(nodes.max(1.0).log10().floor() - 1.0).max(1.0);
    ((nodes / unit).round() * unit).max(1.0) as u32
}

fn point(
    (preset, options): (&str, &Options),
    renderer: &mut Renderer,
    (views, truth): (&[Camera], &Truth),
    timing: &Timing,
) -> Result<LevelPoint> {
    let gpu_ms = timing.median_ms(renderer, views, Background::BLACK)?;
    let (mut pictures, mut frames) = (Vec::new(), Vec::new());
    for view in views {
        frames.push(renderer.render(view, Background::BLACK)?);
        pictures.push(renderer.pixels()?);
    }
    let mean = |values: Vec<f64>| (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64);
    let details = || frames.iter().filter_map(|frame| frame.detail);
    Ok(LevelPoint {
        preset: preset.to_owned(),
        options: *options,
        warm_up: timing.warm_up.get(),
        gpu_ms,
        visible: mean(frames.iter().map(|frame| frame.totals.visible.into()).collect()).unwrap_or(0.0),
        pages: mean(details().map(|detail| detail.pages as f64).collect()),
        predicted_psnr: details().filter_map(|detail| detail.predicted_psnr).reduce(f64::min),
        from_exact: worst_of(&each(&pictures, &truth.exact)),
        from_supersampled: worst_of(&each(&pictures, &truth.supersampled)),
        is_pareto: false,
        is_pareto_supersampled: false,
    })
}

#[cfg(test)]
mod tests {
    use super::two_digits;

    #[test]
    fn numbers_of_nodes_have_two_digits() {
        let cases = [(0.2, 1), (3.4, 3), (47.6, 48), (123.0, 120), (98_765.0, 99_000), (1_499_999.0, 1_500_000)];
        for (nodes, rounded) in cases {
            assert_eq!(two_digits(nodes), rounded);
        }
    }
}
