//! What the renderer is measured with: time, accuracy, and the trade between them.

pub mod bench;
pub mod ladder;
pub mod metrics;
pub mod trade;
