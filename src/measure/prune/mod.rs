//! Fewer Gaussians for good: those that contribute least to some views are dropped, as many as a limit of the change of
//! these views allows.

mod limit;
mod order;
mod report;
mod search;

pub use limit::{Change, Limit};
pub use order::Order;
pub use report::{Kept, Others, Report, Subject, ViewReport, Worst, Written};
pub use search::{Cut, Step, compare, search};
