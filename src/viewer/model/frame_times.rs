//! GPU times of the last frames by stage, their statistics, and the pace of the window.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use crate::gpu::Timing;
use crate::measure::bench::Statistics;

/// Number of frames that are kept.
const CAPACITY: usize = 240;

/// Stage times of the last frames, in milliseconds.
#[derive(Default)]
pub struct FrameTimes {
    /// Names of the stages, in the order of the first frame that had them.
    stages: Vec<&'static str>,
    frames: VecDeque<Vec<f32>>,
    digest: Option<(Instant, Digest)>,
}

/// Statistics of the kept frames, in milliseconds.
pub struct Digest {
    pub stages: Vec<(&'static str, Statistics)>,
    pub whole: Statistics,
}

/// Least time between changes of the digest: users cannot read numbers that change faster.
const DIGEST_LIFETIME: Duration = Duration::from_millis(200);

impl FrameTimes {
    /// Adds the stages of a frame: the scopes of depth 1, and the outermost scopes other than "frame".
    pub fn add(&mut self, timings: &[Timing]) {
        // A frame without timed stages counts as one stage.
        let has_stages = timings.iter().any(|t| t.depth == 1);
        let outermost = timings.iter().filter(|t| t.depth == 0 && !(has_stages && t.name == "frame"));
        let mut stages: Vec<&Timing> = timings.iter().filter(|t| t.depth == 1).chain(outermost).collect();
        stages.sort_by(|a, b| a.start_ms.total_cmp(&b.start_ms));
        let mut times = vec![0.0; self.stages.len()];
        for stage in stages {
            let index = self.stages.iter().position(|name| *name == stage.name).unwrap_or_else(|| {
                self.stages.push(stage.name);
                times.push(0.0);
                times.len() - 1
            });
            times[index] += stage.duration_ms as f32;
        }
        if self.frames.len() == CAPACITY {
            self.frames.pop_front();
        }
        self.frames.push_back(times);
    }

    pub fn stages(&self) -> &[&'static str] {
        &self.stages
    }

    /// Milliseconds by stage, the oldest frame first. Older frames lack the stages that appeared later, at the end.
    pub fn frames(&self) -> impl ExactSizeIterator<Item = &[f32]> {
        self.frames.iter().map(Vec::as_slice)
    }

    /// Updates [`FrameTimes::digest`] if it is too old.
    pub fn summarize(&mut self) {
        let is_fresh = self.digest.as_ref().is_some_and(|(made, _)| made.elapsed() < DIGEST_LIFETIME);
        if !is_fresh {
            self.digest = self.digest_now().map(|digest| (Instant::now(), digest));
        }
    }

    /// Statistics of all kept frames; `None` if there are none.
    pub fn digest_now(&self) -> Option<Digest> {
        let stage = |(index, name): (usize, &&'static str)| {
            let times = self.frames.iter().map(|frame| f64::from(frame.get(index).copied().unwrap_or(0.0)));
            (*name, Statistics::of(times))
        };
        let whole = self.frames.iter().map(|frame| f64::from(frame.iter().sum::<f32>()));
        (!self.frames.is_empty()).then(|| Digest {
            stages: self.stages.iter().enumerate().map(stage).collect(),
            whole: Statistics::of(whole),
        })
    }

    /// The statistics that [`FrameTimes::summarize`] computed last.
    pub fn digest(&self) -> Option<&Digest> {
        self.digest.as_ref().map(|(_, digest)| digest)
    }

    pub fn clear(&mut self) {
        *self = Self::default();
    }
}

/// Counts of frames, and the latency from input to frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pace {
    pub shown: u64,
    pub drawn: u64,
    /// Refreshes that passed without a new frame while something moved.
    pub dropped: u64,
    /// Mean milliseconds from an input to the submission of the frame that answers it.
    pub mean_latency_ms: f64,
    answered: u64,
    /// Mean milliseconds between the last frames of a motion; 0 before the first.
    interval_ms: f64,
}

/// The weight of a new interval in the mean of the last ones.
const NEWEST: f64 = 0.1;

impl Pace {
    /// The frames a second of the last motion; `None` before the first.
    pub fn frames_per_second(&self) -> Option<f64> {
        (self.interval_ms > 0.0).then(|| 1e3 / self.interval_ms)
    }

    /// Records a frame that was submitted `latency_ms` after the input it answers.
    pub fn answer(&mut self, latency_ms: f64) {
        self.answered += 1;
        self.mean_latency_ms += (latency_ms - self.mean_latency_ms) / self.answered as f64;
    }

    /// Records a frame shown `interval_ms` after the previous one during a motion, on a screen that refreshes every
    /// `refresh_ms`.
    pub fn interval(&mut self, interval_ms: f64, refresh_ms: f64) {
        self.dropped += ((interval_ms / refresh_ms).round() as u64).saturating_sub(1);
        let weight = if self.interval_ms == 0.0 { 1.0 } else { NEWEST };
        self.interval_ms += weight * (interval_ms - self.interval_ms);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn timing(name: &'static str, depth: usize, start_ms: f64, duration_ms: f64) -> Timing {
        Timing { name, depth, start_ms, duration_ms }
    }

    #[test]
    fn stages_keep_their_order_and_add_up() {
        let mut times = FrameTimes::default();
        times.add(&[timing("blend", 1, 2.0, 3.0), timing("cull", 1, 0.0, 1.0), timing("frame", 0, 0.0, 9.0)]);
        assert_eq!(times.stages(), ["cull", "blend"]);
        times.add(&[timing("cull", 1, 0.0, 2.0), timing("cull", 1, 1.0, 2.0), timing("new", 1, 3.0, 1.0)]);
        assert_eq!(times.stages(), ["cull", "blend", "new"]);
        assert_eq!(times.frames().map(<[f32]>::to_vec).collect::<Vec<_>>(), [vec![1.0, 3.0], vec![4.0, 0.0, 1.0]]);
        times.summarize();
        let digest = times.digest().unwrap();
        assert_eq!((digest.stages[2].0, digest.stages[2].1.p99), ("new", 1.0));
        assert_eq!(digest.whole.median, 4.5);
    }

    #[test]
    fn frame_times_keep_no_more_frames_than_its_capacity() {
        let mut times = FrameTimes::default();
        (0..CAPACITY + 5).for_each(|i| times.add(&[timing("cull", 1, 0.0, i as f64)]));
        assert_eq!(times.frames().len(), CAPACITY);
        assert_eq!(times.frames().next().unwrap(), [5.0]);
    }

    #[test]
    fn late_frames_count_as_the_refreshes_they_missed() {
        let mut pace = Pace::default();
        for interval in [16.0, 17.0, 33.0, 50.0, 8.0] {
            pace.interval(interval, 16.7);
        }
        assert_eq!(pace.dropped, 1 + 2);
        let fps = pace.frames_per_second().unwrap();
        assert!((40.0..60.0).contains(&fps), "{fps}");
        [2.0, 4.0].into_iter().for_each(|ms| pace.answer(ms));
        assert_eq!(pace.mean_latency_ms, 3.0);
    }
}
