//! The viewer: opens scenes in a window, moves through them, and shows the cost of every stage and its intermediate
//! results.
//!
//! Each room uses only rooms listed before it:
//! - `jobs` - work on other threads
//! - `model` - the state of a viewer
//! - `actions` - operations of users on the state, by subject
//! - `panels` - panels, input, and everything drawn over the picture
//! - `frame` - a frame from input to screen
//! - `remote` - a viewer that messages drive, in the place of panels and keys
//! - `window` - the window, and frames without one

mod actions;
mod frame;
mod jobs;
mod model;
mod panels;
pub(crate) mod remote;
mod window;

pub use actions::Program;
pub use frame::{FrameOutput, Session};
pub use model::{
    Bindings, Change, CompareMode, CompareTarget, CompareWith, Counts, Digest, Event, MeasureKind, Property,
    RecentState, Request, Selection, Setup, Start, Tab, Tool, Viewer, WindowRequest, view_mode, view_mode_names,
};
#[cfg(unix)]
#[doc(hidden)]
pub use remote::Control;
pub use window::{DEFAULT_SIZE, Fault, Offscreen, PATH_FPS, PageCounts, Summary, WindowSetup, run, run_offscreen};
