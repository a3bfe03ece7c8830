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

impl Drag {
    /// True if it moves the camera.
    pub fn moves_view(self) -> bool {
        matches!(self.motion, Motion::Orbit | Motion::Pan | Motion::Look)
    }
}

/// What a drag moves.
#[derive(Clone, Copy)]
pub enum Motion {
    Orbit,
    Pan,
    Look,
    /// The line between two pictures.
    Split,
    /// The part of the picture to compare, from this pixel on.
    Area([u32; 2]),
}
