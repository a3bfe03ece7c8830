//! Actions that measure what the knobs cost, and choose them within an error budget.

use std::sync::Arc;

use crate::camera::Camera;
use crate::gpu::Device;
use crate::measure::trade::{Budget, choose_for, spread};
use crate::scene::Gaussians;
use crate::storage::Statistics;
use crate::viewer::jobs::JobEvent;
use crate::viewer::measuring::costs;
use crate::viewer::state::Viewer;

/// Cameras of the file, besides the current view, for which a budget must hold.
const BUDGET_CAMERAS: usize = 7;

impl Viewer {
    /// Measures what the knobs cost in the current view, on another thread.
    pub fn start_measuring(&mut self, device: Device, scene: (Arc<Gaussians>, Arc<Statistics>)) {
        let (options, view, background) = (self.options, self.view(), self.background);
        self.is_measuring = true;
        self.measured_of = self.depicted();
        let work = move |_: &_| costs(&device, (&scene.0, &scene.1), &options, &view, background);
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
        self.budget.is_choosing = true;
        let work = move |_: &_| {
            let choice = choose_for(&device, (&scene.0, &scene.1), exact, &views, budget, &|_| {})?;
            Ok((choice.options, choice.explain()))
        };
        self.jobs.start(work, JobEvent::Chosen);
    }
}
