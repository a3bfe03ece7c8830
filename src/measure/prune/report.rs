//! The report of `smalto prune`, as it is written to JSON.

use schemars::JsonSchema;
use serde::Serialize;

use super::limit::{Change, Limit};
use crate::formats::Loss;
use crate::measure::bench::{SceneReport, VersionReport};
use crate::options::Options;

/// The Gaussians that `smalto prune` dropped, and the change of the views.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[schemars(title = "Report of `smalto prune`")]
pub struct Report {
    /// "smalto prune 1".
    pub format: String,
    pub smalto: VersionReport,
    #[serde(flatten)]
    pub subject: Subject,
    /// The requested limit on the change of a view; `measured` keeps to it.
    pub limit: Limit,
    pub gaussians: Kept,
    /// A bound on the change of every pixel of the views, for any colours that are no brighter: proven, but for an
    /// allowance for the rounding of 32-bit floats.
    pub bound: Worst,
    /// The change of the views, measured on pictures of the whole and of the pruned scene.
    pub measured: Worst,
    /// The other cameras of the file, for which no limit is kept; null if there are none.
    pub others: Option<Others>,
    /// The views in the order of the file.
    pub views: Vec<ViewReport>,
    pub output: Written,
}

/// The pruned scene, and the device and options that drew it.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Subject {
    pub device: String,
    pub scene: SceneReport,
    pub options: Options,
}

/// Numbers of Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Kept {
    pub before: usize,
    pub kept: usize,
    pub dropped: usize,
    /// Dropped Gaussians without a share in any given view.
    pub unseen: usize,
    /// The largest share (alpha * transmittance) that a dropped Gaussian has of a pixel.
    pub largest_dropped_share: f32,
}

/// The worst value of each measure over some views. Colour values are not clamped; white is 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Worst {
    /// The largest change of a colour value.
    pub max_error: f64,
    /// The least PSNR in dB; null if nothing changed.
    pub psnr_db: Option<f64>,
}

/// Changes of the other cameras of the file.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Others {
    pub views: usize,
    /// Measured change of their views.
    pub measured: Worst,
    /// The mean of their PSNR in dB; null if one of them did not change.
    pub mean_psnr_db: Option<f64>,
}

/// One view.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct ViewReport {
    /// Position of the camera in the file.
    pub camera: usize,
    pub name: String,
    /// Width and height in pixels.
    pub size: [u32; 2],
    pub bound: Worst,
    pub measured: Worst,
}

/// The file that was written.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Written {
    pub file: String,
    pub format: String,
    pub bytes: u64,
    pub gaussians: usize,
    pub sh_degree: u32,
    /// Gaussians left out because the format rounds their opacity to 0.
    pub transparent: usize,
    /// Differences between the file, read back, and the Gaussians that were kept. Empty for pages.
    pub loss: Vec<Loss>,
}

impl Report {
    /// The name and version of the format.
    pub const FORMAT: &str = "smalto prune 1";
}

impl Worst {
    pub fn of(changes: &[Change]) -> Self {
        changes.iter().fold(Change::default(), |worst, change| worst.max(*change)).into()
    }
}

impl From<Change> for Worst {
    fn from(change: Change) -> Self {
        Self { max_error: change.largest, psnr_db: change.psnr_db() }
    }
}

impl Others {
    /// `None` without changes.
    pub fn of(changes: &[Change]) -> Option<Self> {
        let views = changes.len();
        let sum = changes.iter().map(|change| change.psnr_db()).sum::<Option<f64>>();
        let mean_psnr_db = sum.map(|sum| sum / views as f64);
        (views > 0).then(|| Self { views, measured: Worst::of(changes), mean_psnr_db })
    }
}
