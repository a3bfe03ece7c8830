//! The window: opens scenes, flies through them, shows what every stage costs, and looks inside the pipeline.

mod comparison;
mod events;
mod export;
mod hands;
mod history;
mod jobs;
mod keys;
mod layers;
mod looks;
mod measuring;
mod messages;
mod news;
mod offscreen;
mod panels;
mod pictures;
mod screen;
mod session;
mod state;
mod timeline;
mod views;
mod window;

pub use comparison::{Way, With};
pub use history::Digest;
pub use keys::Bindings;
pub use looks::sight_names;
pub use offscreen::{Offscreen, Summary, run as run_offscreen};
pub use session::{Session, Turn};
pub use state::{CompareWith, Setup, Viewer, Wish};
pub use window::{Fault, Opening, run};
