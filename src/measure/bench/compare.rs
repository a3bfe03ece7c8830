//! Comparison of a report with an earlier one, the baseline.

use super::report::{Report, Run, Subject};
use crate::render;

/// The change of a run against the baseline.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    pub title: String,
    /// Median GPU time of a frame in milliseconds, before and now.
    pub frame_ms: [f64; 2],
    /// The same for every stage that both runs have.
    pub stages: Vec<(String, [f64; 2])>,
    /// The last frames are different pictures.
    pub picture_differs: bool,
    /// The paths that drew the frames, before and now, if they differ.
    pub other_path: Option<[render::Path; 2]>,
}

/// The baseline was measured under other conditions.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct OtherConditions(String);

impl Report {
    /// Checks that `now` was measured on the same device with the same protocol as this baseline.
    ///
    /// # Errors
    /// [`OtherConditions`] with the first condition that differs.
    pub fn same_conditions(&self, now: &Self) -> Result<(), OtherConditions> {
        let same = |what: &str, mine: &str, theirs: &str| {
            let other_conditions = || OtherConditions(format!("its {what} is {mine}, this run's is {theirs}"));
            (mine == theirs).then_some(()).ok_or_else(other_conditions)
        };
        same("device", &self.device.name, &now.device.name)?;
        same("camera path", &self.path, &now.path)?;
        same("number of frames", &self.frames.to_string(), &now.frames.to_string())?;
        same("number of warm-up frames", &self.warmup.to_string(), &now.warmup.to_string())
    }

    /// The run with this subject.
    ///
    /// # Errors
    /// [`OtherConditions`] if there is none.
    pub fn run_of(&self, subject: &Subject) -> Result<&Run, OtherConditions> {
        let missing = || OtherConditions(format!("it has no run of {} from the same cameras", subject.title()));
        self.runs.iter().find(|run| run.subject == *subject).ok_or_else(missing)
    }
}

impl Change {
    /// The change from `before` to `now`.
    pub fn between(before: &Run, now: &Run) -> Self {
        let before_ms = |name: &str| Some(before.stages.iter().find(|stage| stage.name == name)?.ms.median);
        let stages = now.stages.iter().filter_map(|s| Some((s.name.clone(), [before_ms(&s.name)?, s.ms.median])));
        Self {
            title: now.subject.title(),
            frame_ms: [before.frame.gpu_ms.median, now.frame.gpu_ms.median],
            stages: stages.collect(),
            picture_differs: before.image_hash != now.image_hash,
            other_path: (before.drawn_by != now.drawn_by).then_some([before.drawn_by, now.drawn_by]),
        }
    }

    /// True if the frame takes longer than the baseline's by more than this fraction.
    pub fn is_regression(&self, threshold: f64) -> bool {
        self.frame_ms[1] > self.frame_ms[0] * (1.0 + threshold)
    }
}
