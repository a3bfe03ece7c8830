//! The window: opens scenes, flies through them, shows what every stage costs, and looks inside the pipeline.

mod actions;
mod frame;
mod jobs;
mod model;
mod panels;
mod window;

pub use actions::Program;
pub use frame::{Digest, FrameOutput, Session};
pub use model::{
    Bindings, Change, CompareMode, CompareTarget, CompareWith, Counts, How, Kept, Outline, Property, Request,
    Selection, Setup, Tab, Tool, Viewer, WindowRequest, view_mode, view_mode_names,
};
pub use window::{DEFAULT_SIZE, Fault, Offscreen, PACE, PageCounts, Summary, WindowSetup, run, run_offscreen};
