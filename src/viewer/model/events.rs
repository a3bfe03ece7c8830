//! Events for scripts (`--events`): one line of JSON each on standard output.

use std::io::Write;

use schemars::JsonSchema;
use serde::Serialize;

/// An event that scripts can react to: one line of `smalto view --events`.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum Event {
    /// The window is open.
    Open {
        device: String,
        size: [u32; 2],
    },
    /// The first frame with a scene was shown, `ms` after the start. If it did not show the whole scene, since that was
    /// read in part or missed pages, the first frame that does is reported, too.
    FirstFrame {
        ms: f64,
        is_whole: bool,
    },
    /// All scenes are read, and are drawn with this many Gaussians, hidden and deleted ones included.
    Scene {
        gaussians: usize,
        scenes: usize,
    },
    /// The numbers of Gaussians that are selected, hidden and deleted now.
    Edited {
        selected: usize,
        hidden: usize,
        deleted: usize,
    },
    /// A camera file with this many cameras was read.
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
    /// The window has no pixels any more (for example, it is minimized), or has pixels again.
    Hidden {
        is_hidden: bool,
    },
    Message {
        is_error: bool,
        text: String,
    },
    /// The scale of pictures in motion changed to this factor, so that frames keep a rate.
    Scale {
        scale: f32,
    },
    /// The picture of a paged scene began to wait for pages, or all pages for it are loaded.
    Residency {
        /// No page is loading for this picture.
        is_settled: bool,
        /// Pages drawn coarser than requested.
        missing: u32,
        /// Pages that are loading.
        coming: usize,
        /// Resident pages, and the capacity of the cache in pages.
        there: usize,
        fitting: usize,
    },
    /// The PSNR of the levels of detail of the shown picture against all Gaussians was measured.
    Levels {
        /// An estimate, dB; null if no pixel differs.
        psnr: Option<f64>,
        /// Its standard error, dB.
        standard_error: f64,
    },
    /// A picture or the frames of a path were written.
    Written {
        text: String,
    },
    /// The view was copied, as an entry of a cameras.json.
    Copied {
        view: serde_json::Value,
    },
    /// A command line that draws the picture was copied.
    CopiedCommand {
        command: String,
    },
    /// The view mode, or another setting of the inspection, changed.
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
        /// From an input to the submission of the frame that answers it.
        mean_input_to_submission_ms: f64,
        gpu_bytes: u64,
    },
}

/// Writes events to standard output, if they are enabled.
pub struct Events {
    are_enabled: bool,
}

impl Events {
    pub fn new(are_enabled: bool) -> Self {
        Self { are_enabled }
    }

    pub fn emit(&self, event: &Event) {
        if self.are_enabled {
            let mut out = std::io::stdout().lock();
            // The reader may have closed the pipe.
            let _ = serde_json::to_writer(&mut out, event).map_err(std::io::Error::from);
            let _ = out.write_all(b"\n").and_then(|()| out.flush());
        }
    }
}
