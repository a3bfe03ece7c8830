//! `smalto serve`: the viewer in browsers. One process has the device; each client has a view of its own.
//!
//! - `admission` - who may connect
//! - `server` - HTTP and WebSocket: what comes in is checked and bounded here
//! - `outbox` - what waits to be sent on a connection
//! - `sessions` - the thread with the device: all viewers, drawn in turn
//! - `session_event` - what happens to the viewers
//! - `client` - one viewer, and the pictures that its client gets
//! - `films` - films that browsers fetch
//! - `pictures` - pictures as messages
//! - `link` - how large pictures may be
//! - `page/` - the web page: HTML, style, script

mod admission;
mod client;
mod films;
mod link;
mod outbox;
mod pictures;
mod server;
mod session_event;
mod sessions;

pub use admission::{Admission, Proxy, new_token};
pub use server::{Limits, serve};
pub use sessions::Reopening;
