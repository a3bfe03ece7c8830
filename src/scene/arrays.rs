//! Gaussians from arrays of 32-bit floats, as training programs hold them.

use super::stored::Activated;
use super::{Builder, Gaussians, LoadReport, sh_coefficients};
use crate::host_memory::OutOfMemory;

/// Arrays with a row per Gaussian, after the activations, in the axes right, down, forward.
#[derive(Clone, Copy, Debug)]
pub struct Arrays<'a> {
    /// World units.
    pub means: &'a [[f32; 3]],
    /// Quaternions w x y z of any length but 0.
    pub rotations: &'a [[f32; 4]],
    /// Standard deviations in world units.
    pub scales: &'a [[f32; 3]],
    /// From 0 to 1.
    pub opacities: &'a [f32],
    /// Coefficients of spherical harmonics, all of a Gaussian after those of another.
    pub sh: &'a [[f32; 3]],
    pub sh_degree: u32,
}

impl Arrays<'_> {
    /// The Gaussians that can be drawn, in the order of the arrays, and what was dropped or changed.
    ///
    /// # Errors
    /// [`OutOfMemory`] if their memory cannot be allocated.
    ///
    /// # Panics
    /// If arrays have different numbers of rows.
    pub fn gaussians(&self) -> Result<(Gaussians, LoadReport), OutOfMemory> {
        let (count, stride) = (self.opacities.len(), sh_coefficients(self.sh_degree));
        let rows = [self.means.len(), self.rotations.len(), self.scales.len(), self.sh.len() / stride];
        assert!(rows.iter().all(|rows| *rows == count), "every array has a row for each of {count} Gaussians");
        let mut builder = Builder::new(self.sh_degree, count)?;
        builder.extend(count, |i, sh| {
            sh.copy_from_slice(&self.sh[i * stride..][..stride]);
            Activated {
                mean: self.means[i].map(f64::from),
                scale: self.scales[i].map(f64::from),
                rotation: self.rotations[i].map(f64::from),
                opacity: self.opacities[i].into(),
            }
        });
        Ok(builder.finish())
    }
}
