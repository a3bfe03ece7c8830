//! The cost of accuracy: time, memory and error of every knob on a scene, and the fastest options within an error
//! budget.

mod budget;
mod candidates;
mod certify;
mod levels;
mod measure;
mod report;
mod search;
mod timing;

pub use budget::{Budget, Choice, Grounds, Unmeetable, choose, choose_for, spread};
pub use candidates::knobs;
pub use certify::certify;
pub use levels::{LevelTrade, SAMPLES_ALONG};
pub use measure::Study;
pub use report::{
    BudgetReport, CertificateReport, LevelPoint, LevelsReport, Point, Promise, Report, SettingReport, StageTime,
    mark_pareto,
};
pub use search::search;

/// Receives the completed fraction of some work, 0 to 1; an error ends the work.
pub type Progress<'p> = &'p dyn Fn(f64) -> anyhow::Result<()>;
