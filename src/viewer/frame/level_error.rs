//! The PSNR of levels of detail, measured while the view rests.

use std::time::{Duration, Instant};

use anyhow::Result;

use super::session::Session;
use crate::gpu::DeviceLost;
use crate::host_memory::OutOfMemory;
use crate::render::PATCHES;
use crate::viewer::model::{Event, LevelError};

/// The strata of one step. A step of one takes about as long.
const STRATA: usize = 4;

/// The time that a frame may spend on them, if one step takes less.
const BUDGET: Duration = Duration::from_millis(8);

impl Session {
    /// True if the PSNR of the shown picture is to be measured yet: the view rests, and the levels that are asked for
    /// are shown.
    pub(crate) fn is_to_be_measured(&self) -> bool {
        let (Some(first), Some(camera)) = (&self.pair.first, &self.viewer.pictures.view) else { return false };
        // With a frame rate, the number of nodes changes after the picture.
        let keeps_rate = self.viewer.timing.rate.is_some();
        let rests = !self.viewer.pictures.are_stale && !self.viewer.is_moving() && !keeps_rate;
        rests && first.has_measurable_levels() && !first.is_measured(camera, self.viewer.view.background)
    }

    /// Goes on to measure the PSNR of the shown picture.
    pub(crate) fn measure_levels(&mut self) -> Result<()> {
        if !self.is_to_be_measured() || self.screen.is_drawing() {
            return Ok(());
        }
        let viewer = &mut self.viewer;
        let background = viewer.view.background;
        let (Some(first), Some(camera)) = (&mut self.pair.first, &viewer.pictures.view) else { return Ok(()) };
        let is_of_picture = |measurement| first.renderer.is_measured_by(measurement, camera, background);
        if !first.level_error.measurement().is_some_and(is_of_picture)
            && first.begin_measurement(camera, background, PATCHES)?
        {
            viewer.pictures.are_stale = true;
            return Ok(());
        }
        let (started, mut shows_another) = (Instant::now(), false);
        while let LevelError::Running(measurement) = &mut first.level_error
            && started.elapsed() < BUDGET
        {
            match first.renderer.go_on_measuring(measurement, STRATA) {
                Ok(None) => {}
                Ok(Some(found)) => {
                    if first.end_measurement(found) {
                        viewer.pictures.are_stale = true;
                        break;
                    }
                    let psnr = Some(found.psnr()).filter(|db| db.is_finite());
                    viewer.events.emit(&Event::Levels { psnr, standard_error: found.standard_error_db() });
                    shows_another = true;
                }
                Err(error) if error.is::<DeviceLost>() => return Err(error),
                Err(error) => {
                    // Where memory is too small for it, pictures are shown as before.
                    if !error.is::<OutOfMemory>() {
                        viewer.messages.error(format!("the error of the levels is not known: {error:#}"));
                    }
                    first.level_error.end(None);
                }
            }
        }
        if shows_another {
            self.request_layout();
        }
        Ok(())
    }
}
