//! A frame of the viewer: from input to pictures and panels on the screen.
//!
//! - `session` - `Session`, a viewer with its device: one frame from input to screen
//! - `requests` - execution of the requests that need the device
//! - `pictures` - plans of pictures, and their builds: a scene on the GPU with its renderer
//! - `screen` - drawing and presenting pictures with panels, with frames in flight
//! - `frame_times` - GPU times of the last frames, and the pace of the window
//! - `motion` - pictures of a lower scale during motion, so that frames keep a rate
//! - `residency` - residency of the pages of scenes that are read page by page

mod frame_times;
mod motion;
mod pictures;
mod requests;
mod residency;
mod screen;
mod session;

pub use frame_times::Digest;
pub(crate) use frame_times::{FrameTimes, Pace};
pub(crate) use pictures::{Drawn, Plan, Reusable, Side, needs_whole};
pub(crate) use screen::{Pair, Screen, Second, Shown};
pub use session::{FrameOutput, Session};
