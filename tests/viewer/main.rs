//! The viewer: in a window, without one, and the navigation.

#[path = "../common/mod.rs"]
mod common;

mod frames;
mod navigator;
mod window;
mod window_errors;
