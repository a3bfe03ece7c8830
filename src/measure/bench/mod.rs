//! Speed: the measuring protocol, the report, its comparison with an earlier one, and plots.
//!
//! The protocol is the paper's: warm-up frames, then measured frames, along a scripted camera path. The warm-up goes on
//! until the frame time is steady.

mod bandwidth;
mod compare;
mod machine;
mod measure;
pub mod plot;
mod report;
mod statistics;
mod warm_up;

pub use bandwidth::copy_gb_s;
pub use compare::{Change, Foreign};
pub use machine::{ClockProbe, Clocks, DeviceReport, VersionReport};
pub(crate) use measure::notice;
pub use measure::{Bench, frame_ms, stage_times};
pub use report::{Allocation, Counts, FrameTimes, Report, Run, SceneReport, StageReport, Subject, image_hash};
pub use statistics::Statistics;
pub use warm_up::{Protocol, WarmUp, WarmUpLimits};
