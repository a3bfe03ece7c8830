//! The report of the ladder: JSON, CSV, and the paper's speedups.

use std::io::Write;

use anyhow::Result;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use smalto::measure::bench::{Clocks, DeviceReport, SceneReport, Statistics, VersionReport, WarmUp};

/// The measurements of `cargo bench --bench ladder`. Times are in milliseconds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LadderReport {
    /// "smalto ladder 2".
    pub format: String,
    pub smalto: VersionReport,
    pub device: DeviceReport,
    /// Least number of warm-up frames of every rung; a warm-up goes on until the frame time is steady (see `warm_up` of
    /// a rung). 0: no warm-up.
    pub warmup: usize,
    /// Number of measured frames of every rung.
    pub frames: usize,
    /// Source of the cameras: orbit, orbit-zoom, or a file.
    pub path: String,
    /// One climb for every scene.
    pub climbs: Vec<Climb>,
}

/// The measurements of all rungs on one scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Climb {
    pub scene: SceneReport,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Distance of the near plane in world units.
    pub near: f32,
    /// Measured frames of every rung: those of the report, or fewer if they take long and no number was asked for.
    pub frames: usize,
    pub rungs: Vec<RungReport>,
}

/// The measurements of one rung. Its frames are variants of the portable path, which the last rung equals.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RungReport {
    pub name: String,
    /// The rung that this one is compared with; null for the first.
    pub from: Option<String>,
    /// The stage that the step changes; "frame" if it changes several.
    pub stage: String,
    /// The warm-up before the measured frames; null with a `warmup` of 0.
    pub warm_up: Option<WarmUp>,
    /// Clocks right after the last frame; null if the driver does not report them.
    pub clocks: Option<Clocks>,
    /// Wall time of a whole frame from its begin to the end of the last wait, one frame at a time.
    pub wall_ms: Statistics,
    pub stages: Vec<RungStage>,
    /// Splats that may touch the image.
    pub visible: Statistics,
    /// Instances: pairs of a splat and a tile of 16x16 pixels that it touches.
    pub instances: Statistics,
    /// Instances of the fullest tile.
    pub longest_list: Statistics,
    /// BLAKE3 of the last frame's floats, row by row.
    pub image_hash: String,
    /// PSNR of the last frame against the first rung's, in dB; null if both are equal.
    pub to_baseline_db: Option<f64>,
}

/// The time of one stage of a rung's frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RungStage {
    pub name: String,
    /// Time on the GPU, copies included, plus time on the CPU.
    pub ms: Statistics,
    /// Time on the CPU, median.
    pub host_ms: f64,
}

/// The speedup that the paper reports for the changed stage of a rung.
pub struct Paper {
    pub rung: &'static str,
    pub speedup: &'static str,
}

impl Paper {
    pub const STEPS: [Self; 4] = [
        Self { rung: "+1 GPU duplication", speedup: "96x" },
        Self { rung: "+2 GPU ranges", speedup: "40x" },
        Self { rung: "+3 batches of 256", speedup: "up to 1.5x" },
        Self { rung: "+4 GPU compaction", speedup: "2.9x" },
    ];

    /// The entry of a rung, if the paper reports one.
    pub fn of(rung: &str) -> Option<&'static Self> {
        Self::STEPS.iter().find(|step| step.rung == rung)
    }
}

impl Climb {
    /// The rung with this name.
    pub fn rung(&self, name: &str) -> Option<&RungReport> {
        self.rungs.iter().find(|rung| rung.name == name)
    }

    /// Speedup of a rung's changed stage over the rung that it is compared with.
    pub fn stage_speedup(&self, rung: &RungReport) -> Option<f64> {
        let before = self.rung(rung.from.as_deref()?)?;
        Some(before.stage_ms(&rung.stage)? / rung.stage_ms(&rung.stage)?)
    }
}

impl RungReport {
    /// Median time of a stage in milliseconds; of the whole frame for "frame".
    pub fn stage_ms(&self, name: &str) -> Option<f64> {
        if name == "frame" {
            return Some(self.wall_ms.median);
        }
        self.stages.iter().find(|stage| stage.name == name).map(|stage| stage.ms.median)
    }
}

impl LadderReport {
    /// Name and version of the format, the first member of every report.
    pub const FORMAT: &str = "smalto ladder 2";

    /// Writes the times as CSV: a row for every scene, rung and stage.
    pub fn write_csv(&self, out: impl Write) -> Result<()> {
        let mut csv = csv::Writer::from_writer(out);
        let about = ["scene", "gaussians", "rung", "quantity"];
        csv.write_record(about.into_iter().chain(Statistics::COLUMNS).chain(["host median"]))?;
        for climb in &self.climbs {
            for rung in &climb.rungs {
                let stages = rung.stages.iter().map(|s| (format!("{} ms", s.name), s.ms, s.host_ms.to_string()));
                let rows = std::iter::once(("frame wall ms".to_owned(), rung.wall_ms, String::new())).chain(stages);
                for (quantity, s, host) in rows {
                    let about = [&climb.scene.name, &climb.scene.gaussians.to_string(), &rung.name, &quantity];
                    let values = s.columns().map(|v| v.to_string());
                    csv.write_record(about.into_iter().cloned().chain(values).chain([host]))?;
                }
            }
        }
        Ok(csv.flush()?)
    }
}
