//! What users can do: methods of [`Viewer`](super::state::Viewer) that start jobs and move the view, by subject.

mod command;
mod compare;
mod export;
mod film;
mod measure;
mod open;
mod undo;
mod views;

pub use command::Program;
