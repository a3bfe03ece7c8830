//! The window: opens scenes, flies through them, shows what every stage costs, and looks inside the pipeline.
//!
//! Files depend on each other in one direction: plain data (`comparison`, `dialog`, `drag`, `edit`, `edited`,
//! `evaluation`,
//! `export`, `film`, `held`, `kept`, `layers`, `photographs`, `project`, `rate`, `still`, `undo`, `view_modes`) <-
//! `state` <- `plans` <- `actions` <- `input` and `panels` <- `session`, with its parts `motion`, `paging` and
//! `requests` <- `window` and `offscreen`. `jobs` runs threads, `job_events` handles what they report, `screen` owns
//! the frames on the GPU.

mod actions;
mod comparison;
mod dialog;
mod drag;
mod edit;
mod edited;
mod evaluation;
mod events;
mod export;
mod fault;
mod film;
mod follow;
mod gizmo;
mod held;
mod history;
mod input;
mod job_events;
mod jobs;
mod kept;
mod keys;
mod layers;
mod measuring;
mod messages;
mod motion;
mod offscreen;
mod paging;
mod panels;
mod photographs;
mod pictures;
mod plans;
mod project;
mod rate;
mod requests;
mod screen;
mod session;
mod shares;
mod state;
mod still;
mod undo;
mod view_modes;
mod window;
mod window_setup;

pub use actions::Program;
pub use comparison::{CompareMode, CompareTarget};
pub use drag::Tool;
pub use edit::{Change, Counts, How, Outline, Property, Selection};
pub use fault::Fault;
pub use history::Digest;
pub use kept::{Kept, Tab};
pub use keys::Bindings;
pub use offscreen::{Offscreen, PACE, PageCounts, Summary, run as run_offscreen};
pub use session::{FrameOutput, Session};
pub use state::{CompareWith, Request, Setup, Viewer, WindowRequest};
pub use view_modes::{view_mode, view_mode_names};
pub use window::run;
pub use window_setup::{DEFAULT_SIZE, WindowSetup};
