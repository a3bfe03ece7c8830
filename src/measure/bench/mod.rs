//! How fast, measured: the protocol, the report and its comparison with an earlier one, the plots.
//!
//! The protocol is the paper's: frames to warm up, then frames to measure, along a scripted path.

mod bandwidth;
mod compare;
mod least_bytes;
mod machine;
mod measure;
pub mod plot;
mod report;
mod statistics;

pub use bandwidth::copy_gb_s;
pub use compare::{Change, Foreign};
pub use machine::{ClockProbe, Clocks, DeviceReport, VersionReport};
pub use measure::{Bench, Protocol, frame_ms, stage_times};
pub use report::{Allocation, Counts, FrameTimes, Report, Run, SceneReport, StageReport, Subject, image_hash};
pub use statistics::Statistics;
