//! A scene that was read, its load report, and the error of a file that cannot be read.

use std::fmt;
use std::path::Path;

use serde::Serialize;

use super::Gaussians;

/// How many Gaussians a file had, and what became of those that could not be taken as they were.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LoadReport {
    pub read: usize,
    /// Dropped: a mean, scale, rotation, opacity or colour that is not a number, infinite where that means nothing, or
    /// too large for 32-bit floats to compute with.
    pub not_finite: usize,
    /// Dropped: a quaternion of length zero has no direction.
    pub zero_rotation: usize,
    /// Dropped: opacity zero.
    pub transparent: usize,
    /// Kept: a scale beyond the range of 32-bit floats, made the largest of them.
    pub clamped_scale: usize,
}

impl LoadReport {
    pub fn dropped(&self) -> usize {
        self.not_finite + self.zero_rotation + self.transparent
    }

    /// Of two parts of a scene.
    pub(super) fn and(&self, other: &Self) -> Self {
        Self {
            read: self.read + other.read,
            not_finite: self.not_finite + other.not_finite,
            zero_rotation: self.zero_rotation + other.zero_rotation,
            transparent: self.transparent + other.transparent,
            clamped_scale: self.clamped_scale + other.clamped_scale,
        }
    }

    /// Whether the scene is as the file has it, but for Gaussians that no one could see.
    pub fn is_clean(&self) -> bool {
        self.not_finite + self.zero_rotation + self.clamped_scale == 0
    }
}

/// What was dropped or repaired, as a clause; "nothing dropped" if nothing was.
impl fmt::Display for LoadReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parts = [
            (self.not_finite, "dropped as not finite in 32-bit floats"),
            (self.zero_rotation, "dropped for a zero quaternion"),
            (self.transparent, "dropped as fully transparent"),
            (self.clamped_scale, "with a scale clamped to the largest float"),
        ];
        let parts: Vec<_> = parts.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
        f.write_str(if parts.is_empty() { "nothing dropped" } else { "" })?;
        f.write_str(&parts.join(", "))
    }
}

/// A scene and what was done to make it canonical.
#[derive(Debug)]
pub struct Scene {
    pub gaussians: Gaussians,
    pub report: LoadReport,
    /// What it was read from: "SPZ 4", "PLY", ...
    pub format: String,
    /// Trained with the antialiasing of Mip-Splatting, and drawn with it.
    pub is_antialiased: bool,
    /// What is drawn otherwise than the file asks for, a clause each.
    pub notices: Vec<String>,
}

/// A file that cannot be used: which, and why, in one sentence.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {problem}")]
pub struct Unreadable {
    pub path: String,
    pub problem: String,
}

impl Unreadable {
    pub fn new(path: &Path, problem: &anyhow::Error) -> Self {
        Self { path: path.display().to_string(), problem: sentence(&format!("{problem:#}")) }
    }
}

/// On one line, and no longer than one reads, whatever names and numbers of the file are in it.
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
