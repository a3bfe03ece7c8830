//! Measurements of the renderer: time (`bench`, `ladder`), accuracy (`metrics`), the trade between them (`trade`),
//! and what a scene can do without (`prune`).

pub mod bench;
pub mod metrics;
#[cfg(feature = "plots")]
#[doc(hidden)]
pub mod plot;
pub mod prune;
pub mod trade;
