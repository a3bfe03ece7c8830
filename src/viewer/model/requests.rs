//! Requests of panels and keys that need the device or the window.

use super::edit::{Selection, SelectionMode};
use crate::gpu::Vsync;

/// A request that needs the device or the window. The session executes it after the layout of the panels.
#[derive(Clone, Debug, PartialEq)]
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
    },
    /// Select by contribution to the view; if true, visible Gaussians only.
    SelectByContributions(Selection, SelectionMode, bool),
    /// Fit the scale of the view mode to the values of the picture.
    FitRange,
    WritePicture,
    /// Copy the picture, as shown, to the clipboard.
    CopyPicture,
    WriteFilm,
    /// Measure the costs of knobs.
    Measure,
    /// Choose options within the budget.
    Choose,
    /// Compare every camera with its photograph.
    Evaluate,
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
