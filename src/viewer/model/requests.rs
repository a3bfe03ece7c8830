//! Requests of panels and keys that need the device or the window.

use std::path::PathBuf;
use std::sync::Arc;

use super::contributions::Contributions;
use super::edit::Selection;
use super::keys::Action;
use crate::camera::Camera;
use crate::gpu::Vsync;
use crate::render::SelectionMode;

/// A request that needs the device or the window. The session executes it after the layout of the panels.
#[derive(Clone)]
pub enum Request {
    /// The owner of the window executes this one.
    Window(WindowRequest),
    /// Explain this pixel of the first picture.
    Pick([u32; 2]),
    /// Move the pivot to the point at this pixel.
    Focus([u32; 2]),
    /// Mark the point at this pixel, and measure its distance from the mark before.
    Mark([u32; 2]),
    /// Select the centres in a ball around the point at this pixel.
    SelectBall {
        pixel: [u32; 2],
        radius_px: f64,
        mode: SelectionMode,
        /// A stroke goes on: there is no message.
        goes_on: bool,
    },
    Select(Selecting),
    /// Do what the key of an edit does.
    Act(Action),
    /// Do what Escape does.
    Escape,
    /// Note the edits from which a stroke of a tool starts.
    BeginStroke,
    /// Select Gaussians of the colour of the one that is seen most at this pixel.
    SelectColour([u32; 2], SelectionMode),
    /// Fit the scale of the view mode to the values of the picture.
    FitRange,
    /// Write the picture to this file, or to the next one that is free.
    WritePicture(Option<PathBuf>),
    /// Copy the picture, as shown, to the clipboard.
    CopyPicture,
    /// Write the camera path to this video or folder, or to the next one that is free.
    WriteFilm(Option<PathBuf>),
    /// Measure the costs of knobs.
    Measure,
    /// Choose options within the budget.
    Choose,
    /// Compare every camera with its photograph.
    Evaluate,
}

impl Request {
    /// True for edits of scenes, which are made in their order.
    pub fn is_edit(&self) -> bool {
        matches!(
            self,
            Self::Select(_) | Self::SelectBall { .. } | Self::SelectColour(..) | Self::Act(_) | Self::BeginStroke
        )
    }
}

/// A selection that is requested.
#[derive(Clone)]
pub struct Selecting {
    pub selection: Selection,
    pub mode: SelectionMode,
    /// The view at the time of the request.
    pub view: Camera,
    /// It starts from the edits at the beginning of the stroke, not from the current ones.
    pub restarts: bool,
    /// The contributions to the view at the time of the request, once a job has found them.
    pub contributions: Option<Arc<Contributions>>,
    /// A stroke goes on: there is no message.
    pub goes_on: bool,
}

/// A request that only the owner of the window can execute.
#[derive(Clone, Debug, PartialEq)]
pub enum WindowRequest {
    ToggleFullScreen,
    Quit,
    Vsync(Vsync),
    /// Put this text on the clipboard.
    Copy(String),
    /// Put this picture on the clipboard.
    CopyPicture(egui::ColorImage),
}
