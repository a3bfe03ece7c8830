//! The viewer: in a window, without one, and the navigation.

#[path = "../common/mod.rs"]
mod common;

mod edits;
mod following;
mod frames;
mod mends;
mod monkey;
mod motion;
mod navigator;
mod poses;
mod readings;
mod wayland;
mod window;
mod window_errors;
mod window_mends;
