//! What users can do: methods of `Viewer` that start jobs and move the view, by subject.

mod command;
mod compare;
mod edit;
mod export;
mod film;
mod measure;
mod open;
mod place;
mod project;
mod undo;
mod views;

pub use command::Program;
