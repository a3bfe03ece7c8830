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
mod offscreen;
mod panels;
mod pictures;
mod screen;
mod session;
mod state;
mod timeline;
mod window;

pub use comparison::Way;
pub use keys::Bindings;
pub use looks::sight_names;
pub use offscreen::{Summary, run as run_offscreen};
pub use state::{CompareWith, Setup};
pub use window::{Fault, Opening, run};
