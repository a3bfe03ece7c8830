//! What `smalto trade` says, as it is written to JSON.

use std::path::Path;

use anyhow::Result;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::measure::bench::{DeviceReport, SceneReport, VersionReport};
use crate::files::write_whole;
use crate::measure::metrics::Difference;
use crate::options::Options;

/// The trade between accuracy and speed of one scene. Times are in milliseconds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Report {
    /// "smalto trade 1".
    pub format: String,
    pub smalto: VersionReport,
    pub device: DeviceReport,
    pub scene: SceneReport,
    /// Width and height at which time and the distance from the exact picture are measured.
    pub size: [u32; 2],
    /// Width and height at which the reference is drawn.
    pub oracle_size: [u32; 2],
    /// Views that each point was measured over, frames to warm up and measured ones.
    pub views: usize,
    pub warmup: usize,
    pub frames: usize,
    /// The exact options; with the knobs, every preset and every knob turned alone.
    pub points: Vec<Point>,
    /// The options on the way of the search, each with all turns before it.
    pub search: Vec<Point>,
    /// What the presets keep over all cameras.
    pub promises: Vec<Promise>,
    pub certificate: Option<CertificateReport>,
    pub budget: Option<BudgetReport>,
}

/// Options, what a frame takes under them, and how far its pictures are from others: the worst view in each measure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Point {
    pub name: String,
    pub options: Options,
    /// Median GPU time of a frame.
    pub gpu_ms: f64,
    /// Medians, in the order of the frame.
    pub stages: Vec<StageTime>,
    /// Device memory.
    pub scene_bytes: u64,
    pub work_bytes: u64,
    /// From the f64 reference, at its size.
    pub from_oracle: Difference,
    /// From the exact options, at full size.
    pub from_exact: Difference,
    /// No other point is both faster and closer to the reference.
    pub is_pareto: bool,
}

/// One stage of a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StageTime {
    pub stage: String,
    pub ms: f64,
}

/// A preset and the worst of its pictures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Promise {
    pub preset: String,
    /// Least PSNR that is promised, and largest difference of an 8-bit value, if one is.
    pub min_psnr_db: f64,
    pub max_step: Option<u8>,
    /// From the reference, over so many cameras.
    pub worst: Difference,
    pub cameras: usize,
    pub is_kept: bool,
}

/// Certificates against the true errors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CertificateReport {
    pub settings: Vec<SettingReport>,
    /// Over all settings and views.
    pub pixel_tests: u64,
    pub violations: u64,
}

/// Certificates of one setting, over all views.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SettingReport {
    pub name: String,
    pub pixel_tests: u64,
    /// Pixels whose error passes their certificate.
    pub violations: u64,
    pub max_error: f64,
    pub max_certificate: f64,
    pub mean_error: f64,
    pub mean_certificate: f64,
    /// The largest part of a certificate that an error takes.
    pub tightest: f64,
}

/// A budget, what was chosen for it, and views that were not asked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BudgetReport {
    pub budget: String,
    pub choice: String,
    pub options: Options,
    /// Whether there is a proof for any view, or a measurement.
    pub is_proven: bool,
    pub gpu_ms: f64,
    pub exact_gpu_ms: f64,
    /// Views that were not used to choose.
    pub held_out_views: usize,
    /// The worst of their pictures: from the reference at its size, and from the exact ones at full size.
    pub from_oracle: Difference,
    pub from_exact: Difference,
    /// Views whose picture is farther from the reference than the budget.
    pub exceeded: usize,
}

impl Report {
    /// The first member of every report: what it is, and by which rules.
    pub const FORMAT: &str = "smalto trade 1";

    pub fn write_json(&self, path: &Path) -> Result<()> {
        write_whole(path, |file| Ok(serde_json::to_writer_pretty(file, self)?))
    }
}

/// PSNR for comparisons: equal pictures are infinitely close.
pub(super) fn psnr_db(difference: &Difference) -> f64 {
    difference.psnr_db.unwrap_or(f64::INFINITY)
}

/// Marks the points that no other beats in both time and PSNR.
pub fn mark_pareto(points: &mut [&mut Point]) {
    let all: Vec<(f64, f64)> = points.iter().map(|p| (p.gpu_ms, psnr_db(&p.from_oracle))).collect();
    for (point, (ms, db)) in points.iter_mut().zip(&all) {
        let is_beaten =
            all.iter().any(|(other_ms, other_db)| other_ms <= ms && other_db >= db && (other_ms, other_db) != (ms, db));
        point.is_pareto = !is_beaten;
    }
}
