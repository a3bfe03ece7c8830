//! The command line program.

#[path = "../common/mod.rs"]
mod common;

#[cfg(unix)]
mod cluster;
mod commands;
mod knobs;
#[cfg(unix)]
mod outputs;
mod scenes;
mod shards;
mod usage;
mod verify;
