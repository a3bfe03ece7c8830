//! The cost of accuracy: time, memory and error of every knob on a scene, and the fastest options within an error
//! budget.
//!
//! - `measure` - a scene, its views and the exact pictures: time and errors of given options
//! - `timing` - frame times of one setting after the other
//! - `search` - options with knobs turned: each alone, and a search over combinations
//! - `budget` - the fastest options within an error budget
//! - `certify` - certificates compared with the true errors
//! - `levels` - presets with decreasing splat budgets
//! - `report` - the report as JSON

mod budget;
mod certify;
mod levels;
mod measure;
mod report;
mod search;
mod timing;

pub use budget::{Budget, Choice, Grounds, Unmeetable, choose, choose_for, spread};
pub use certify::certify;
pub use levels::{LevelTrade, SAMPLES_ALONG};
pub use measure::Study;
pub use report::{
    BudgetReport, CertificateReport, LevelPoint, LevelsReport, Point, Promise, Report, SettingReport, StageTime,
    mark_pareto,
};
pub use search::{knobs, search};

/// Receives the completed fraction of some work, 0 to 1; an error ends the work.
pub type Progress<'p> = &'p dyn Fn(f64) -> anyhow::Result<()>;
