//! The warm-up before a measurement: frames until the frame time is steady.

use std::time::{Duration, Instant};

use anyhow::Result;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::statistics::Statistics;

/// The number of frames of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Protocol {
    /// Least number of frames before the measured ones, which go on until the frame time is steady; 0: no warm-up.
    pub warmup: usize,
    /// Measured frames, at least one.
    pub frames: usize,
}

/// Limits of a warm-up.
///
/// The frame time is steady if the median GPU times of two consecutive windows agree within 2 %. A window is a number
/// of whole rounds over the same views. In the first process that builds a preset's pipelines, frames on an H100 took
/// 2 to 4 times as long for more than a second: a window must not be much shorter, because two short ones within such a
/// slow start agree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WarmUpLimits {
    /// Least duration of a window.
    pub window: Duration,
    /// The warm-up ends after this time even if the frame time is not steady.
    pub limit: Duration,
}

/// A warm-up that took place.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WarmUp {
    /// Frames drawn before the measured ones.
    pub frames: usize,
    /// Duration in seconds.
    pub seconds: f64,
    /// The median GPU times of the last two windows agree within 2 %; false if the time limit ended the warm-up.
    pub is_steady: bool,
}

/// Least number of frames of a measurement that is kept short.
const LEAST_FRAMES: usize = 2;
/// Largest relative difference of the medians of two windows of a steady frame time.
const TOLERANCE: f64 = 0.02;
/// Most views of a round, spread over all views.
const MAX_ROUND: usize = 25;

impl WarmUpLimits {
    /// For reports: windows of 1 s, at most 10 s.
    pub const THOROUGH: Self = Self { window: Duration::from_secs(1), limit: Duration::from_secs(10) };
    /// For choices during which a user waits: windows of 0.25 s, at most 1 s. Long enough to raise the clocks of an
    /// idle device (over 0.1 s on an H100).
    pub const BRIEF: Self = Self { window: Duration::from_millis(250), limit: Duration::from_secs(1) };

    /// The limits of the warm-up after `done`. A device that was not steady once gets time for two windows only.
    #[must_use]
    pub fn after(self, done: Option<WarmUp>) -> Self {
        match done {
            Some(WarmUp { is_steady: false, .. }) => Self { limit: self.limit.min(self.window * 5 / 2), ..self },
            _ => self,
        }
    }
}

impl WarmUp {
    /// Both warm-ups as one.
    #[must_use]
    pub fn and(self, next: Self) -> Self {
        Self {
            frames: self.frames + next.frames,
            seconds: self.seconds + next.seconds,
            is_steady: self.is_steady && next.is_steady,
        }
    }
}

impl Protocol {
    /// Reduces the frames so that each kind takes at most `patience` if a frame takes `frame`, but not below two.
    #[must_use]
    pub fn within(self, patience: Duration, frame: Duration) -> Self {
        let most = (patience.as_secs_f64() / frame.as_secs_f64().max(1e-9)) as usize;
        let most = most.max(LEAST_FRAMES);
        Self { warmup: self.warmup.min(most), frames: self.frames.min(most) }
    }

    /// Draws frames until their time is steady or `limits` end the warm-up. `frame` draws the view with the given index
    /// (less than `views`) and returns its GPU time in milliseconds. Returns `None` if `warmup` is 0.
    ///
    /// # Errors
    /// The errors of `frame`.
    pub fn warm_up(
        self,
        views: usize,
        limits: WarmUpLimits,
        frame: impl FnMut(usize) -> Result<f64>,
    ) -> Result<Option<WarmUp>> {
        let started = Instant::now();
        self.warm_up_by(views, limits, frame, || started.elapsed())
    }

    /// As [`Protocol::warm_up`]; `clock` returns the time since the begin.
    fn warm_up_by(
        self,
        views: usize,
        limits: WarmUpLimits,
        mut frame: impl FnMut(usize) -> Result<f64>,
        clock: impl Fn() -> Duration,
    ) -> Result<Option<WarmUp>> {
        if self.warmup == 0 {
            return Ok(None);
        }
        // The first frame may grow buffers; the time of the second gives the number of frames per window.
        frame(0)?;
        let second = clock();
        frame(0)?;
        let in_window = limits.window.as_secs_f64() / (clock() - second).as_secs_f64().max(1e-6);
        let round = views.min(MAX_ROUND).min(in_window as usize).max(1);
        let (mut frames, mut is_steady, mut before) = (2, false, None);
        let (mut window, mut begin) = (Vec::new(), clock());
        while frames < self.warmup || !is_steady && clock() < limits.limit {
            window.push(frame(window.len() % round * views / round)?);
            frames += 1;
            if window.len() % round == 0 && clock() - begin >= limits.window {
                let median = Statistics::of(window.drain(..)).median;
                is_steady = before.is_some_and(|before: f64| (median - before).abs() <= TOLERANCE * before);
                (before, begin) = (Some(median), clock());
            }
        }
        Ok(Some(WarmUp { frames, seconds: clock().as_secs_f64(), is_steady }))
    }
}

#[cfg(test)]
mod tests {
    use std::cell::{Cell, RefCell};

    use super::*;

    /// Warms up with frames whose GPU time in milliseconds is `ms` of the frame's number, the time before it in
    /// milliseconds, and the view. Every frame takes as long on the clock as on the GPU.
    fn warm_up(warmup: usize, views: usize, ms: impl Fn(usize, f64, usize) -> f64) -> WarmUp {
        let (now_ms, count) = (Cell::new(0.0), Cell::new(0));
        let frame = |view: usize| {
            let ms = ms(count.get(), now_ms.get(), view);
            now_ms.set(now_ms.get() + ms);
            count.set(count.get() + 1);
            Ok(ms)
        };
        let clock = || Duration::from_secs_f64(now_ms.get() * 1e-3);
        let protocol = Protocol { warmup, frames: 1 };
        protocol.warm_up_by(views, WarmUpLimits::THOROUGH, frame, clock).unwrap().unwrap()
    }

    #[test]
    fn a_steady_frame_time_takes_two_windows() {
        let WarmUp { seconds, is_steady, .. } = warm_up(30, 100, |_, _, _| 0.7);
        assert!(is_steady && (2.0..2.1).contains(&seconds), "{seconds}");
        // Noise of a tenth leaves the medians where they are.
        let noise = |i: usize| 1.0 + 0.1 * ((i * 7919 % 101) as f64 / 50.0 - 1.0);
        assert!(warm_up(30, 100, |i, _, _| 0.7 * noise(i)).is_steady);
    }

    #[test]
    fn a_slow_start_is_waited_for() {
        // An H100 in the first process that builds the pipelines.
        let WarmUp { seconds, is_steady, .. } = warm_up(30, 100, |i, _, _| if i < 600 { 1.95 } else { 0.69 });
        assert!(is_steady && (3.0..3.2).contains(&seconds), "{seconds}");
        // Frames that get faster until 4.5 s have passed.
        let WarmUp { seconds, is_steady, .. } = warm_up(30, 100, |_, at, _| (4.0 - at / 1500.0).max(1.0));
        assert!(is_steady && seconds > 5.5, "{seconds}");
    }

    #[test]
    fn a_drifting_or_noisy_frame_time_ends_at_the_limit() {
        let drifting = warm_up(30, 100, |_, at, _| 1.0 + at * 4e-5);
        let noisy = warm_up(30, 100, |_, at, _| 1.0 + 0.3 * (at / 500.0).sin());
        for WarmUp { seconds, is_steady, .. } in [drifting, noisy] {
            assert!(!is_steady && (10.0..10.1).contains(&seconds), "{seconds}");
        }
    }

    #[test]
    fn windows_show_the_same_views() {
        // Views near the scene take five times as long.
        let WarmUp { seconds, is_steady, .. } = warm_up(30, 200, |_, _, view| 1.0 + view as f64 * 0.02);
        assert!(is_steady && seconds < 2.3, "{seconds}");
        let seen = RefCell::new(Vec::new());
        let slow = warm_up(1, 200, |_, _, view| {
            seen.borrow_mut().push(view);
            300.0
        });
        assert!(slow.is_steady);
        let rounds = [0, 66, 133].repeat((slow.frames - 2) / 3);
        assert_eq!(seen.into_inner(), [vec![0, 0], rounds].concat());
    }

    #[test]
    fn slow_frames_make_short_windows() {
        let slow = warm_up(1, 100, |_, _, _| 1500.0);
        assert_eq!((slow.frames, slow.is_steady), (4, true));
        let slower = warm_up(1, 100, |_, _, _| 6000.0);
        assert_eq!((slower.frames, slower.is_steady), (2, false));
    }

    #[test]
    fn the_least_number_of_frames_is_kept() {
        assert_eq!(warm_up(5000, 100, |_, _, _| 0.7).frames, 5000);
        assert_eq!(warm_up(8, 1, |_, _, _| 3000.0).frames, 8, "longer than the limit");
        let none = Protocol { warmup: 0, frames: 1 };
        assert_eq!(none.warm_up(1, WarmUpLimits::BRIEF, |_| panic!("no frame is drawn")).unwrap(), None);
    }

    #[test]
    fn slow_frames_are_measured_less_often() {
        let protocol = Protocol { warmup: 30, frames: 100 };
        let within = |ms: u64| protocol.within(Duration::from_secs(10), Duration::from_millis(ms));
        assert_eq!(within(1), protocol);
        assert_eq!(within(200), Protocol { warmup: 30, frames: 50 });
        assert_eq!(within(500), Protocol { warmup: 20, frames: 20 });
        assert_eq!(within(60_000), Protocol { warmup: 2, frames: 2 });
        let none = Protocol { warmup: 0, frames: 1 };
        assert_eq!(none.within(Duration::from_secs(1), Duration::from_secs(60)), none);
    }

    #[test]
    fn after_a_warm_up_without_success_the_next_is_short() {
        let done = |is_steady| Some(WarmUp { frames: 9, seconds: 10.0, is_steady });
        let limits = WarmUpLimits::THOROUGH;
        assert_eq!(limits.after(None), limits);
        assert_eq!(limits.after(done(true)), limits);
        assert_eq!(limits.after(done(false)).limit, Duration::from_millis(2500));
    }
}
