//! Camera models of COLMAP: the number and the meaning of their parameters.

use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use glam::DVec2;

use crate::camera::{Lens, MAX_SIDE};

/// The intrinsics of a camera, shared by its photographs.
pub(super) struct Intrinsics {
    pub focal_px: DVec2,
    pub centre_px: DVec2,
    pub size_px: [u32; 2],
    /// None for a pinhole.
    pub lens: Option<Arc<Lens>>,
}

/// A camera model. Its parameters are focal lengths, principal point, then those of the lens.
pub(super) struct Model {
    id: i32,
    name: &'static str,
    /// 0 for EQUIRECTANGULAR, which has the width and the height of the sphere in their place.
    focal_lengths: usize,
}

const fn model(id: i32, name: &'static str, focal_lengths: usize) -> Model {
    Model { id, name, focal_lengths }
}

const MODELS: [Model; 18] = [
    model(0, "SIMPLE_PINHOLE", 1),
    model(1, "PINHOLE", 2),
    model(2, "SIMPLE_RADIAL", 1),
    model(3, "RADIAL", 1),
    model(4, "OPENCV", 2),
    model(5, "OPENCV_FISHEYE", 2),
    model(6, "FULL_OPENCV", 2),
    model(7, "FOV", 2),
    model(8, "SIMPLE_RADIAL_FISHEYE", 1),
    model(9, "RADIAL_FISHEYE", 1),
    model(10, "THIN_PRISM_FISHEYE", 2),
    model(11, "RAD_TAN_THIN_PRISM_FISHEYE", 2),
    model(12, "SIMPLE_DIVISION", 1),
    model(13, "DIVISION", 2),
    model(14, "SIMPLE_FISHEYE", 1),
    model(15, "FISHEYE", 2),
    model(16, "EUCM", 2),
    model(17, "EQUIRECTANGULAR", 0),
];

/// Smallest number of parameters of a model.
pub(super) const LEAST_PARAMETERS: u64 = 2;

impl Model {
    pub fn by_id(id: i32) -> Result<&'static Self> {
        let found = MODELS.iter().find(|model| model.id == id);
        found.with_context(|| format!("its camera model {id} is not one of COLMAP's, 0 to 17"))
    }

    pub fn by_name(name: &str) -> Result<&'static Self> {
        let found = MODELS.iter().find(|model| model.name == name);
        found.with_context(|| format!("its camera model {} is not one of COLMAP's", name.escape_debug()))
    }

    pub fn parameters(&self) -> usize {
        self.focal_lengths + 2 + Lens::parameter_names(self.name).map_or(0, <[_]>::len)
    }

    /// The intrinsics of a camera of this model.
    pub fn intrinsics(&self, size_px: [u64; 2], parameters: &[f64]) -> Result<Intrinsics> {
        let (name, wanted, found) = (self.name, self.parameters(), parameters.len());
        ensure!(found == wanted, "{name} has {wanted} parameters, it has {found}");
        ensure!(parameters.iter().all(|p| p.is_finite()), "its parameters are not all numbers");
        let [width, height] = size_px;
        let sides = size_px.map(|side| u32::try_from(side).ok().filter(|side| (1..=MAX_SIDE).contains(side)));
        let [Some(w), Some(h)] = sides else { bail!("its size {width}x{height} is not from 1 to {MAX_SIDE} pixels") };
        let (focal_px, rest) = parameters.split_at(self.focal_lengths);
        let (centre_px, rest) = rest.split_at(2);
        let centre_px = DVec2::from_slice(centre_px);
        let [focal_px, centre_px] = match focal_px {
            [] => Lens::sphere_px(centre_px),
            &[.., y] => [DVec2::new(focal_px[0], y), centre_px],
        };
        let lens = Lens::named(name, rest)?.map(Arc::new);
        Ok(Intrinsics { focal_px, centre_px, size_px: [w, h], lens })
    }
}
