//! What a bench says, as it is written to JSON and CSV. Times are in milliseconds.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::machine::{Clocks, DeviceReport, VersionReport};
use super::statistics::Statistics;
use crate::camera::Camera;
use crate::files::write_whole;
use crate::options::Options;
use crate::pixels::Pixels;
use crate::scene::Gaussians;

/// The measurements of `smalto bench`. Times are in milliseconds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Report {
    /// "smalto bench 2".
    pub format: String,
    pub smalto: VersionReport,
    pub device: DeviceReport,
    /// Frames before the measured ones of each kind: at least so many and, unless it is 0, at least half a second.
    pub warmup: usize,
    /// Measured frames of every kind of run: with two timestamps, with one pair a stage, and pipelined.
    pub frames: usize,
    /// Where the cameras come from: orbit, orbit-zoom, or a file.
    pub path: String,
    /// One for every scene, size and preset.
    pub runs: Vec<Run>,
}

/// One scene at one size with one preset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Run {
    pub subject: Subject,
    /// While a frame was on the device; null where the driver does not tell.
    pub clocks: Option<Clocks>,
    pub frame: FrameTimes,
    /// In the order of the frame; last, as "gaps", what lies between the stages.
    pub stages: Vec<StageReport>,
    pub counts: Counts,
    /// Device memory by buffer, at its peak.
    pub memory: Vec<Allocation>,
    /// Device memory that the program held in all at the end, spare room of the allocator included.
    pub allocated_bytes: u64,
    /// BLAKE3 of the last frame's floats, row by row.
    pub image_hash: String,
    /// Above the error of every value of all views, by their certificates; null if it was not asked for.
    pub certified_error: Option<f32>,
    /// PSNR of the first view against the f64 reference, in dB; null if it was not asked for, or both are equal.
    pub psnr_db: Option<f64>,
}

/// What a run measures, and what tells it from the others of a report.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Subject {
    pub scene: SceneReport,
    /// Width and height in pixels.
    pub size: [u32; 2],
    pub preset: String,
    /// The preset's, with what overrides them.
    pub options: Options,
    /// BLAKE3 of the cameras.
    pub views_hash: String,
}

/// What was drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneReport {
    pub name: String,
    pub gaussians: usize,
    pub sh_degree: u32,
    /// BLAKE3 of the Gaussians as they are rendered, whatever the file format was.
    pub hash: String,
}

/// The times of whole frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FrameTimes {
    /// On the GPU, between two timestamps.
    pub gpu_ms: Statistics,
    /// From the call to the end of the wait, one frame at a time.
    pub wall_ms: Statistics,
    /// A frame's share of the wall time when the next is recorded while one runs.
    pub pipelined_ms: f64,
    /// On the GPU with timestamps around every stage.
    pub staged_gpu_ms: Statistics,
    /// What those timestamps cost: the difference of the medians.
    pub timestamps_cost_ms: f64,
}

/// One stage of the frame on the GPU.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StageReport {
    pub name: String,
    pub ms: Statistics,
    /// The fewest bytes that the stage moves: inputs read once, outputs written once. Median over the frames.
    pub least_bytes: u64,
    /// How long a copy of as many bytes takes, over the stage's median time.
    pub bandwidth_fraction: f64,
}

/// What the frames worked on, over the measured frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Counts {
    /// Gaussians that may touch the image.
    pub visible: Statistics,
    /// Splats in tiles.
    pub instances: Statistics,
    /// Of the image.
    pub tiles: u32,
    /// Tiles with a list.
    pub listed_tiles: Statistics,
    /// Splats in the fullest tile.
    pub longest_list: Statistics,
    /// Splats in the list of a pixel's tile, mean over the pixels.
    pub listed_per_pixel: Statistics,
    /// Alphas computed for a pixel that had not stopped, mean over the pixels.
    pub evaluations_per_pixel: Statistics,
    /// The same, lanes that idle beside others included.
    pub lanes_per_pixel: Statistics,
    /// Fraction of the pixels that are opaque before their list ends.
    pub early_exit_rate: Statistics,
}

/// A buffer in device memory.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Allocation {
    pub buffer: String,
    pub bytes: u64,
}

/// BLAKE3 of a picture's floats, row by row.
pub fn image_hash(pixels: &Pixels) -> String {
    blake3::hash(bytemuck::cast_slice(&pixels.rgba)).to_hex().to_string()
}

impl SceneReport {
    pub fn of(name: String, gaussians: &Gaussians) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(bytemuck::cast_slice(gaussians.means()));
        hasher.update(bytemuck::cast_slice(gaussians.scales()));
        hasher.update(bytemuck::cast_slice(gaussians.rotations()));
        hasher.update(bytemuck::cast_slice(gaussians.opacities()));
        (0..gaussians.len()).for_each(|i| _ = hasher.update(bytemuck::cast_slice(gaussians.sh(i))));
        let hash = hasher.finalize().to_hex().to_string();
        Self { name, gaussians: gaussians.len(), sh_degree: gaussians.sh_degree(), hash }
    }
}

impl Subject {
    pub fn new(scene: &SceneReport, preset: &str, options: &Options, views: &[Camera]) -> Self {
        let mut hasher = blake3::Hasher::new();
        for Camera { position, rotation, focal_px, centre_px, size_px } in views {
            hasher.update(bytemuck::bytes_of(position)).update(bytemuck::bytes_of(rotation));
            hasher.update(bytemuck::bytes_of(focal_px)).update(bytemuck::bytes_of(centre_px));
            hasher.update(bytemuck::bytes_of(size_px));
        }
        let views_hash = hasher.finalize().to_hex().to_string();
        Self { scene: scene.clone(), size: views[0].size_px, preset: preset.to_owned(), options: *options, views_hash }
    }

    pub fn title(&self) -> String {
        let [width, height] = self.size;
        format!("{} {width}x{height} {}", self.scene.name, self.preset)
    }
}

impl Report {
    /// The first member of every report: what it is, and by which rules.
    pub const FORMAT: &str = "smalto bench 2";

    /// Reads a report; the error says why it is none.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).context("cannot be read")?;
        let value: serde_json::Value = serde_json::from_str(&text).context("is not JSON")?;
        let format = value.get("format").and_then(|f| f.as_str()).unwrap_or("of no known format");
        let expected = Self::FORMAT;
        ensure!(format == expected, "is not a report of this bench: it is {format}, expected is {expected}");
        serde_json::from_value(value).context("is a damaged report")
    }

    pub fn write_json(&self, path: &Path) -> Result<()> {
        write_whole(path, |file| Ok(serde_json::to_writer_pretty(file, self)?))
    }

    /// Writes the statistics as a table: a row for every run and quantity.
    pub fn write_csv(&self, path: &Path) -> Result<()> {
        write_whole(path, |file| {
            let mut csv = csv::Writer::from_writer(file);
            let about = ["scene", "gaussians", "width", "height", "preset", "quantity"];
            csv.write_record(about.into_iter().chain(Statistics::COLUMNS))?;
            for run in &self.runs {
                let Subject { scene, size, preset, .. } = &run.subject;
                let numbers = [scene.gaussians.to_string(), size[0].to_string(), size[1].to_string()];
                let about: Vec<_> = [scene.name.clone()].into_iter().chain(numbers).chain([preset.clone()]).collect();
                for (quantity, statistics) in run.rows() {
                    let values = statistics.columns().map(|v| v.to_string());
                    csv.write_record(about.iter().cloned().chain([quantity]).chain(values))?;
                }
            }
            Ok(csv.flush()?)
        })
    }
}

impl Run {
    /// Every statistic and its name.
    pub fn rows(&self) -> Vec<(String, Statistics)> {
        let (frame, counts) = (&self.frame, &self.counts);
        let mut rows = vec![
            ("frame gpu ms".to_owned(), frame.gpu_ms),
            ("frame wall ms".to_owned(), frame.wall_ms),
            ("frame gpu ms with stage timestamps".to_owned(), frame.staged_gpu_ms),
        ];
        rows.extend(self.stages.iter().map(|stage| (format!("{} ms", stage.name), stage.ms)));
        let counted = [
            ("visible", counts.visible),
            ("instances", counts.instances),
            ("listed tiles", counts.listed_tiles),
            ("longest list", counts.longest_list),
            ("listed per pixel", counts.listed_per_pixel),
            ("evaluations per pixel", counts.evaluations_per_pixel),
            ("lanes per pixel", counts.lanes_per_pixel),
            ("early exit rate", counts.early_exit_rate),
        ];
        rows.extend(counted.map(|(name, statistics)| (name.to_owned(), statistics)));
        rows
    }
}
