//! Pruning: drops the Gaussians that contribute least to some views, as many as a limit on the change of these views
//! allows.
//!
//! - `order` - the order in which Gaussians are dropped
//! - `limit` - the change of a view, and its limit
//! - `search` - the most Gaussians that can be dropped within a limit
//! - `report` - the report as JSON

mod limit;
mod order;
mod report;
mod search;

pub use limit::{Change, Limit};
pub use order::Order;
pub use report::{Kept, Others, Report, Subject, ViewReport, Worst, Written};
pub use search::{Cut, Step, compare, search};
