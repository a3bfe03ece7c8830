//! `smalto serve`: what a client gets, and what a hostile one cannot do.

#![cfg(all(unix, feature = "serve"))]

#[path = "../common/mod.rs"]
mod common;

mod admission;
mod client;
mod control;
mod hostile;
mod page;
mod paths;
mod pictures;
mod proxy;
mod server;
