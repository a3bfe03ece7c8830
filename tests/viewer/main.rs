//! The viewer: in a window, without one, and the navigation.

#[path = "../common/mod.rs"]
mod common;

#[cfg(unix)]
mod control;
mod edits;
mod file_watch;
mod frames;
mod interaction;
mod lenses;
mod measures;
mod monkey;
mod motion;
mod navigator;
mod order;
mod paged;
mod poses;
mod readout;
mod sharing;
mod timeline;
mod wayland;
mod window;
mod window_errors;
mod window_events;
mod window_monkey;
