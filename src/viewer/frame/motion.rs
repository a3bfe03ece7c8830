//! The control of the frame rate: a lower scale during motion, and fewer nodes of levels of detail.

use std::time::Duration;

use super::session::Session;
use crate::gpu::Timing;
use crate::viewer::model::Event;

/// Time after a motion before pictures have their full scale again, because another motion may follow.
const REST: Duration = Duration::from_millis(200);

impl Session {
    /// Records motion, and resets the scale of pictures once the view is at rest.
    pub(crate) fn update_motion(&mut self) {
        let moves = self.viewer.is_moving();
        let Some(rate) = &mut self.viewer.timing.rate else { return };
        if moves {
            rate.last_motion = Some(std::time::Instant::now());
        }
        if rate.last_motion.is_none_or(|time| time.elapsed() >= REST) && rate.scale != 1.0 {
            rate.scale = 1.0;
            self.viewer.events.emit(&Event::Scale { scale: 1.0 });
        }
    }

    /// The time until pictures have their full scale again if the view rests; [`Duration::MAX`] if they have it.
    pub(crate) fn until_rest(&self) -> Duration {
        let Some(rate) = self.viewer.timing.rate.as_ref().filter(|rate| rate.scale < 1.0) else { return Duration::MAX };
        REST.saturating_sub(rate.last_motion.map(|time| time.elapsed()).unwrap_or_default())
    }

    /// Adapts the limit of nodes or the scale of the next pictures to the GPU times of a frame, if frames keep a rate.
    pub(crate) fn keep_rate(&mut self, timings: &[Timing]) {
        let ms = timings.iter().filter(|timing| timing.depth == 0).map(|timing| timing.duration_ms).sum::<f64>();
        let (viewer, drawn) = (&mut self.viewer, &mut self.pair.first);
        let Some(drawn) = drawn.as_mut().filter(|_| ms > 0.0) else { return };
        if drawn.gaussians.is_none() {
            return match &mut viewer.timing.rate {
                Some(rate) => {
                    rate.adjust_splats(ms);
                    drawn.renderer.limit_splats(Some(rate.splats as u32));
                }
                None => drawn.renderer.limit_splats(None),
            };
        }
        // The current picture may have another scale than the planned one.
        let now = drawn.plan.options.scale / viewer.options.scale;
        let (moves, is_building) = (viewer.is_moving(), viewer.pictures.is_any_building());
        let Some(rate) = viewer.timing.rate.as_mut().filter(|_| moves && !is_building) else { return };
        if rate.adjust_scale(ms, now) {
            self.viewer.events.emit(&Event::Scale { scale: self.viewer.timing.motion_scale() });
        }
    }

    /// True if the pictures have the scale of the options.
    pub(crate) fn has_full_scale(&self) -> bool {
        self.pair.first.as_ref().is_none_or(|first| first.plan.options.scale == self.viewer.options.scale)
    }

    /// The note in the title about the scale of a picture in motion.
    pub(crate) fn motion_title(&self) -> String {
        match &self.pair.first {
            Some(first) if first.plan.options.scale < self.viewer.options.scale => {
                format!(" (moving, at scale {:.2})", first.plan.options.scale)
            }
            _ => String::new(),
        }
    }
}
