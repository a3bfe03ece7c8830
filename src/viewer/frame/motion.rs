//! Frames that keep a rate: pictures in motion of a lower scale, and levels of detail with fewer nodes.

use std::time::Duration;

use super::session::Session;
use crate::gpu::Timing;
use crate::viewer::model::Event;

/// The time after a motion in which another one may follow, before the picture is drawn whole again.
const REST: Duration = Duration::from_millis(200);

impl Session {
    /// Follows the beginning and the end of motions: at rest, pictures have their full scale.
    pub(crate) fn follow_motion(&mut self) {
        let moves = self.viewer.moves();
        let Some(rate) = &mut self.viewer.rate else { return };
        if moves {
            rate.moved = Some(std::time::Instant::now());
        }
        if rate.moved.is_none_or(|moved| moved.elapsed() >= REST) && rate.scale != 1.0 {
            rate.scale = 1.0;
            self.viewer.events.emit(&Event::Scale { scale: 1.0 });
        }
    }

    /// The time until a picture of a lower scale is drawn whole again, if the view stays where it is.
    pub(crate) fn until_rest(&self) -> Duration {
        let Some(rate) = self.viewer.rate.as_ref().filter(|rate| rate.scale < 1.0) else { return Duration::MAX };
        REST.saturating_sub(rate.moved.map(|moved| moved.elapsed()).unwrap_or_default())
    }

    /// Sets what the next pictures leave out by the time that a frame took, if the frames keep a rate.
    pub(crate) fn keep_rate(&mut self, timings: &[Timing]) {
        let ms = timings.iter().filter(|timing| timing.depth == 0).map(|timing| timing.duration_ms).sum::<f64>();
        let (viewer, drawn) = (&mut self.viewer, &mut self.pair.first);
        let Some(drawn) = drawn.as_mut().filter(|_| ms > 0.0) else { return };
        if drawn.gaussians.is_none() {
            return match &mut viewer.rate {
                Some(rate) => {
                    rate.answer(ms);
                    drawn.renderer.limit_splats(Some(rate.splats as u32));
                }
                None => drawn.renderer.limit_splats(None),
            };
        }
        // The picture before may have another scale than the one that is planned.
        let now = drawn.plan.options.scale / viewer.options.scale;
        let (moves, is_building) = (viewer.moves(), viewer.building != [false; 2]);
        let Some(rate) = viewer.rate.as_mut().filter(|_| moves && !is_building) else { return };
        if rate.follow(ms, now) {
            self.viewer.events.emit(&Event::Scale { scale: self.viewer.motion_scale() });
        }
    }

    /// True if the pictures have the scale that the options ask for.
    pub(crate) fn has_full_scale(&self) -> bool {
        self.pair.first.as_ref().is_none_or(|first| first.plan.options.scale == self.viewer.options.scale)
    }

    /// What the title says of a picture in motion.
    pub(crate) fn said_of_motion(&self) -> String {
        match &self.pair.first {
            Some(first) if first.plan.options.scale < self.viewer.options.scale => {
                format!(" (moving, at scale {:.2})", first.plan.options.scale)
            }
            _ => String::new(),
        }
    }
}
