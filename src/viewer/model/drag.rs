//! A drag over the picture.

use egui::{PointerButton, Pos2};
use glam::DVec2;

use super::edit::How;

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
#[derive(Clone, Copy, PartialEq)]
pub enum Motion {
    Orbit,
    Pan,
    Look,
    /// The line between two pictures.
    Split,
    /// The part of the picture to compare, from this pixel on.
    Area([u32; 2]),
    /// A stroke of a tool.
    Stroke,
    /// A handle of the scene with this number.
    Handle(u64, Handle),
}

/// What the left button does over the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tool {
    /// Turns the view.
    #[default]
    Look,
    Rectangle,
    Lasso,
    Brush,
    Ball,
    /// Moves the handles of a scene.
    Place,
}

impl Tool {
    /// Every tool with its name and what it does.
    pub const ALL: [(Self, &str, &str); 6] = [
        (Self::Look, "Look", "The left button turns the view"),
        (Self::Rectangle, "Rectangle", "Drag over the centres to select, through all of the scene"),
        (Self::Lasso, "Lasso", "Drag around the centres to select, through all of the scene"),
        (Self::Brush, "Brush", "Paint over the centres to select, through all of the scene"),
        (Self::Ball, "Ball", "Drag away from a point that is seen: all centres as near to it are selected"),
        (Self::Place, "Place", "Drag the handles of a scene: arrows move it, rings turn it, the square scales it"),
    ];
}

/// A stroke of a tool that goes on: its places, in pixels.
pub struct Stroke {
    pub way: Vec<DVec2>,
    pub how: How,
}

/// A handle of a scene, by its axis of the world: 0, 1, 2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handle {
    Move(usize),
    Turn(usize),
    Scale,
}
