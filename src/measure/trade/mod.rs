//! The cost of accuracy: time, memory and error of every knob on a scene, and the fastest options within an error
//! budget.

mod budget;
mod candidates;
mod certify;
mod measure;
#[cfg(feature = "plots")]
mod plot;
mod report;
mod search;

pub use budget::{Budget, Choice, Grounds, Unmeetable, choose, choose_for, spread};
pub use candidates::knobs;
pub use certify::certify;
pub use measure::Study;
#[cfg(feature = "plots")]
pub use plot::plot;
pub use report::{BudgetReport, CertificateReport, Point, Promise, Report, SettingReport, StageTime, mark_pareto};
pub use search::search;
