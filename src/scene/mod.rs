//! What is drawn: the Gaussians of a scene, validated and made canonical once, when they are read.

mod bounds;
mod canonical;
mod compressed_ply;
mod edit;
mod gltf;
mod grid;
pub mod harmonics;
mod ksplat;
mod loss;
mod morton;
mod ply;
mod procedural;
mod reading;
mod requirements;
mod sog;
mod source;
mod splat;
mod spz;
pub mod synthetic;
mod transform;
mod write;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

pub use bounds::{Bounds, Focus, percentiles};
pub use canonical::{Builder, Raw, Tally};
pub use edit::RIGHT_UP_BACK;
pub use grid::Grid;
pub use loss::Loss;
pub use procedural::Procedural;
pub use reading::Reading;
pub use requirements::{Band, Requirements, bands, decode_rotation, encode_rotation};
pub use transform::Transform;
pub use write::{SceneFile, write_sog_folder};

/// Highest degree of spherical harmonics that a scene may have.
pub const MAX_SH_DEGREE: u32 = 3;

/// Coefficients of spherical harmonics up to `degree`, for one colour channel.
pub const fn sh_coefficients(degree: u32) -> usize {
    ((degree + 1) * (degree + 1)) as usize
}

/// Numbers that files keep apart from the first coefficient: those of the others, for all three channels.
const fn rest_values(degree: u32) -> usize {
    3 * (sh_coefficients(degree) - 1)
}

/// A scene on the CPU as a structure of arrays: canonical, finite, ready for every renderer.
///
/// World axes are COLMAP's (right, down, forward). A [`Builder`] is the only way to make one, [`Gaussians::transformed`] and
/// [`Gaussians::joined`] make others of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gaussians {
    means: Vec<[f32; 3]>,
    scales: Vec<[f32; 3]>,
    rotations: Vec<[f32; 4]>,
    opacities: Vec<f32>,
    sh: Vec<[f32; 3]>,
    sh_degree: u32,
}

impl Gaussians {
    pub fn len(&self) -> usize {
        self.means.len()
    }

    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// World units.
    pub fn means(&self) -> &[[f32; 3]] {
        &self.means
    }

    /// Standard deviations along the local axes in world units: finite, zero allowed.
    pub fn scales(&self) -> &[[f32; 3]] {
        &self.scales
    }

    /// Unit quaternions w x y z, local to world.
    pub fn rotations(&self) -> &[[f32; 4]] {
        &self.rotations
    }

    /// After the sigmoid: over 0, at most 1.
    pub fn opacities(&self) -> &[f32] {
        &self.opacities
    }

    /// The spherical harmonics of Gaussian `index`: red, green, blue of each of [`sh_coefficients`] basis functions.
    pub fn sh(&self, index: usize) -> &[[f32; 3]] {
        let stride = sh_coefficients(self.sh_degree);
        &self.sh[index * stride..][..stride]
    }

    pub fn sh_degree(&self) -> u32 {
        self.sh_degree
    }
}

/// A scene and what was done to make it canonical.
#[derive(Debug)]
pub struct Scene {
    pub gaussians: Gaussians,
    pub tally: Tally,
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

/// Who waits for a scene to be read. All are called on the thread that reads.
#[derive(Clone, Copy)]
pub struct Watch<'w> {
    /// Told the fraction of the file read so far.
    pub progress: &'w dyn Fn(f64),
    /// Shown what was decoded so far, in the order of the scene: first when they are 65,536 or more, then whenever
    /// they have doubled, and never when they are all.
    pub partial: &'w dyn Fn(&Builder),
    /// Asked now and then, some 200 times a file and once every 65,536 Gaussians. When it says so, and goes on saying
    /// so, reading ends with [`Cancelled`].
    pub is_cancelled: &'w dyn Fn() -> bool,
}

/// No one waits for the scene any more: reading was cancelled by [`Watch::is_cancelled`].
#[derive(Debug, thiserror::Error)]
#[error("cancelled")]
pub struct Cancelled;

/// Reads a scene file as it is: [`Reading::read`].
///
/// # Errors
/// Those of [`Reading::read`].
pub fn read(path: &Path, progress: &dyn Fn(f64)) -> Result<Scene> {
    Reading::default().read(path, progress)
}

/// The scene of a model folder of the original 3DGS: the point cloud of the last iteration. Any other path is as it is.
pub fn in_folder(path: &Path) -> PathBuf {
    let iterations = std::fs::read_dir(path.join("point_cloud")).into_iter().flatten().flatten();
    let number = |folder: &Path| folder.file_name()?.to_str()?.strip_prefix("iteration_")?.parse::<u64>().ok();
    let last = iterations.map(|entry| entry.path()).filter_map(|f| Some((number(&f)?, f))).max();
    last.map_or_else(|| path.to_owned(), |(_, folder)| folder.join("point_cloud.ply"))
}

/// A count from a file header as a length, refused when the file cannot hold so many elements of `bytes` each.
fn checked_count(count: u64, bytes: u64, available: u64, what: &str) -> Result<usize> {
    let needed = count.checked_mul(bytes).with_context(|| format!("the header claims {count} {what}"))?;
    ensure!(
        needed <= available,
        "the file is truncated or its header wrong: {count} {what} need {needed} bytes, {available} are left"
    );
    Ok(usize::try_from(count)?)
}
