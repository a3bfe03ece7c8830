//! A viewer that messages drive, in the place of panels and keys.
//!
//! - `messages` - the messages of both sides, in JSON
//! - `drive` - what messages do
//! - `state` - what a client shows of a viewer

mod drive;
mod messages;
mod state;

pub use drive::drive;
pub use messages::{ClientMessage, ServerMessage, State};
pub use state::{is_of_render, state, welcome};
