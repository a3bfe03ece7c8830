//! Places scenes in a world (rotation, translation, scale) and joins several into one.

use anyhow::{Result, bail, ensure};
use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

use super::harmonics::Turn;
use super::{Gaussians, sh_coefficients};
use crate::host_memory::{OutOfMemory, host_vec};

/// A similarity from local to world axes: `world = scale * rotation * local + translation`. It never mirrors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    rotation: DQuat,
    translation: DVec3,
    scale: f64,
}

impl Default for Transform {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Transform {
    /// The identity.
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, translation: DVec3::ZERO, scale: 1.0 };

    /// A similarity from a quaternion of any length over 0, a translation in world units and a positive scale.
    ///
    /// # Errors
    /// If the rotation has length zero, or a value is not finite or not positive where it must be.
    pub fn new(rotation: DQuat, translation: DVec3, scale: f64) -> Result<Self> {
        let length = rotation.length();
        ensure!(length.is_finite() && length > 0.0, "{rotation} is not a rotation");
        ensure!(translation.is_finite(), "the translation {:?} is not finite", translation.to_array());
        ensure!(scale.is_finite() && scale > 0.0, "the scale {scale:?} is not over 0 and finite");
        Ok(Self { rotation: rotation / length, translation, scale })
    }

    /// The rotation, of unit length.
    pub fn rotation(&self) -> DQuat {
        self.rotation
    }

    /// The translation in world units.
    pub fn translation(&self) -> DVec3 {
        self.translation
    }

    /// The scale, greater than 0.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// The world position of a local point.
    pub fn point(&self, local: DVec3) -> DVec3 {
        self.rotation * (local * self.scale) + self.translation
    }

    /// The composition: first `self`, then `next`.
    ///
    /// # Errors
    /// If the result is out of the range of 64-bit floats.
    pub fn then(&self, next: &Self) -> Result<Self> {
        Self::new(next.rotation * self.rotation, next.point(self.translation), next.scale * self.scale)
    }

    /// The similarity from world to local axes.
    ///
    /// # Errors
    /// If the result is out of the range of 64-bit floats.
    pub fn inverse(&self) -> Result<Self> {
        let (rotation, scale) = (self.rotation.conjugate(), self.scale.recip());
        Self::new(rotation, rotation * (self.translation * -scale), scale)
    }
}

impl Gaussians {
    /// The transformed scene, computed in f64 and rounded once. View-dependent colour rotates with it. The identity
    /// changes no bit.
    ///
    /// # Errors
    /// If a mean leaves the range of 32-bit floats, or [`OutOfMemory`].
    pub fn transformed(&self, transform: &Transform) -> Result<Self> {
        let mut moved = Self::joined(std::iter::once(self))?;
        if *transform == Transform::IDENTITY {
            return Ok(moved);
        }
        moved.means.par_iter_mut().for_each(|mean| {
            *mean = transform.point(DVec3::from(mean.map(f64::from))).to_array().map(|v| v as f32);
        });
        if let Some(far) = moved.means.par_iter().position_first(|mean| !mean.iter().all(|v| v.is_finite())) {
            let mean = transform.point(DVec3::from(self.means[far].map(f64::from)));
            bail!("Gaussian {far} would lie at {:?}, which is beyond 32-bit floats", mean.to_array());
        }
        let scaled = |s: f32| ((f64::from(s) * transform.scale) as f32).min(f32::MAX);
        moved.scales.par_iter_mut().for_each(|scale| *scale = scale.map(scaled));
        if transform.rotation != DQuat::IDENTITY {
            moved.turn(transform.rotation);
        }
        Ok(moved)
    }

    fn turn(&mut self, rotation: DQuat) {
        self.rotations.par_iter_mut().for_each(|local| {
            let [w, x, y, z] = local.map(f64::from);
            let q = (rotation * DQuat::from_xyzw(x, y, z, w)).normalize();
            *local = [q.w, q.x, q.y, q.z].map(|v| v as f32);
        });
        let turn = Turn::new(DMat3::from_quat(rotation));
        self.sh.par_chunks_exact_mut(sh_coefficients(self.sh_degree)).for_each(|sh| turn.apply(sh));
    }

    /// The Gaussians of all parts, one part after another. The SH degree is the largest of the parts; missing
    /// coefficients are 0.
    ///
    /// # Errors
    /// [`OutOfMemory`] if the result cannot be allocated.
    pub fn joined<'a>(parts: impl Iterator<Item = &'a Self>) -> Result<Self, OutOfMemory> {
        let parts: Vec<&Self> = parts.collect();
        let count = parts.iter().map(|part| part.len()).sum();
        let sh_degree = parts.iter().map(|part| part.sh_degree).max().unwrap_or(0);
        let stride = sh_coefficients(sh_degree);
        let mut all = Self {
            means: host_vec(count, "means")?,
            scales: host_vec(count, "scales")?,
            rotations: host_vec(count, "rotations")?,
            opacities: host_vec(count, "opacities")?,
            sh: host_vec(count * stride, "spherical harmonics")?,
            sh_degree,
        };
        for part in parts {
            all.means.extend_from_slice(&part.means);
            all.scales.extend_from_slice(&part.scales);
            all.rotations.extend_from_slice(&part.rotations);
            all.opacities.extend_from_slice(&part.opacities);
            if part.sh_degree == sh_degree {
                all.sh.extend_from_slice(&part.sh);
            } else {
                for sh in part.sh.chunks_exact(sh_coefficients(part.sh_degree)) {
                    let end = all.sh.len() + stride;
                    all.sh.extend_from_slice(sh);
                    all.sh.resize(end, [0.0; 3]);
                }
            }
        }
        Ok(all)
    }
}
