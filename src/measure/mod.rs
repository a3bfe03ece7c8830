//! Measurements of the renderer: time (`bench`, `ladder`), accuracy (`metrics`), and the trade between them (`trade`).

pub mod bench;
pub mod ladder;
pub mod metrics;
pub mod trade;
