//! What happens to the viewers of a server.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use super::outbox::Outbox;
use crate::viewer::remote::ClientMessage;

/// What happens to the viewers.
pub enum SessionEvent {
    Joined {
        id: u64,
        outbox: Arc<Outbox>,
        size: [u32; 2],
        view: Option<serde_json::Value>,
    },
    Said {
        id: u64,
        said: Said,
    },
    Left {
        id: u64,
    },
    Compressed {
        id: u64,
        pixels: u64,
        bytes: usize,
    },
    /// A job of a viewer has sent an event.
    Wake(u64),
}

/// A message of a client.
pub struct Said {
    pub at: Instant,
    pub message: ClientMessage,
    /// The file to open, if it asks for one.
    pub file: Option<PathBuf>,
}
