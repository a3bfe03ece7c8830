//! The pointer over the picture: drags, strokes of tools, and handles.

use egui::{PointerButton, Pos2};
use glam::DVec2;

use super::keys::Action;
use crate::render::SelectionMode;

/// The pointer over the picture.
#[derive(Default)]
pub struct Pointer {
    /// Where the cursor was at the last event, in points.
    pub position: Option<Pos2>,
    /// The pixel under the cursor; `None` outside the picture.
    pub pixel: Option<[u32; 2]>,
    /// Index of the camera of the file under the cursor.
    pub camera: Option<usize>,
    pub drag: Option<Drag>,
    pub stroke: Option<ToolStroke>,
}

impl Pointer {
    /// Ends the drag and the stroke without an effect.
    pub fn cancel(&mut self) {
        (self.drag, self.stroke) = (None, None);
    }
}

/// A drag over the picture.
#[derive(Clone, Copy)]
pub struct Drag {
    pub button: PointerButton,
    pub motion: DragMotion,
    /// The last position that was handled, in points.
    pub position: Pos2,
}

impl Drag {
    /// True if the drag moves the camera.
    pub fn moves_view(self) -> bool {
        matches!(self.motion, DragMotion::Orbit | DragMotion::Pan | DragMotion::Look)
    }
}

/// The effect of a drag.
#[derive(Clone, Copy, PartialEq)]
pub enum DragMotion {
    Orbit,
    Pan,
    Look,
    /// The line between two pictures.
    Split,
    /// The area of the picture to compare, from this pixel on.
    Area([u32; 2]),
    /// A stroke of a tool.
    Stroke,
    /// A handle of the layer with this number.
    Handle(u64, Handle),
    /// A face of the box that selects: its axis of the world, and true for the greater coordinate.
    Face(usize, bool),
}

/// The tool of the left button over the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tool {
    /// Turns the view.
    #[default]
    Look,
    Rectangle,
    Lasso,
    /// Each click adds a corner.
    Polygon,
    Brush,
    Ball,
    /// A box of the world, with handles.
    Box,
    /// Picks the colour of a Gaussian.
    Colour,
    /// Moves the handles of a scene.
    Place,
}

impl Tool {
    /// Every tool with the action that takes it, its name and a help text.
    pub const ALL: [(Self, Action, &str, &str); 9] = [
        (Self::Look, Action::ToolView, "View", "The left button turns the view"),
        (Self::Rectangle, Action::ToolRectangle, "Rectangle", "Drag over the centres to select"),
        (Self::Lasso, Action::ToolLasso, "Lasso", "Drag around the centres to select"),
        (
            Self::Polygon,
            Action::ToolPolygon,
            "Polygon",
            "Click the corners around the centres to select; a click on the first or the last corner closes it",
        ),
        (Self::Brush, Action::ToolBrush, "Brush", "Paint over the centres to select"),
        (
            Self::Ball,
            Action::ToolBall,
            "Ball",
            "Drag away from a point that is seen: all centres as near to it are selected",
        ),
        (Self::Box, Action::ToolBox, "Box", "Drag the faces of the box: all centres in it are selected"),
        (
            Self::Colour,
            Action::ToolColour,
            "Colour",
            "Click a Gaussian: those of a similar colour are selected; the page Edit sets how similar",
        ),
        (
            Self::Place,
            Action::ToolPlace,
            "Place",
            "Drag the handles of a scene: arrows move it, rings turn it, the square scales it",
        ),
    ];
}

/// A stroke of a tool.
pub struct ToolStroke {
    /// In pixels of the picture.
    pub points: Vec<DVec2>,
    pub mode: SelectionMode,
    /// Number of points that the brush has painted.
    pub painted: usize,
}

/// A handle of a scene, with its axis of the world: 0, 1 or 2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handle {
    Move(usize),
    Turn(usize),
    Scale,
}
