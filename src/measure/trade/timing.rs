//! Frame times of one setting after the other: warm-up and median.

use std::cell::Cell;
use std::time::{Duration, Instant};

use anyhow::Result;

use crate::camera::Camera;
use crate::gpu::Timestamps;
use crate::measure::bench::{Protocol, Statistics, WarmUp, WarmUpLimits};
use crate::render::Renderer;
use crate::rules::Background;

/// The frames of every measurement, and the warm-up before it.
pub(super) struct Timing {
    pub protocol: Protocol,
    limits: WarmUpLimits,
    /// The last warm-up.
    pub warm_up: Cell<Option<WarmUp>>,
}

impl Timing {
    /// Warm-ups are [`WarmUpLimits::BRIEF`].
    pub fn new(protocol: Protocol) -> Self {
        Self { protocol, limits: WarmUpLimits::BRIEF, warm_up: Cell::default() }
    }

    /// Uses the warm-up limits of reported times: [`WarmUpLimits::THOROUGH`].
    pub fn thorough(self) -> Self {
        Self { limits: WarmUpLimits::THOROUGH, ..self }
    }

    /// Reduces the frames so that those of a measurement take at most about `patience`; warm-ups are brief if this cuts
    /// any.
    pub fn within(
        &mut self,
        patience: Duration,
        renderer: &mut Renderer,
        (view, background): (&Camera, Background),
    ) -> Result<()> {
        renderer.render(view, background)?;
        let second = Instant::now();
        renderer.render(view, background)?;
        let protocol = self.protocol.within(patience, second.elapsed());
        if protocol != self.protocol {
            // The times of slow devices vary too much to become steady.
            (self.protocol, self.limits) = (protocol, WarmUpLimits::BRIEF);
        }
        Ok(())
    }

    /// Indices of the measured views among `all`, evenly spread: one per measured frame, since every setting also draws
    /// a picture of each.
    pub fn views(&self, all: usize) -> impl Iterator<Item = usize> + use<> {
        let count = self.protocol.frames.min(all);
        (0..count).map(move |i| i * all / count)
    }

    /// Median GPU time of a frame over the views, in milliseconds, after a warm-up.
    pub fn median_ms(&self, renderer: &mut Renderer, views: &[Camera], background: Background) -> Result<f64> {
        renderer.set_timestamps(Timestamps::Outermost);
        let limits = self.limits.after(self.warm_up.get());
        let mut frame = |view: usize| Ok(renderer.render(&views[view % views.len()], background)?.gpu_ms());
        self.warm_up.set(self.protocol.warm_up(views.len(), limits, &mut frame)?);
        Ok(Statistics::of((0..self.protocol.frames).map(frame).collect::<Result<Vec<f64>>>()?).median)
    }
}
