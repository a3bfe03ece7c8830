//! Arguments for an error budget, for which the options are chosen automatically.

use anyhow::Result;

use super::drawable::Drawable;
use super::{Usage, progress, remark};
use crate::camera::Camera;
use crate::gpu::Device;
use crate::measure::trade::{Budget, choose_for};
use crate::options::Options;
use crate::rules::Background;

/// Largest error of the pictures against the reference.
#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = "Error budget")]
pub(super) struct BudgetArgs {
    /// Choose the fastest of some options whose colour values differ from the reference by at most ERROR (white is 1):
    /// by proof, else by measurement on views of the scene, with a margin. Exit code 6 if there are none
    #[arg(long, value_name = "ERROR", conflicts_with = "min_psnr")]
    pub max_error: Option<f64>,
    /// Choose the fastest of some options whose PSNR to the reference is at least DB. Exit code 6 if there are none
    #[arg(long, value_name = "DB")]
    pub min_psnr: Option<f64>,
}

impl BudgetArgs {
    /// The budget of the arguments, `None` without one.
    ///
    /// # Errors
    /// If the number is not a valid budget.
    pub fn budget(&self) -> Result<Option<Budget>, Usage> {
        let wrong = |name: &str, value: f64, what: &str| Err(Usage(format!("--{name} {value} is not {what}")));
        match (self.max_error, self.min_psnr) {
            (Some(error), _) if !(error > 0.0 && error.is_finite()) => wrong("max-error", error, "an error over 0"),
            (_, Some(db)) if !(db > 0.0 && db < 1000.0) => wrong("min-psnr", db, "a PSNR in dB over 0"),
            (Some(error), _) => Ok(Some(Budget::MaxError(error))),
            (_, Some(db)) => Ok(Some(Budget::MinPsnr(db))),
            (None, None) => Ok(None),
        }
    }

    /// The options to draw `views` with: with a budget the chosen ones, which are reported on stderr, else `options`.
    /// `exact` has the rules of the picture and every knob at its most exact step.
    ///
    /// # Errors
    /// If no options stay within the budget, or if rendering fails.
    pub fn choose(
        &self,
        device: &Device,
        scene: &Drawable,
        views: &[Camera],
        (exact, background): (Options, Background),
        options: Options,
    ) -> Result<Options> {
        let Some(budget) = self.budget()? else {
            return Ok(options);
        };
        let scene = scene.in_memory("an error budget")?;
        // Candidates have most stages in common, which take a software device longer to compile than to run.
        device.keep_pipelines();
        let bar = progress::Bar::new("choosing");
        let choice = choose_for(device, scene, (exact, background), views, budget, &|done| bar.advance(done))?;
        drop(bar);
        remark(&format!("note: {}", choice.explain()));
        Ok(choice.options)
    }
}
