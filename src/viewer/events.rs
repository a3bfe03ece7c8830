//! What happens, for scripts: a line of JSON each on standard output.

use std::io::Write;

use serde::Serialize;

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum Event {
    /// The window is open.
    Open {
        device: String,
        size: [u32; 2],
    },
    /// The first frame that shows a scene, whole or what is read of it, so many milliseconds after the start.
    FirstFrame {
        ms: f64,
        is_whole: bool,
    },
    /// All scenes are read, and this many Gaussians are drawn.
    Scene {
        gaussians: usize,
        scenes: usize,
    },
    /// A view of this many cameras is there to step through.
    Cameras {
        count: usize,
    },
    /// The view went to a camera of the file.
    Camera {
        index: usize,
        name: String,
    },
    Resized {
        size: [u32; 2],
    },
    /// The window lost or got back its pixels.
    Hidden {
        is_hidden: bool,
    },
    Message {
        is_error: bool,
        text: String,
    },
    /// A picture was written.
    Written {
        text: String,
    },
    /// The view as an entry of a cameras.json, as it was copied.
    Copied {
        view: serde_json::Value,
    },
    /// How the pictures are looked at, or compared, has changed.
    Look {
        look: String,
    },
    Explained {
        pixel: [u32; 2],
        splats: usize,
        colour: [f32; 3],
    },
    /// The window is closed.
    Closed {
        frames_shown: u64,
        frames_drawn: u64,
        frames_dropped: u64,
        mean_latency_ms: f64,
        gpu_bytes: u64,
    },
}

/// Tells events, if anyone wants to hear them.
pub struct Events {
    are_told: bool,
}

impl Events {
    pub fn new(are_told: bool) -> Self {
        Self { are_told }
    }

    pub fn tell(&self, event: &Event) {
        if self.are_told {
            let mut out = std::io::stdout().lock();
            // Whoever listened may have left.
            let _ = serde_json::to_writer(&mut out, event).map_err(std::io::Error::from);
            let _ = out.write_all(b"\n").and_then(|()| out.flush());
        }
    }
}
