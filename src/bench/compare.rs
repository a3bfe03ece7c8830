//! A report beside an earlier one.

use super::report::{Report, Run};

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

impl Change {
    /// Whether the frame takes longer by more than this fraction.
    pub fn is_regression(&self, threshold: f64) -> bool {
        self.frame_ms[1] > self.frame_ms[0] * (1.0 + threshold)
    }
}

/// The earlier report measured something else.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Foreign(String);

/// The changes of every run of `now`, in its order.
pub fn compare(before: &Report, now: &Report) -> Result<Vec<Change>, Foreign> {
    let same = |what: &str, then: &str, today: &str| {
        (then == today).then_some(()).ok_or_else(|| Foreign(format!("it is of another {what}: {then}, not {today}")))
    };
    same("device", &before.device.name, &now.device.name)?;
    same("camera path", &before.path, &now.path)?;
    same("number of frames", &before.frames.to_string(), &now.frames.to_string())?;
    let change = |run: &Run| {
        let is_twin = |b: &&Run| b.scene.hash == run.scene.hash && b.size == run.size && b.preset == run.preset;
        let twin = before.runs.iter().find(is_twin);
        twin.map(|twin| Change::between(twin, run)).ok_or_else(|| Foreign(format!("it has no run of {}", run.title())))
    };
    now.runs.iter().map(change).collect()
}

impl Change {
    fn between(before: &Run, now: &Run) -> Self {
        let stage = |name: &str| before.stages.iter().find(|stage| stage.name == name);
        let stages = now.stages.iter().filter_map(|s| Some((s.name.clone(), [stage(&s.name)?.ms.median, s.ms.median])));
        Self {
            title: now.title(),
            frame_ms: [before.frame.gpu_ms.median, now.frame.gpu_ms.median],
            stages: stages.collect(),
            picture_differs: before.image_hash != now.image_hash,
        }
    }
}
