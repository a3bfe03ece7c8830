//! A posed photograph of a model.

use std::collections::HashMap;

use anyhow::{Context, Result, ensure};
use glam::{DMat3, DQuat, DVec3};

use super::models::Intrinsics;
use crate::camera::{Camera, NamedCamera};

/// A photograph: its pose, and the id of its camera.
pub(super) struct Photograph {
    pub name: String,
    /// Quaternion w x y z from the world to the camera, of any length over 0.
    pub rotation: [f64; 4],
    /// Added after the rotation, world units.
    pub translation: [f64; 3],
    pub camera: u32,
}

impl Photograph {
    /// The checked camera of the photograph, with its lens.
    pub fn seen_with(&self, cameras: &HashMap<u32, Intrinsics>) -> Result<NamedCamera> {
        let Intrinsics { focal_px, centre_px, size_px, lens } =
            cameras.get(&self.camera).with_context(|| format!("there is no camera {}", self.camera))?;
        let [w, x, y, z] = self.rotation;
        let length = DQuat::from_xyzw(x, y, z, w).length();
        ensure!(length > 0.0 && length.is_finite(), "its quaternion {w:?} {x:?} {y:?} {z:?} is no rotation");
        let rotation = DMat3::from_quat(DQuat::from_xyzw(x / length, y / length, z / length, w / length));
        let position = -(rotation.transpose() * DVec3::from(self.translation));
        let (focal_px, centre_px, size_px) = (*focal_px, *centre_px, *size_px);
        let camera = Camera { position, rotation, focal_px, centre_px, size_px, lens: lens.clone() };
        Ok(NamedCamera::new(self.name.clone(), camera.checked()?))
    }
}
