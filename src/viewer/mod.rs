//! The window: opens scenes, flies through them, shows what every stage costs, and looks inside the pipeline.

mod history;
mod jobs;
mod keys;
mod measuring;
mod pictures;
mod screen;
