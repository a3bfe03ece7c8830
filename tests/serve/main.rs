//! `smalto serve`: what a page gets, and what a hostile one cannot do.

#![cfg(all(unix, feature = "serve"))]

#[path = "../common/mod.rs"]
mod common;

mod access;
mod client;
mod control;
mod hostile;
mod page;
mod pictures;
mod server;
