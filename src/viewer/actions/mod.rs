//! Operations of users: methods of `Viewer` that start jobs, take in their results, and move the view.
//!
//! - `open` - scenes, cameras, photographs and dropped files; closing scenes
//! - `project` - project files
//! - `keys` - what keys do
//! - `views` - moving the view: first view, cameras of the file, copied views
//! - `placement` - placing a scene by handles
//! - `ruler` - measuring with points; placing a scene by them
//! - `edit` - selecting, hiding and deleting Gaussians; saving the scene
//! - `undo` - undo and redo
//! - `compare` - the second picture of a comparison, photographs
//! - `measure` - costs of knobs, options for a budget, cameras against photographs
//! - `film` - the camera path
//! - `export` - writing pictures and films
//! - `command` - the command line that draws the picture

mod command;
mod compare;
mod edit;
mod export;
mod film;
mod keys;
mod measure;
mod open;
mod placement;
mod project;
mod ruler;
mod undo;
mod views;

pub use command::Program;
