//! The report of `smalto trade`, as it is written to JSON.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::measure::bench::{DeviceReport, SceneReport, VersionReport, WarmUp};
use crate::measure::metrics::Difference;
use crate::options::Options;
use crate::render;

/// The trade between accuracy and speed of one scene. Times are in milliseconds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Report {
    /// "smalto trade 2".
    pub format: String,
    pub smalto: VersionReport,
    pub device: DeviceReport,
    pub scene: SceneReport,
    /// Width and height at which time and the error against the exact picture are measured, in pixels.
    pub size: [u32; 2],
    /// Width and height of the reference pictures, in pixels.
    pub oracle_size: [u32; 2],
    /// Number of views that each point is measured over.
    pub views: usize,
    /// Least number of warm-up frames before each point; a warm-up goes on until the frame time is steady (see
    /// `warm_up` of a point). 0: no warm-up.
    pub warmup: usize,
    /// Number of measured frames of each point.
    pub frames: usize,
    /// The exact options; with `--parts knobs` also every preset, and every step of every knob alone.
    pub points: Vec<Point>,
    /// The options along the search, each with all steps before it.
    pub search: Vec<Point>,
    /// The accuracy that the presets promise, checked over all cameras.
    pub promises: Vec<Promise>,
    /// Levels of detail; null if they were not measured.
    pub levels: Option<LevelsReport>,
    pub certificate: Option<CertificateReport>,
    pub budget: Option<BudgetReport>,
}

/// Time, memory and error under some options. Errors are those of the worst view in each measure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Point {
    pub name: String,
    pub options: Options,
    /// The path that drew the first frame. `notice` reports frames of the other path.
    pub drawn_by: render::Path,
    /// Reason for frames that the fast path should have drawn and did not; else null.
    pub notice: Option<String>,
    /// The warm-up before the measured frames; null with a `warmup` of 0.
    pub warm_up: Option<WarmUp>,
    /// Median GPU time of a frame.
    pub gpu_ms: f64,
    /// Median GPU time of each stage, in the order of the frame.
    pub stages: Vec<StageTime>,
    /// Device memory of the scene.
    pub scene_bytes: u64,
    /// Device memory of everything else.
    pub work_bytes: u64,
    /// Difference from the float64 reference, at its size.
    pub from_oracle: Difference,
    /// Difference from the exact options, at full size.
    pub from_exact: Difference,
    /// No other point is both faster and closer to the reference.
    pub is_pareto: bool,
}

/// Time of one stage of a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StageTime {
    pub stage: String,
    pub ms: f64,
}

/// Cost of levels of detail: presets with all Gaussians and with decreasing splat budgets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LevelsReport {
    /// Number of views that each point is measured over.
    pub views: usize,
    /// Least number of warm-up frames before each point.
    pub warmup: usize,
    /// Number of measured frames of each point.
    pub frames: usize,
    /// Samples of each pixel of the supersampled pictures.
    pub samples: u32,
    /// The first is drawn by the exact options from all Gaussians.
    pub points: Vec<LevelPoint>,
}

/// Time and error of a preset with levels of detail, or with all Gaussians. Errors are those of the worst view in each
/// measure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LevelPoint {
    pub preset: String,
    /// `splats` is the splat budget; 0: all Gaussians are drawn.
    pub options: Options,
    /// The warm-up before the measured frames; null with a `warmup` of 0.
    pub warm_up: Option<WarmUp>,
    /// Median GPU time of a frame.
    pub gpu_ms: f64,
    /// Gaussians or nodes in the picture, the mean of the views.
    pub visible: f64,
    /// Pages that hold the cut, the mean of the views; null if all Gaussians are drawn.
    pub pages: Option<f64>,
    /// The least PSNR of a view if the errors of the nodes were independent and none were hidden, dB; null without
    /// errors. No bound, and far below the PSNR of most pictures.
    pub predicted_psnr: Option<f64>,
    /// Difference from the exact options with all Gaussians.
    pub from_exact: Difference,
    /// Difference from the supersampled picture, which the exact options draw from all Gaussians.
    pub from_supersampled: Difference,
    /// No other point is both faster and closer to the exact pictures.
    pub is_pareto: bool,
    /// No other point is both faster and closer to the supersampled pictures.
    pub is_pareto_supersampled: bool,
}

/// The accuracy that a preset promises, and that of its worst picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Promise {
    pub preset: String,
    /// Least PSNR that is promised.
    pub min_psnr_db: f64,
    /// Largest difference of an 8-bit value that is promised; null if none is.
    pub max_step: Option<u8>,
    /// Worst value of each measure against the reference, over all cameras.
    pub worst: Difference,
    /// Number of cameras.
    pub cameras: usize,
    pub is_kept: bool,
}

/// Comparison of certificates with the true errors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CertificateReport {
    pub settings: Vec<SettingReport>,
    /// Pixels that were tested, over all settings and views.
    pub pixel_tests: u64,
    /// Pixels whose error exceeds their certificate.
    pub violations: u64,
}

/// Comparison of the certificates of one setting with the true errors, over all views.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SettingReport {
    pub name: String,
    pub pixel_tests: u64,
    /// Pixels whose error exceeds their certificate.
    pub violations: u64,
    pub max_error: f64,
    pub max_certificate: f64,
    pub mean_error: f64,
    pub mean_certificate: f64,
    /// Largest ratio of an error to its certificate.
    pub tightest: f64,
}

/// An error budget, the options chosen for it, and their errors on views that were not used to choose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BudgetReport {
    pub budget: String,
    pub choice: String,
    pub options: Options,
    /// True if the bound is proven for every view, false if it was measured on some views.
    pub is_proven: bool,
    pub gpu_ms: f64,
    pub exact_gpu_ms: f64,
    /// Number of views that were not used to choose.
    pub held_out_views: usize,
    /// Worst difference of these views from the reference, at its size.
    pub from_oracle: Difference,
    /// Worst difference of these views from the exact options, at full size.
    pub from_exact: Difference,
    /// Number of these views that exceed the budget.
    pub exceeded: usize,
}

impl Report {
    /// Name and version of the format, the first member of every report.
    pub const FORMAT: &str = "smalto trade 2";
}

/// PSNR in dB; infinite for equal pictures.
pub(super) fn psnr_db(difference: &Difference) -> f64 {
    difference.psnr_db.unwrap_or(f64::INFINITY)
}

/// Sets `is_pareto` of the points that no other point beats in both time and PSNR.
pub fn mark_pareto(points: &mut [&mut Point]) {
    let all: Vec<_> = points.iter().map(|p| (p.gpu_ms, psnr_db(&p.from_oracle))).collect();
    points.iter_mut().zip(front(&all)).for_each(|(point, is_pareto)| point.is_pareto = is_pareto);
}

/// Sets both marks of the points of levels.
pub(super) fn mark_levels(points: &mut [LevelPoint]) {
    let fronts = |of: fn(&LevelPoint) -> &Difference| {
        front(&points.iter().map(|p| (p.gpu_ms, psnr_db(of(p)))).collect::<Vec<_>>())
    };
    let marks = fronts(|p| &p.from_exact).into_iter().zip(fronts(|p| &p.from_supersampled));
    for (point, marks) in points.iter_mut().zip(marks.collect::<Vec<_>>()) {
        (point.is_pareto, point.is_pareto_supersampled) = marks;
    }
}

/// True for each time and PSNR that no other beats in both.
fn front(all: &[(f64, f64)]) -> Vec<bool> {
    let beats = |(ms, db): (f64, f64), (other_ms, other_db): (f64, f64)| {
        other_ms <= ms && other_db >= db && (other_ms, other_db) != (ms, db)
    };
    all.iter().map(|one| !all.iter().any(|other| beats(*one, *other))).collect()
}
