//! Camera models of COLMAP: the number and the meaning of their parameters.

use anyhow::{Context, Result, bail, ensure};
use glam::DVec2;

use crate::camera::MAX_SIDE;
use crate::camera::distortion::Lens;

/// The intrinsics of a camera, shared by its photographs.
pub(super) struct Intrinsics {
    pub focal_px: DVec2,
    pub centre_px: DVec2,
    pub size_px: [u32; 2],
    pub lens: Lens,
}

/// A camera model. Its parameters are focal lengths, principal point, then those of the lens.
pub(super) struct Model {
    id: i32,
    name: &'static str,
    focal_lengths: usize,
    /// Number of lens parameters.
    rest: usize,
}

const fn model(id: i32, name: &'static str, focal_lengths: usize, rest: usize) -> Model {
    Model { id, name, focal_lengths, rest }
}

/// All models except EQUIRECTANGULAR (17), which has no focal length.
const MODELS: [Model; 17] = [
    model(0, "SIMPLE_PINHOLE", 1, 0),
    model(1, "PINHOLE", 2, 0),
    model(2, "SIMPLE_RADIAL", 1, 1),
    model(3, "RADIAL", 1, 2),
    model(4, "OPENCV", 2, 4),
    model(5, "OPENCV_FISHEYE", 2, 4),
    model(6, "FULL_OPENCV", 2, 8),
    model(7, "FOV", 2, 1),
    model(8, "SIMPLE_RADIAL_FISHEYE", 1, 1),
    model(9, "RADIAL_FISHEYE", 1, 2),
    model(10, "THIN_PRISM_FISHEYE", 2, 8),
    model(11, "RAD_TAN_THIN_PRISM_FISHEYE", 2, 12),
    model(12, "SIMPLE_DIVISION", 1, 1),
    model(13, "DIVISION", 2, 1),
    model(14, "SIMPLE_FISHEYE", 1, 0),
    model(15, "FISHEYE", 2, 0),
    model(16, "EUCM", 2, 2),
];

/// Smallest number of parameters of a model.
pub(super) const LEAST_PARAMETERS: u64 = 3;

impl Model {
    pub fn by_id(id: i32) -> Result<&'static Self> {
        let found = MODELS.iter().find(|model| model.id == id);
        found.with_context(|| format!("its camera model {id} is not one of COLMAP's with a focal length, 0 to 16"))
    }

    pub fn by_name(name: &str) -> Result<&'static Self> {
        let found = MODELS.iter().find(|model| model.name == name);
        found.with_context(|| {
            format!("its camera model {} is not one of COLMAP's with a focal length", name.escape_debug())
        })
    }

    pub fn parameters(&self) -> usize {
        self.focal_lengths + 2 + self.rest
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
        Ok(Intrinsics {
            focal_px: DVec2::new(focal_px[0], focal_px[self.focal_lengths - 1]),
            centre_px: DVec2::new(centre_px[0], centre_px[1]),
            size_px: [w, h],
            lens: self.lens(rest),
        })
    }

    fn lens(&self, rest: &[f64]) -> Lens {
        let name = self.name;
        match (name, rest) {
            ("SIMPLE_RADIAL" | "RADIAL", k) => Lens::perspective(name, k, &[], [0.0; 2]),
            ("OPENCV", [k1, k2, p1, p2]) => Lens::perspective(name, &[*k1, *k2], &[], [*p1, *p2]),
            ("FULL_OPENCV", [k1, k2, p1, p2, k3, under @ ..]) => {
                Lens::perspective(name, &[*k1, *k2, *k3], under, [*p1, *p2])
            }
            ("SIMPLE_FISHEYE" | "FISHEYE" | "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE" | "OPENCV_FISHEYE", k) => {
                Lens::fisheye(name, k)
            }
            // The other models have distortions of their own. With zero parameters they are pinholes, except the
            // fisheyes.
            (_, k) if !name.ends_with("FISHEYE") && k.iter().all(|k| *k == 0.0) => {
                Lens::perspective(name, &[], &[], [0.0; 2])
            }
            _ => Lens::other(name),
        }
    }
}
