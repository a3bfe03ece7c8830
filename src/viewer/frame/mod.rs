//! A frame of the viewer: from input to pictures and panels on the screen.
//!
//! - `session` - `Session`, a viewer with its device: one frame from input to screen
//! - `requests` - execution of the requests that need the device
//! - `selection` - selections on the device, and the marks of edited scenes there
//! - `job_events` - handling of the events of jobs, and starting the builds of pictures
//! - `screen` - drawing and presenting pictures with panels, with frames in flight
//! - `motion` - pictures of a lower scale during motion, so that frames keep a rate
//! - `level_error` - the PSNR of levels of detail, measured while the view rests
//! - `residency` - residency of the pages of scenes that are read page by page

mod job_events;
mod level_error;
mod motion;
mod requests;
mod residency;
mod screen;
mod selection;
mod session;

pub(crate) use screen::{Screen, Shown};
pub use session::{FrameOutput, Session};
