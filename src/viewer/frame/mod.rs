//! MAP

mod frame_times;
mod motion;
mod pictures;
mod requests;
mod residency;
mod screen;
mod session;

pub use frame_times::Digest;
pub(crate) use frame_times::{History, Pace};
pub(crate) use pictures::{Drawn, Plan, Reusable, Side, needs_whole};
pub(crate) use screen::{Pair, Screen, Second, Shown};
pub use session::{FrameOutput, Session};
