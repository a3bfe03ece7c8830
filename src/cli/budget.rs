//! Arguments for an error budget, for which the options are chosen automatically.

use anyhow::Result;

use super::drawable::Drawable;
use super::headings::ACCURACY;
use super::{Usage, progress, remark, values};
use crate::camera::Camera;
use crate::gpu::Device;
use crate::measure::trade::{Budget, choose_for};
use crate::options::Options;
use crate::rules::Background;

/// Largest error of the pictures against the reference.
#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = ACCURACY)]
pub(super) struct BudgetArgs {
    /// The fastest options with colours within ERROR, like 0.02 or 4/255
    ///
    /// Several options are tried. Colours stay within ERROR of the reference (white is 1) by proof, or else by
    /// measurement on views of the scene, with a margin. Exit code 6 if no options do.
    #[arg(long, value_name = "ERROR", conflicts_with = "min_psnr", value_parser = values::error(values::MOST_ERROR))]
    pub max_error: Option<f64>,
    /// The fastest options with a PSNR of at least DB to the reference
    ///
    /// Several options are tried. Exit code 6 if no options have this PSNR.
    #[arg(long, value_name = "DB", value_parser = values::decibels)]
    pub min_psnr: Option<f64>,
}

impl BudgetArgs {
    /// The budget of the arguments, `None` without one.
    ///
    /// # Errors
    /// If the number is not a valid budget.
    pub fn budget(&self) -> Result<Option<Budget>, Usage> {
        match (self.max_error, self.min_psnr) {
            (Some(0.0), _) => Err(Usage("--max-error 0 is not an error over 0".to_owned())),
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
