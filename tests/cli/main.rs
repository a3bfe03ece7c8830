//! The command line program.

#[path = "../common/mod.rs"]
mod common;

#[cfg(unix)]
mod cluster;
mod commands;
mod completions;
mod documents;
mod films;
mod found_cameras;
mod help;
#[cfg(unix)]
mod hostile;
mod knobs;
mod lenses;
#[cfg(unix)]
mod outputs;
mod places;
mod prune;
mod reports;
mod scenes;
mod schemas;
mod shards;
mod start;
mod usage;
mod verify;
