//! The report of `smalto render`, as it is written to JSON.

use schemars::JsonSchema;
use serde::Serialize;

use super::outputs::{Output, Shot};
use super::start::PhaseReport;
use crate::camera::Camera;
use crate::files::text_of;
use crate::measure::bench::{SceneReport, VersionReport};
use crate::options::Options;
use crate::render::{Frame, LodReport, Path, SlabReport};

/// The report of `smalto render`.
#[derive(Serialize, JsonSchema)]
pub(in crate::cli) struct Report {
    /// "smalto render 1".
    pub format: String,
    pub smalto: VersionReport,
    pub scene: SceneReport,
    /// The preset that was asked for, or the default; null if an error budget chose the options.
    pub preset: Option<String>,
    /// The device that drew; null for the float64 reference.
    pub device: Option<String>,
    pub options: Options,
    /// The phases from the command to the first picture, in the order of their ends.
    pub(super) start: Vec<PhaseReport>,
    /// What was drawn. Depths and counts have frames of their own on the GPU. Files that `--resume` skips are not here.
    pub(super) frames: Vec<FrameReport>,
    /// With `--video`, the file of the video, or the ffmpeg command that makes it of the pictures.
    pub video: Option<String>,
}

/// A frame and the files that were written from it.
#[derive(Serialize, JsonSchema)]
pub(super) struct FrameReport {
    pub files: Vec<FileReport>,
    pub camera: CameraReport,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Work and times on the GPU; null for the reference.
    pub gpu: Option<GpuReport>,
    /// Seconds that the reference took; null on the GPU.
    pub reference_seconds: Option<f64>,
    /// Largest bound of the certificate; null without one.
    pub certified_error: Option<f32>,
}

#[derive(Serialize, JsonSchema)]
pub(super) struct FileReport {
    /// colour, alpha, depth, median-depth, counts or certificate.
    pub layer: String,
    /// The path; a byte that is not UTF-8 stands as `\xHH`.
    pub path: String,
}

/// The camera of a frame, in COLMAP's axes: right, down, forward.
#[derive(Serialize, JsonSchema)]
pub(super) struct CameraReport {
    /// Position in the camera file.
    index: usize,
    /// Name in the camera file; null if the camera is not from a file.
    name: Option<String>,
    /// Position in world units.
    position: [f64; 3],
    /// World to view: the directions right, down and forward in world axes.
    rotation: [[f64; 3]; 3],
    /// Focal lengths in pixels.
    focal_px: [f64; 2],
    /// Principal point in pixels.
    centre_px: [f64; 2],
}

/// The work and the times of a frame on the GPU. Of a picture in bands, counts and times are sums over its bands.
#[derive(Serialize, JsonSchema)]
pub(super) struct GpuReport {
    /// The path that drew the frame.
    path: Path,
    /// Gaussians that passed the cull of the path. In depth slabs, Gaussians behind finished pixels are not counted.
    visible: u32,
    /// Splats in lists: instances (in tiles) on the portable path, entries (in bins) on the fast path.
    listed: u32,
    /// Time of the frame; null if the device has no timestamps.
    ms: Option<f64>,
    /// How it was drawn in parts; null if it was drawn at once.
    parts: Option<SlabReport>,
    /// The cut through the levels of detail; null if it was not drawn by levels.
    detail: Option<LodReport>,
    /// Stages in the order of the frame.
    stages: Vec<StageReport>,
}

#[derive(Serialize, JsonSchema)]
struct StageReport {
    name: String,
    ms: f64,
}

impl Report {
    pub const FORMAT: &str = "smalto render 1";
}

impl FrameReport {
    pub fn new(shot: &Shot, outputs: &[&Output]) -> Self {
        let file = |output: &&Output| FileReport { layer: output.layer.name(), path: text_of(&output.path) };
        let Camera { position, rotation, focal_px, centre_px, size_px, .. } = shot.camera;
        Self {
            files: outputs.iter().map(file).collect(),
            camera: CameraReport {
                index: shot.index,
                name: shot.name.clone(),
                position: position.into(),
                rotation: rotation.transpose().to_cols_array_2d(),
                focal_px: focal_px.into(),
                centre_px: centre_px.into(),
            },
            size: size_px,
            gpu: None,
            reference_seconds: None,
            certified_error: None,
        }
    }
}

impl From<&Frame> for GpuReport {
    fn from(frame: &Frame) -> Self {
        let mut stages: Vec<_> = frame.timings.iter().filter(|timing| timing.depth > 0).collect();
        stages.sort_by(|a, b| a.start_ms.total_cmp(&b.start_ms));
        let stage = |timing: &crate::gpu::Timing| StageReport { name: timing.name.to_owned(), ms: timing.duration_ms };
        Self {
            path: frame.path,
            visible: frame.totals.visible,
            listed: frame.totals.listed_kept,
            ms: frame.timings.iter().find(|timing| timing.depth == 0).map(|timing| timing.duration_ms),
            parts: frame.parts,
            detail: frame.detail,
            stages: stages.into_iter().map(stage).collect(),
        }
    }
}
