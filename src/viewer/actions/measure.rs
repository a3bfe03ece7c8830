//! Actions that measure what the knobs cost, and choose them within an error budget.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Result, ensure};

use crate::camera::{Camera, NamedCamera};
use crate::gpu::Device;
use crate::measure::trade::{Budget, choose_for, spread};
use crate::packing::Statistics;
use crate::scene::{Cancelled, Gaussians};
use crate::viewer::frame::{Reusable, Side};
use crate::viewer::jobs::{Cancel, JobEvent, Reporter, costs};
use crate::viewer::model::{Evaluation, Measurement, Pose, Purpose, Viewer};

/// Cameras of the file, besides the current view, for which a budget must hold.
const BUDGET_CAMERAS: usize = 7;

/// Reports what is done of a measurement.
///
/// # Errors
/// [`Cancelled`], if that is wished.
fn reported(done: f64, reporter: &Reporter, cancel: &Cancel) -> Result<()> {
    reporter.send(JobEvent::Measuring(done));
    ensure!(!cancel.is_cancelled(), Cancelled);
    Ok(())
}

impl Viewer {
    /// Notes that a measurement begins; one that goes on is cancelled.
    fn begin_measurement(&mut self, purpose: Purpose) -> Cancel {
        let (of, since, cancel) = (self.depicted(), Instant::now(), Cancel::default());
        let measurement = Measurement { purpose, of, fraction: 0.0, since, cancel: cancel.clone() };
        if let Some(before) = self.measurement.replace(measurement) {
            before.cancel.cancel();
        }
        cancel
    }

    /// Measures what the knobs cost in the current view, on another thread.
    pub fn start_measuring(&mut self, device: Device, scene: (Arc<Gaussians>, Arc<Statistics>)) {
        let (options, view, background) = (self.options, self.view(), self.background);
        let cancel = self.begin_measurement(Purpose::Costs);
        let work = move |reporter: &Reporter| {
            let progress = |done| reported(done, reporter, &cancel);
            costs(&device, (&scene.0, &scene.1), &options, &view, background, &progress)
        };
        self.jobs.start(work, JobEvent::Measured);
    }

    /// Chooses the fastest options within the budget, on another thread.
    pub fn start_choosing(&mut self, device: Device, scene: (Arc<Gaussians>, Arc<Statistics>)) {
        let budget = match self.budget.is_psnr {
            true => Budget::MinPsnr(self.budget.min_psnr),
            false => Budget::MaxError(self.budget.max_error),
        };
        let exact = (self.options.untraded(), self.background);
        let cameras: Vec<Camera> = self.cameras.iter().map(|named| named.camera.resized(self.size)).collect();
        let views = std::iter::once(self.view()).chain(spread(&cameras, BUDGET_CAMERAS)).collect::<Vec<_>>();
        let cancel = self.begin_measurement(Purpose::Choice);
        let work = move |reporter: &Reporter| {
            let progress = |done| reported(done, reporter, &cancel);
            let choice = choose_for(&device, (&scene.0, &scene.1), exact, &views, budget, &progress)?;
            Ok((choice.options, choice.explain()))
        };
        self.jobs.start(work, JobEvent::Chosen);
    }
    /// Compares every camera with its photograph, on another thread.
    pub fn start_evaluation(&mut self, device: Device, reusable: Option<Reusable>) {
        let plan = match self.plan(Side::First) {
            Ok(Some(plan)) => plan,
            Ok(None) => return self.messages.note("there is no scene to compare with photographs"),
            Err(problem) => return self.messages.error(format!("{problem:#}")),
        };
        let cameras = self.cameras.iter().enumerate();
        let pose = |(i, camera): (usize, &NamedCamera)| {
            let file = self.photographs.as_ref()?.of(camera)?;
            Some((i, camera.clone(), file.to_owned()))
        };
        let poses: Vec<Pose> = cameras.filter_map(pose).collect();
        let (background, cancel) = (self.background, self.begin_measurement(Purpose::Evaluation));
        let work = move |reporter: &Reporter| {
            let progress = |done| reported(done, reporter, &cancel);
            Evaluation::new(&device, (plan, reusable), &poses, background, &progress)
        };
        self.jobs.start(work, JobEvent::Evaluated);
    }
}
