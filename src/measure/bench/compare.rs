//! A report beside an earlier one.

use super::report::{Report, Run, Subject};

/// How a run's frame changed.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    pub title: String,
    /// Median GPU time of a frame in milliseconds, before and now; then of every stage that both have.
    pub frame_ms: [f64; 2],
    pub stages: Vec<(String, [f64; 2])>,
    /// Whether the last frame is another picture.
    pub picture_differs: bool,
}

/// The earlier report measured something else.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Foreign(String);

impl Report {
    /// Whether `other` was measured on the same device by the same rules.
    pub fn same_conditions(&self, other: &Self) -> Result<(), Foreign> {
        let same = |what: &str, mine: &str, theirs: &str| {
            let foreign = || Foreign(format!("it is of another {what}: {mine}, not {theirs}"));
            (mine == theirs).then_some(()).ok_or_else(foreign)
        };
        same("device", &self.device.name, &other.device.name)?;
        same("camera path", &self.path, &other.path)?;
        same("number of frames", &self.frames.to_string(), &other.frames.to_string())?;
        same("number of frames to warm up", &self.warmup.to_string(), &other.warmup.to_string())
    }

    /// The run of this subject.
    pub fn run_of(&self, subject: &Subject) -> Result<&Run, Foreign> {
        let missing = || Foreign(format!("it has no run of {} from the same cameras", subject.title()));
        self.runs.iter().find(|run| run.subject == *subject).ok_or_else(missing)
    }
}

impl Change {
    /// From `before` to `now`.
    pub fn between(before: &Run, now: &Run) -> Self {
        let before_ms = |name: &str| Some(before.stages.iter().find(|stage| stage.name == name)?.ms.median);
        let stages = now.stages.iter().filter_map(|s| Some((s.name.clone(), [before_ms(&s.name)?, s.ms.median])));
        Self {
            title: now.subject.title(),
            frame_ms: [before.frame.gpu_ms.median, now.frame.gpu_ms.median],
            stages: stages.collect(),
            picture_differs: before.image_hash != now.image_hash,
        }
    }

    /// Whether the frame takes longer by more than this fraction.
    pub fn is_regression(&self, threshold: f64) -> bool {
        self.frame_ms[1] > self.frame_ms[0] * (1.0 + threshold)
    }
}
