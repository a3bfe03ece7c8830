//! The events that jobs of the viewer report.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Result;

use super::comparison::PictureOf;
use super::contributions::Contributions;
use super::evaluation::Evaluation;
use super::loaded_scene::OpenedScene;
use super::photographs::Photographs;
use super::plan::{Drawn, Side};
use super::property_values::PropertyValues;
use super::requests::Selecting;
use super::sharing::Sharing;
use super::snapshot::PairDifference;
use crate::camera::CameraFile;
use crate::options::Options;
use crate::pixels::Pixels;
use crate::scene::Gaussians;
use crate::viewer::jobs;
use crate::viewer::jobs::KnobCosts;

/// The jobs of a viewer.
pub type Jobs = jobs::Jobs<JobEvent>;

/// Sends the events of a job of the viewer.
pub type Reporter = jobs::Reporter<JobEvent>;

/// Where the name of a camera file came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// The user, or a project.
    Named,
    /// A search beside the scene.
    Found,
}

/// A report of a job of the viewer.
pub enum JobEvent {
    /// Layer number, and the fraction read, 0 to 1.
    Reading(u64, f64),
    /// Layer number, and the Gaussians read so far.
    Partial(u64, Arc<Gaussians>),
    /// Layer number, and the scene.
    Read(u64, Result<OpenedScene>),
    /// Contributions to the view, for a selection if one waits for them.
    Contributions(Option<Selecting>, Result<Contributions>),
    /// Values of a property, likewise.
    Values(Option<Selecting>, Result<PropertyValues>),
    /// Number of a layer whose file has changed.
    Changed(u64, Result<()>),
    Cameras(PathBuf, Origin, Result<CameraFile>),
    /// A scene is on the GPU and can be drawn from any view: the side of its picture, and the number of the build.
    Built(Side, u64, Result<Box<Drawn>>),
    /// The number of a build, the other devices that can draw bands of its pictures, and why others cannot.
    Shared(u64, Result<(Sharing, Vec<String>)>),
    /// A photograph or the reference: the number of the request, its name, what it shows, and its pixels.
    Picture(u64, String, PictureOf, Result<Pixels>),
    /// The photographs of a folder.
    Photographs(Result<Photographs>),
    /// Camera index, and the thumbnail of its photograph.
    Thumbnail(usize, Result<Pixels>),
    Evaluated(Result<Evaluation>),
    /// The measured difference of two pictures.
    Compared(Result<PairDifference>),
    /// The fraction of a measurement that is done, 0 to 1.
    Measuring(f64),
    Measured(Result<KnobCosts>),
    /// The options chosen for a budget, and the reason.
    Chosen(Result<(Options, String)>),
    /// The fraction of the files written, 0 to 1.
    Writing(f64),
    /// All files are written; the text names them.
    Written(Result<String>),
}
