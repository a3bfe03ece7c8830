//! A viewer that messages drive, in the place of panels and keys.
//!
//! - `messages` - the messages of both sides, in JSON
//! - `drive` - what messages do
//! - `state` - what a client shows of a viewer
//! - `news` - what a client was told of a viewer
//! - `control` - messages of a program of the same machine

#[cfg(unix)]
mod control;
mod drive;
mod messages;
mod news;
mod state;

#[cfg(unix)]
pub use control::Control;
#[cfg(feature = "serve")]
pub use {
    drive::{check_fps, drive},
    messages::{ClientMessage, ServerMessage, State},
    news::{News, Told},
    state::{is_of_render, state, welcome},
};
