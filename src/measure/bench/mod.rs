//! Speed: the measuring protocol, the report, and its comparison with an earlier one.
//!
//! The protocol is the paper's: warm-up frames, then measured frames, along a scripted camera path. The warm-up goes on
//! until the frame time is steady.
//!
//! - `measure` - the measurement of a run
//! - `warm_up` - protocol and warm-up
//! - `together` - several devices at the same time
//! - `split` - frames that several devices draw in bands
//! - `bandwidth`, `clocks` (`no_clocks` without the feature) - the device: copy bandwidth, clock rates
//! - `statistics` - minimum, median, mean, percentiles
//! - `report`, `machine` - the report as JSON and CSV; its entries of program and device
//! - `compare` - comparison with an earlier report

mod bandwidth;
#[cfg_attr(not(feature = "clocks"), path = "no_clocks.rs")]
mod clocks;
mod compare;
mod machine;
mod measure;
mod report;
mod split;
mod statistics;
mod together;
mod warm_up;

pub use bandwidth::copy_gb_s;
pub use clocks::ClockProbe;
pub use compare::{Change, OtherConditions};
pub use machine::{Clocks, DeviceReport, VersionReport};
pub(crate) use measure::notice;
pub use measure::{Bench, stage_times};
pub use report::{
    Allocation, Counts, DetailReport, DeviceSpeed, FrameTimes, Report, Run, SceneReport, SplitDevice, SplitReport,
    StageReport, StageTime, Subject, image_hash, views_hash,
};
pub use split::split;
pub use statistics::Statistics;
pub use together::together;
pub use warm_up::{Protocol, WarmUp, WarmUpLimits};
