//! The report of a bench, as it is written to JSON and CSV. Times are in milliseconds.

use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::machine::{Clocks, DeviceReport, VersionReport};
use super::statistics::Statistics;
use super::warm_up::WarmUp;
use crate::camera::Camera;
use crate::files::read_whole;
use crate::options::Options;
use crate::pixels::Pixels;
use crate::render::{self, LodReport};
use crate::scene::Gaussians;

/// The measurements of `smalto bench`. Times are in milliseconds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Report {
    /// "smalto bench 3".
    pub format: String,
    pub smalto: VersionReport,
    pub device: DeviceReport,
    /// Least number of warm-up frames. The frames of each kind are preceded by a warm-up that goes on until the frame
    /// time is steady (see `warm_up` of a run); 0: no warm-up.
    pub warmup: usize,
    /// Most frames of each kind: with two timestamps, with two timestamps per stage, and pipelined. Each run has the
    /// number of its measured frames.
    pub frames: usize,
    /// Source of the cameras: orbit, orbit-zoom, turn, or a file.
    pub path: String,
    /// One run for every scene, size and preset.
    pub runs: Vec<Run>,
}

/// The measurements of one scene at one size with one preset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Run {
    pub subject: Subject,
    /// The path that drew the first measured frame. `notice` reports frames of the other path.
    pub drawn_by: render::Path,
    /// Reason for frames that the fast path should have drawn and did not; else null.
    pub notice: Option<String>,
    /// Measured frames of each kind: the report's number, or fewer if frames are slow and no number was given.
    pub frames: usize,
    /// The warm-ups before the measured frames of each kind together; null with a `warmup` of 0.
    pub warm_up: Option<WarmUp>,
    /// Clocks while a frame was on the device; null if the driver does not report them.
    pub clocks: Option<Clocks>,
    pub frame: FrameTimes,
    /// Stages in the order of the frame. The last entry, "gaps", is the time between the stages.
    pub stages: Vec<StageReport>,
    pub counts: Counts,
    /// Cuts through the levels of detail; absent if the pictures were drawn without them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detail: Option<DetailReport>,
    /// Device memory by buffer, at its peak.
    pub memory: Vec<Allocation>,
    /// All device memory that the program held at the end, unused memory of the allocator included.
    pub allocated_bytes: u64,
    /// BLAKE3 of the last frame's floats, row by row.
    pub image_hash: String,
    /// Upper bound of the error of every colour value of all views, from their certificates; null if not requested.
    pub certified_error: Option<f32>,
    /// PSNR of the first view against the float64 reference, in dB; null if not requested or if both are equal.
    pub psnr_db: Option<f64>,
    /// With several devices, the speed of each while all draw; else null.
    #[serde(default)]
    pub together: Option<Vec<DeviceSpeed>>,
    /// With several devices and --share frame, frames that all draw in bands; else null.
    #[serde(default)]
    pub split: Option<SplitReport>,
}

/// Frames in bands, and the same frames on the first device alone. Pixels come to host memory with 8 bits per channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SplitReport {
    /// Milliseconds from the call to the last pixel in host memory.
    pub latency_ms: Statistics,
    /// The same on the first device alone.
    pub latency_alone_ms: Statistics,
    /// GPU time of the slowest band in milliseconds, with the rounding to 8 bits.
    pub slowest_gpu_ms: Statistics,
    /// GPU time on the first device alone in milliseconds.
    pub gpu_alone_ms: Statistics,
    /// The GPU time of the slowest band over the mean of all bands.
    pub slowest_over_mean: Statistics,
    pub devices: Vec<SplitDevice>,
}

/// The part of one device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SplitDevice {
    pub device: String,
    /// Rows of its band.
    pub rows: Statistics,
    /// GPU time of its band in milliseconds, with the rounding to 8 bits.
    pub gpu_ms: Statistics,
    /// Milliseconds from the end of its own band to the end of the slowest.
    pub wait_ms: Statistics,
    /// Milliseconds of its band beside the GPU time: of the host, and of the copy to it.
    pub transfer_ms: Statistics,
    /// Medians of its stages in milliseconds.
    pub stages: Vec<StageTime>,
}

/// The time of a stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StageTime {
    pub name: String,
    /// Milliseconds.
    pub ms: f64,
}

/// The speed of a device while all draw.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DeviceSpeed {
    pub device: String,
    /// Frames per second if the host does not wait for each.
    pub frames_per_second: f64,
}

/// The subject of a run, which identifies it within a report.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Subject {
    pub scene: SceneReport,
    /// Width and height in pixels.
    pub size: [u32; 2],
    pub preset: String,
    /// The options of the preset with all overrides.
    pub options: Options,
    /// BLAKE3 of the cameras.
    pub views_hash: String,
}

/// The scene that was drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneReport {
    pub name: String,
    pub gaussians: usize,
    pub sh_degree: u32,
    /// BLAKE3 of the Gaussians after reading, independent of the file format.
    pub hash: String,
}

/// The times of whole frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FrameTimes {
    /// GPU time between two timestamps.
    pub gpu_ms: Statistics,
    /// Wall time from the call to the end of the wait, one frame at a time.
    pub wall_ms: Statistics,
    /// Wall time per frame if the next frame is recorded while one runs.
    pub pipelined_ms: f64,
    /// GPU time with timestamps around every stage.
    pub staged_gpu_ms: Statistics,
    /// Cost of these timestamps: `staged_gpu_ms` minus `gpu_ms`, medians.
    pub timestamps_cost_ms: f64,
}

/// Cuts through levels of detail, over the measured frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DetailReport {
    /// Nodes of the cut that lie in the picture, hidden or not, according to the table of levels.
    pub nodes: Statistics,
    /// Pages that hold the cut.
    pub pages: Statistics,
    /// The PSNR if the errors of the nodes were independent and none were hidden, dB; null without errors. No bound,
    /// and far below the PSNR of most pictures.
    pub predicted_psnr: Option<Statistics>,
    /// The PSNR of the pictures of all views against those of all Gaussians, dB; null if it was not measured, or all
    /// are equal.
    pub measured_psnr: Option<Statistics>,
    /// The standard errors of these PSNR where they are estimated from patches of the pictures, dB; otherwise null.
    #[serde(default)]
    pub standard_error: Option<Statistics>,
    /// The wall time of a measurement by --measure-levels, after the picture by levels is there, ms; null without.
    #[serde(default)]
    pub measurement_ms: Option<Statistics>,
}

impl DetailReport {
    /// Takes the measured PSNR of pictures into the report.
    pub(crate) fn set_measured(&mut self, pictures: &[LodReport]) {
        let all = |of: fn(&LodReport) -> Option<f64>| {
            let values: Vec<f64> = pictures.iter().filter_map(of).collect();
            (!values.is_empty()).then(|| Statistics::of(values))
        };
        self.measured_psnr = all(|picture| picture.measured_psnr);
        self.standard_error = all(|picture| picture.standard_error);
    }
}

/// One stage of the frame on the GPU.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StageReport {
    pub name: String,
    pub ms: Statistics,
    /// Least number of bytes that the stage moves through device memory: every input read once, every output written
    /// once. Median over the frames.
    pub least_bytes: u64,
    /// Time of a copy of `least_bytes` divided by the stage's median time.
    pub bandwidth_fraction: f64,
}

/// Amount of work of the measured frames. All counts except `entries` are those of the portable path, which draws the
/// same views again with counters. Of frames in slabs, `listed_tiles` and `longest_list` are the most of any slab, the
/// others sums over the slabs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Counts {
    /// Gaussians that passed the cull.
    pub visible: Statistics,
    /// Instances: pairs of a splat and a tile of 16x16 pixels that it touches.
    pub instances: Statistics,
    /// Entries: pairs of a splat and a bin of the fast path that it touches, over the frames that the fast path drew;
    /// null if it drew none.
    pub entries: Option<Statistics>,
    /// Tiles of the image.
    pub tiles: u32,
    /// Tiles with at least one instance.
    pub listed_tiles: Statistics,
    /// Instances of the fullest tile.
    pub longest_list: Statistics,
    /// Instances of a pixel's tile, mean over the pixels.
    pub listed_per_pixel: Statistics,
    /// Alphas computed for a pixel before it stopped, mean over the pixels.
    pub evaluations_per_pixel: Statistics,
    /// The same with idle lanes of working subgroups included.
    pub lanes_per_pixel: Statistics,
    /// Fraction of the pixels that stop before their list ends.
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

/// BLAKE3 of cameras.
pub fn views_hash(views: &[Camera]) -> String {
    let mut hasher = blake3::Hasher::new();
    for Camera { position, rotation, focal_px, centre_px, size_px, lens } in views {
        hasher.update(bytemuck::bytes_of(position)).update(bytemuck::bytes_of(rotation));
        hasher.update(bytemuck::bytes_of(focal_px)).update(bytemuck::bytes_of(centre_px));
        hasher.update(bytemuck::bytes_of(size_px));
        if let Some(lens) = lens {
            hasher.update(format!("{lens:?}").as_bytes());
        }
    }
    hasher.finalize().to_hex().to_string()
}

impl SceneReport {
    /// Describes a scene and hashes its Gaussians.
    pub fn of(name: String, gaussians: &Gaussians) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update_rayon(bytemuck::cast_slice(gaussians.means()));
        hasher.update_rayon(bytemuck::cast_slice(gaussians.scales()));
        hasher.update_rayon(bytemuck::cast_slice(gaussians.rotations()));
        hasher.update_rayon(bytemuck::cast_slice(gaussians.opacities()));
        hasher.update_rayon(bytemuck::cast_slice(gaussians.all_sh()));
        let hash = hasher.finalize().to_hex().to_string();
        Self { name, gaussians: gaussians.len(), sh_degree: gaussians.sh_degree(), hash }
    }
}

impl Subject {
    /// Describes a run over `views`, which are not empty and of one size.
    pub fn new(scene: &SceneReport, preset: &str, options: &Options, views: &[Camera]) -> Self {
        Self {
            scene: scene.clone(),
            size: views[0].size_px,
            preset: preset.to_owned(),
            options: *options,
            views_hash: views_hash(views),
        }
    }

    /// Scene, size and preset in a line.
    pub fn title(&self) -> String {
        let [width, height] = self.size;
        format!("{} {width}x{height} {}", self.scene.name, self.preset)
    }
}

impl Report {
    /// Name and version of the format, the first member of every report.
    pub const FORMAT: &str = "smalto bench 3";

    /// Reads a report of this format.
    ///
    /// # Errors
    /// A phrase that continues the file's name, such as "is not JSON".
    pub fn read(path: &Path) -> Result<Self> {
        let value: serde_json::Value = serde_json::from_slice(&read_whole(path)?).context("is not JSON")?;
        let format = value.get("format").and_then(|f| f.as_str()).unwrap_or("unknown");
        let expected = Self::FORMAT;
        ensure!(format == expected, "is not a report of this version: its format is {format}, not {expected}");
        serde_json::from_value(value).context("is a damaged report")
    }

    /// Writes the statistics as CSV: a row for every run and quantity.
    pub fn write_csv(&self, out: impl Write) -> Result<()> {
        let mut csv = csv::Writer::from_writer(out);
        let about = ["scene", "gaussians", "width", "height", "preset", "drawn by", "quantity"];
        csv.write_record(about.into_iter().chain(Statistics::COLUMNS))?;
        for run in &self.runs {
            let Subject { scene, size, preset, .. } = &run.subject;
            let numbers = [scene.gaussians.to_string(), size[0].to_string(), size[1].to_string()];
            let names = [preset.clone(), run.drawn_by.to_string()];
            let about: Vec<_> = [scene.name.clone()].into_iter().chain(numbers).chain(names).collect();
            for (quantity, statistics) in run.rows() {
                let values = statistics.columns().map(|v| v.to_string());
                csv.write_record(about.iter().cloned().chain([quantity]).chain(values))?;
            }
        }
        Ok(csv.flush()?)
    }
}

impl Run {
    /// Names and values of all statistics.
    pub fn rows(&self) -> Vec<(String, Statistics)> {
        let (frame, counts) = (&self.frame, &self.counts);
        let mut rows = vec![
            ("frame gpu ms".to_owned(), frame.gpu_ms),
            ("frame wall ms".to_owned(), frame.wall_ms),
            ("frame gpu ms with stage timestamps".to_owned(), frame.staged_gpu_ms),
        ];
        rows.extend(self.stages.iter().map(|stage| (format!("{} ms", stage.name), stage.ms)));
        let counted = [
            ("visible", Some(counts.visible)),
            ("instances", Some(counts.instances)),
            ("entries", counts.entries),
            ("listed tiles", Some(counts.listed_tiles)),
            ("longest list", Some(counts.longest_list)),
            ("listed per pixel", Some(counts.listed_per_pixel)),
            ("evaluations per pixel", Some(counts.evaluations_per_pixel)),
            ("lanes per pixel", Some(counts.lanes_per_pixel)),
            ("early exit rate", Some(counts.early_exit_rate)),
        ];
        rows.extend(counted.into_iter().filter_map(|(name, statistics)| Some((name.to_owned(), statistics?))));
        rows
    }
}
