//! Camera files: which kind one is, where they lie beside a scene, and what is in them.

use anyhow::{Result, ensure};
use glam::DMat3;

use super::{Camera, MAX_POSITION, MAX_SIDE};

/// A camera and the name of its photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedCamera {
    pub name: String,
    pub camera: Camera,
}

/// What a photograph is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    Train,
    Val,
    Test,
}

/// Of how many photographs, sorted by name, the first one is for tests.
const HOLD_OUT: usize = 8;

/// The cameras of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraFile {
    /// In the order of the file; those of COLMAP, whose files have none, by name.
    pub cameras: Vec<NamedCamera>,
    /// The splits that each camera is in, if the file says.
    pub splits: Option<Vec<Vec<Split>>>,
    /// What is drawn otherwise than the file says, and what was left out of it: a sentence each.
    pub notices: Vec<String>,
}

impl CameraFile {
    /// The cameras of a split, by what the file says of splits. If it says nothing, by the usual rule: of the cameras
    /// sorted by name, every eighth from the first on is for tests, the others are for training.
    pub fn of(self, split: Split) -> Vec<NamedCamera> {
        let splits = self.splits.unwrap_or_else(|| by_name(&self.cameras));
        let cameras = self.cameras.into_iter().zip(splits);
        cameras.filter(|(_, splits)| splits.contains(&split)).map(|(camera, _)| camera).collect()
    }

    /// The cameras of both, one after the other; one that says nothing of splits is in none.
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

/// Beyond this no scene can be seen in 32-bit floats.
const MAX_FOCAL_PX: f64 = 1e9;

impl Camera {
    /// The camera, if one can draw with it.
    pub(super) fn checked(self) -> Result<Self> {
        let Self { position, rotation, focal_px, centre_px, size_px } = &self;
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
        let error = (*rotation * rotation.transpose() - DMat3::IDENTITY)
            .to_cols_array()
            .iter()
            .fold(0.0, |m: f64, v| if v.is_nan() { f64::INFINITY } else { m.max(v.abs()) });
        ensure!(error < 1e-3 && rotation.determinant() > 0.0, "its rotation is not a rotation matrix");
        Ok(self)
    }
}
