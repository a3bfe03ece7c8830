//! A drag over the picture.

use egui::{PointerButton, Pos2};

/// A drag over the picture that goes on.
#[derive(Clone, Copy)]
pub struct Drag {
    pub button: PointerButton,
    pub motion: Motion,
    /// The place up to which it was followed, in points.
    pub at: Pos2,
}

/// What a drag moves.
#[derive(Clone, Copy)]
pub enum Motion {
    Orbit,
    Pan,
    Look,
    /// The line between two pictures.
    Split,
}
