//! MAP

pub(crate) mod fallback;
mod prefetch;
mod schedule;
mod streamer;

#[cfg(test)]
mod streamer_tests;

pub use streamer::Residency;
pub(crate) use streamer::{Demand, Feed};
