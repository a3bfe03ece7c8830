//! A scene that was read, its load report, and the error for a file that cannot be used.

use std::fmt;
use std::path::Path;

use schemars::JsonSchema;
use serde::Serialize;

use super::Gaussians;
use crate::host_memory::OutOfMemory;

/// Number of Gaussians in a file, and of those that were dropped or changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct LoadReport {
    /// Gaussians in the file.
    pub read: usize,
    /// Dropped: a mean, scale, rotation, opacity or colour is not a number, or is infinite where that has no meaning.
    pub not_finite: usize,
    /// Dropped: a mean or a colour is too large for arithmetic in 32-bit floats.
    pub too_large: usize,
    /// Dropped: a standard deviation is below 0.
    pub negative_scale: usize,
    /// Dropped: the opacity is below -0.01 or above 1.01.
    pub opacity_range: usize,
    /// Dropped: the quaternion has length zero.
    pub zero_rotation: usize,
    /// Dropped: the opacity is zero.
    pub transparent: usize,
    /// Kept: a scale was beyond the range of 32-bit floats and became the largest of them.
    pub clamped_scale: usize,
    /// Kept: the opacity was above 1 by up to 0.01, a rounding, and became 1.
    pub clamped_opacity: usize,
    /// Kept: all standard deviations were below the range of 32-bit floats and became 0.
    pub vanished: usize,
    /// Kept: the rounding to 32-bit floats moved the mean by over a tenth of the largest standard deviation.
    pub displaced: usize,
    /// Largest distance by which the rounding to 32-bit floats moved a mean, in world units.
    pub displacement: f64,
    /// Sum of the squares of these distances.
    #[serde(skip)]
    pub displacement_squares: f64,
}

impl LoadReport {
    /// Number of dropped Gaussians.
    pub fn dropped(&self) -> usize {
        self.unusable() + self.transparent
    }

    /// Number of Gaussians that were dropped because of wrong values.
    fn unusable(&self) -> usize {
        self.not_finite + self.too_large + self.negative_scale + self.opacity_range + self.zero_rotation
    }

    /// The sum of the reports of two parts of a scene.
    pub(crate) fn and(&self, other: &Self) -> Self {
        Self {
            read: self.read + other.read,
            not_finite: self.not_finite + other.not_finite,
            too_large: self.too_large + other.too_large,
            negative_scale: self.negative_scale + other.negative_scale,
            opacity_range: self.opacity_range + other.opacity_range,
            zero_rotation: self.zero_rotation + other.zero_rotation,
            transparent: self.transparent + other.transparent,
            clamped_scale: self.clamped_scale + other.clamped_scale,
            clamped_opacity: self.clamped_opacity + other.clamped_opacity,
            vanished: self.vanished + other.vanished,
            displaced: self.displaced + other.displaced,
            displacement: self.displacement.max(other.displacement),
            displacement_squares: self.displacement_squares + other.displacement_squares,
        }
    }

    /// Number of Gaussians that were kept, but changed.
    fn changed(&self) -> usize {
        self.clamped_scale + self.clamped_opacity + self.vanished + self.displaced
    }

    /// What was dropped or changed, as a clause.
    pub fn notice(&self) -> Option<String> {
        (self.dropped() + self.changed() > 0).then(|| format!("of {} Gaussians {self}", self.read))
    }

    /// True if nothing was changed by more than a rounding, and only invisible Gaussians were dropped.
    pub fn is_clean(&self) -> bool {
        self.unusable() + self.clamped_scale + self.vanished + self.displaced == 0
    }
}

/// Writes the counts as a clause, or "nothing dropped".
impl fmt::Display for LoadReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parts = [
            (self.not_finite, "dropped as not finite"),
            (self.too_large, "dropped as too large for 32-bit floats"),
            (self.negative_scale, "dropped for a negative scale"),
            (self.opacity_range, "dropped for an opacity outside of 0 to 1"),
            (self.zero_rotation, "dropped for a zero quaternion"),
            (self.transparent, "dropped as fully transparent"),
            (self.clamped_scale, "with a scale clamped to the largest float"),
            (self.clamped_opacity, "with an opacity just above 1, drawn as 1"),
            (self.vanished, "with scales below the smallest float, which became 0"),
        ];
        let mut parts: Vec<_> = parts.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
        if self.displaced > 0 {
            let (displaced, most) = (self.displaced, self.displacement);
            parts.push(format!(
                "{displaced} moved by over a tenth of their size, up to {most:.2e}, by rounding to 32-bit floats"
            ));
        }
        f.write_str(if parts.is_empty() { "nothing dropped" } else { "" })?;
        f.write_str(&parts.join(", "))
    }
}

/// Differences between a scene and its file, one sentence each.
pub fn remarks(name: &str, report: &LoadReport, notices: &[String]) -> Vec<String> {
    let mut remarks: Vec<String> = notices.iter().map(|notice| format!("note: {name}: {notice}")).collect();
    if let Some(said) = report.notice() {
        let level = if report.is_clean() { "note" } else { "warning" };
        remarks.push(format!("{level}: {name}: {said}"));
    }
    remarks
}

/// A scene that was read from a file or generated.
#[derive(Debug)]
pub struct Scene {
    /// The Gaussians that can be drawn.
    pub gaussians: Gaussians,
    /// Counts of Gaussians that were dropped or changed.
    pub report: LoadReport,
    /// The format of the file: "SPZ 4", "PLY", ...
    pub format: String,
    /// It was trained with the antialiasing of Mip-Splatting and should be drawn with it.
    pub is_antialiased: bool,
    /// Differences between the file and the picture, one clause each.
    pub notices: Vec<String>,
    /// The levels of detail of the file, the finest first; empty if its format has none.
    pub levels: Vec<SceneLevel>,
}

impl Scene {
    /// A procedural scene of this name.
    pub(crate) fn made(name: &str, gaussians: Gaussians, report: LoadReport) -> Self {
        Self { gaussians, report, ..Self::empty(&format!("procedural {name}")) }
    }

    /// A scene of this format without Gaussians, notices and levels, not antialiased.
    pub fn empty(format: &str) -> Self {
        Self {
            gaussians: Gaussians::default(),
            report: LoadReport::default(),
            format: format.to_owned(),
            is_antialiased: false,
            notices: Vec::new(),
            levels: Vec::new(),
        }
    }
}

/// A level of detail of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
#[schemars(rename = "Level")]
pub struct SceneLevel {
    /// Its number, 0 the finest.
    pub level: u32,
    /// Its number of Gaussians in the file, with those of the environment, which belong to all levels.
    pub gaussians: u64,
}

/// The error where a level of detail is asked for that the scene does not have.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {problem}")]
pub struct NoLevel {
    /// The scene.
    pub path: String,
    /// The levels that it has, as a clause.
    pub problem: String,
}

impl NoLevel {
    /// The error for a scene without numbered levels. The reader of the file adds its path.
    pub fn none() -> Self {
        Self::of("there are no numbered levels of detail; only a lod-meta.json has them".to_owned())
    }

    /// The error for a scene all of whose levels are asked for. The reader of the file adds its path.
    pub(crate) fn no_levels() -> Self {
        Self::of("there are no levels of detail; only a lod-meta.json or a .rad with a tree has them".to_owned())
    }

    /// The error with the path of the file.
    #[must_use]
    pub fn of_file(self, path: &Path) -> Self {
        Self { path: path.display().to_string(), ..self }
    }

    pub(crate) fn of(problem: String) -> Self {
        Self { path: String::new(), problem }
    }
}

/// The error for a file that cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {problem}")]
pub struct Unreadable {
    /// The file.
    pub path: String,
    /// Why, in one sentence on one line.
    pub problem: String,
}

impl Unreadable {
    /// `problem` with its causes, escaped and shortened to one line.
    pub fn new(path: &Path, problem: &anyhow::Error) -> Self {
        Self { path: path.display().to_string(), problem: sentence(&format!("{problem:#}")) }
    }

    /// The note on a camera file that nobody named, was found beside a scene, and cannot be used.
    pub fn as_passed_over(&self) -> String {
        let Self { path, problem } = self;
        format!("{path} was found, but it is not used: {problem} (--cameras names another file)")
    }

    /// The error of a file that cannot be read because of `problem`: an [`OutOfMemory`] with the name of the file, or
    /// else an [`Unreadable`].
    pub fn or_too_large(path: &Path, problem: anyhow::Error) -> anyhow::Error {
        match problem.downcast::<OutOfMemory>() {
            Ok(too_large) => anyhow::Error::new(too_large).context(path.display().to_string()),
            Err(problem) => Self::new(path, &problem).into(),
        }
    }
}

/// The text with control characters escaped, and without its middle if it has more than 600 characters.
fn sentence(text: &str) -> String {
    const BEGIN: usize = 400;
    const END: usize = 200;
    let escape = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.to_string() };
    let letters: Vec<String> = text.chars().map(escape).collect();
    if letters.len() <= BEGIN + END {
        return letters.concat();
    }
    format!("{} ... {}", letters[..BEGIN].concat(), letters[letters.len() - END..].concat())
}
