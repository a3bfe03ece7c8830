//! The command line program.

#[path = "../common/mod.rs"]
mod common;

mod commands;
mod films;
mod knobs;
#[cfg(unix)]
mod outputs;
mod scenes;
mod start;
mod usage;
