//! The content of a camera file: named cameras, splits, notices; and the check that a camera can be drawn with.

use anyhow::{Result, ensure};
use glam::DMat3;

use super::{Camera, MAX_POSITION, MAX_SIDE};

/// A camera with the name of its photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedCamera {
    /// Name of the photograph, or the number of the camera.
    pub name: String,
    /// Its pose and intrinsics.
    pub camera: Camera,
}

impl NamedCamera {
    /// A camera by this name.
    pub fn new(name: String, camera: Camera) -> Self {
        Self { name, camera }
    }
}

/// The use of a photograph in training.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// Training.
    Train,
    /// Validation.
    Val,
    /// Tests.
    Test,
}

/// Sorted by name, every so many photographs one is for tests, from the first on (the rule of the original 3DGS).
const HOLD_OUT: usize = 8;

/// The cameras of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraFile {
    /// In the order of the file; sorted by name for COLMAP, whose files have no order.
    pub cameras: Vec<NamedCamera>,
    /// The splits that each camera belongs to, if the file names splits.
    pub splits: Option<Vec<Vec<Split>>>,
    /// Differences from the file in what is drawn, and what was left out of it: one sentence each.
    pub notices: Vec<String>,
}

impl CameraFile {
    /// The cameras of a split. If the file names no splits, the usual rule applies: of the cameras sorted by name,
    /// every eighth from the first on is for tests, the others are for training.
    pub fn of(self, split: Split) -> Vec<NamedCamera> {
        self.numbered(split).into_iter().map(|(_, camera)| camera).collect()
    }

    /// As [`CameraFile::of`], each camera with its position in `cameras`.
    pub fn numbered(self, split: Split) -> Vec<(usize, NamedCamera)> {
        let splits = self.splits.unwrap_or_else(|| by_name(&self.cameras));
        let cameras = self.cameras.into_iter().enumerate().zip(splits);
        cameras.filter(|(_, splits)| splits.contains(&split)).map(|(camera, _)| camera).collect()
    }

    /// Both files joined, `other` after `self`. If only one of them names splits, the cameras of the other are in none.
    pub(super) fn and(mut self, other: Self) -> Self {
        if self.splits.is_some() || other.splits.is_some() {
            let none = |file: &Self| vec![Vec::new(); file.cameras.len()];
            let [mine, others] = [&self, &other].map(|file| file.splits.clone().unwrap_or_else(|| none(file)));
            self.splits = Some([mine, others].concat());
        }
        self.cameras.extend(other.cameras);
        self.notices.extend(other.notices);
        self
    }
}

fn by_name(cameras: &[NamedCamera]) -> Vec<Vec<Split>> {
    let mut order: Vec<usize> = (0..cameras.len()).collect();
    order.sort_by_key(|i| &cameras[*i].name);
    let mut splits = vec![vec![Split::Train]; cameras.len()];
    order.iter().step_by(HOLD_OUT).for_each(|i| splits[*i] = vec![Split::Test]);
    splits
}

/// Largest focal length and distance of the principal point from the corner that 32-bit floats can be drawn with.
const MAX_FOCAL_PX: f64 = 1e9;

/// Largest entry of R R^T - I of a rotation R in a file. Entries that are rounded to three decimals stay below 0.002.
const LARGEST_SKEW: f64 = 0.005;

/// Up to this skew a rotation is used as it is: entries in 32-bit floats stay below it.
const EXACT_SKEW: f64 = 1e-6;

impl Camera {
    /// This camera if a picture can be drawn with it, else an error that says why not. A rotation that is slightly
    /// skewed, by rounding in the file, becomes the nearest rotation.
    ///
    /// # Errors
    /// If it cannot be drawn with.
    pub fn checked(self) -> Result<Self> {
        let mut checked = self.checked_as_given()?;
        if skew(&checked.rotation) > EXACT_SKEW {
            checked.rotation = nearest_rotation(checked.rotation);
        }
        Ok(checked)
    }

    /// As [`Camera::checked`], but a slightly skewed rotation stays as it is.
    ///
    /// # Errors
    /// As for [`Camera::checked`].
    pub fn checked_as_given(self) -> Result<Self> {
        let Self { position, rotation, focal_px, centre_px, size_px, lens: _ } = &self;
        ensure!(
            size_px.iter().all(|side| (1..=MAX_SIDE).contains(side)),
            "its size {}x{} is not from 1 to {MAX_SIDE} pixels",
            size_px[0],
            size_px[1]
        );
        ensure!(
            focal_px.to_array().iter().all(|f| *f > 0.0 && *f <= MAX_FOCAL_PX),
            "its focal lengths {:?} and {:?} are not over 0 and up to {MAX_FOCAL_PX:e} pixels",
            focal_px.x,
            focal_px.y
        );
        ensure!(
            centre_px.to_array().iter().all(|c| c.abs() <= MAX_FOCAL_PX),
            "its principal point {:?}, {:?} is not within {MAX_FOCAL_PX:e} pixels",
            centre_px.x,
            centre_px.y
        );
        ensure!(
            position.to_array().iter().all(|p| p.abs() <= MAX_POSITION),
            "its position is not within {MAX_POSITION:e} of the origin"
        );
        let skew = skew(rotation);
        ensure!(
            skew <= LARGEST_SKEW,
            "its rotation is not a rotation matrix: R R^T differs from the identity by {skew:.2e}, over {LARGEST_SKEW}"
        );
        ensure!(rotation.determinant() > 0.0, "its rotation is not a rotation matrix: it is a reflection");
        Ok(self)
    }
}

/// The largest entry of R R^T - I; infinite for NaN.
fn skew(r: &DMat3) -> f64 {
    let entries = (*r * r.transpose() - DMat3::IDENTITY).to_cols_array();
    entries.iter().fold(0.0, |most: f64, v| if v.is_nan() { f64::INFINITY } else { most.max(v.abs()) })
}

/// The nearest rotation to a matrix that is nearly one: the orthogonal factor of its polar decomposition, by Newton's
/// iteration, which squares the error in each step.
fn nearest_rotation(mut r: DMat3) -> DMat3 {
    for _ in 0..5 {
        r = (r + r.inverse().transpose()) * 0.5;
    }
    r
}
