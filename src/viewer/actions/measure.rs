//! Actions that measure: costs of knobs, options within an error budget, cameras against their photographs.

use anyhow::{Result, ensure};

use crate::camera::{Camera, NamedCamera};
use crate::gpu::Device;
use crate::measure::trade::{Budget, choose_for, spread};
use crate::scene::Cancelled;
use crate::viewer::jobs::{Cancel, costs};
use crate::viewer::model::{
    Evaluation, JobEvent, MeasuredScene, PosedPhotograph, Purpose, Reporter, Reusable, Side, Viewer,
};

/// Cameras of the file, besides the current view, for which a budget must hold.
const BUDGET_CAMERAS: usize = 7;

/// Reports the progress of a measurement.
///
/// # Errors
/// [`Cancelled`], if the measurement was cancelled.
fn reported(done: f64, reporter: &Reporter, cancel: &Cancel) -> Result<()> {
    reporter.send(JobEvent::Measuring(done));
    ensure!(!cancel.is_cancelled(), Cancelled);
    Ok(())
}

impl Viewer {
    /// Starts to measure the costs of knobs in the current view.
    pub fn start_measuring(&mut self, device: Device, scene: MeasuredScene) {
        let (options, view, background) = (self.options, self.view.camera(), self.view.background);
        let cancel = self.measuring.begin(Purpose::Costs, self.picture_content());
        let work = move |reporter: &Reporter| {
            let progress = |done| reported(done, reporter, &cancel);
            let scene = scene.resolved()?;
            costs(&device, (&scene.0, &scene.1), &options, &view, background, &progress)
        };
        self.jobs.start(work, JobEvent::Measured);
    }

    /// Starts to choose the fastest options within the budget.
    pub fn start_choosing(&mut self, device: Device, scene: MeasuredScene) {
        let budget = match self.measuring.budget.is_psnr {
            true => Budget::MinPsnr(self.measuring.budget.min_psnr),
            false => Budget::MaxError(self.measuring.budget.max_error),
        };
        let exact = (self.options.untraded(), self.view.background);
        let cameras: Vec<Camera> = self.cameras.list.iter().map(|named| named.camera.resized(self.view.size)).collect();
        let views = std::iter::once(self.view.camera()).chain(spread(&cameras, BUDGET_CAMERAS)).collect::<Vec<_>>();
        let cancel = self.measuring.begin(Purpose::Choice, self.picture_content());
        let work = move |reporter: &Reporter| {
            let progress = |done| reported(done, reporter, &cancel);
            let scene = scene.resolved()?;
            let choice = choose_for(&device, (&scene.0, &scene.1), exact, &views, budget, &progress)?;
            Ok((choice.options, choice.explain()))
        };
        self.jobs.start(work, JobEvent::Chosen);
    }

    /// Starts to compare every camera with its photograph.
    pub fn start_evaluation(&mut self, device: Device, reusable: Option<Reusable>) {
        let plan = match self.plan(Side::First) {
            Ok(Some(plan)) => plan,
            Ok(None) => return self.messages.note("there is no scene to compare with photographs"),
            Err(problem) => return self.messages.error(format!("{problem:#}")),
        };
        let cameras = self.cameras.list.iter().enumerate();
        let pose = |(i, camera): (usize, &NamedCamera)| {
            let file = self.cameras.photographs.as_ref()?.of(camera)?;
            Some((i, camera.clone(), file.to_owned()))
        };
        let poses: Vec<PosedPhotograph> = cameras.filter_map(pose).collect();
        let cancel = self.measuring.begin(Purpose::Evaluation, self.picture_content());
        let background = self.view.background;
        let work = move |reporter: &Reporter| {
            let progress = |done| reported(done, reporter, &cancel);
            Evaluation::new(&device, (plan, reusable), &poses, background, &progress)
        };
        self.jobs.start(work, JobEvent::Evaluated);
    }
}
