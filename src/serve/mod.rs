//! `smalto serve`: the viewer in browsers. One process has the device; each page has a view of its own.
//!
//! - `access` - who may connect
//! - `server` - HTTP and WebSocket: what comes in is checked and bounded here
//! - `outbox` - what waits to be sent on a connection
//! - `sessions` - the thread with the device: all viewers, drawn in turn
//! - `client` - one viewer, and the pictures that its page gets
//! - `pictures` - pictures as messages
//! - `link` - how large pictures may be
//! - `page/` - the page: HTML, style, script

mod access;
mod client;
mod link;
mod outbox;
mod pictures;
mod server;
mod sessions;

pub use access::{Access, new_token};
pub use server::{Limits, serve};
