//! The Gaussians of a scene on the CPU.

use crate::host_memory::{OutOfMemory, host_zeros};

/// Highest supported degree of spherical harmonics.
pub const MAX_SH_DEGREE: u32 = 4;

/// The degree that the original 3DGS trains, and the highest that most formats hold.
pub const USUAL_SH_DEGREE: u32 = 3;

/// Number of coefficients of spherical harmonics up to `degree`, for one colour channel.
pub const fn sh_coefficients(degree: u32) -> usize {
    ((degree + 1) * (degree + 1)) as usize
}

/// Number of coefficients of degrees 1 to `degree`, for all three channels. Files store them apart from degree 0.
pub(crate) const fn rest_values(degree: u32) -> usize {
    3 * (sh_coefficients(degree) - 1)
}

/// The Gaussians of a scene as a structure of arrays: canonical and finite.
///
/// World axes are those of COLMAP (right, down, forward). Only a [`Builder`](super::Builder) makes them from values;
/// [`Gaussians::transformed`], [`Gaussians::joined`] and others derive new ones.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gaussians {
    pub(crate) means: Vec<[f32; 3]>,
    pub(crate) scales: Vec<[f32; 3]>,
    pub(crate) rotations: Vec<[f32; 4]>,
    pub(crate) opacities: Vec<f32>,
    pub(crate) sh: Vec<[f32; 3]>,
    pub(crate) sh_degree: u32,
}

impl Gaussians {
    /// Gaussians whose values are all 0, to be filled.
    ///
    /// # Errors
    /// [`OutOfMemory`] if they cannot be allocated.
    pub(crate) fn zeros(sh_degree: u32, count: usize) -> Result<Self, OutOfMemory> {
        Ok(Self {
            means: host_zeros(count, "means")?,
            scales: host_zeros(count, "scales")?,
            rotations: host_zeros(count, "rotations")?,
            opacities: host_zeros(count, "opacities")?,
            sh: host_zeros(count * sh_coefficients(sh_degree), "spherical harmonics")?,
            sh_degree,
        })
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// True if the scene has no Gaussians.
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// Means in world units.
    pub fn means(&self) -> &[[f32; 3]] {
        &self.means
    }

    /// Standard deviations along the local axes in world units: finite, at least 0.
    pub fn scales(&self) -> &[[f32; 3]] {
        &self.scales
    }

    /// Unit quaternions w x y z, local to world.
    pub fn rotations(&self) -> &[[f32; 4]] {
        &self.rotations
    }

    /// Opacities after the sigmoid: greater than 0, at most 1.
    pub fn opacities(&self) -> &[f32] {
        &self.opacities
    }

    /// The spherical harmonics of Gaussian `index`: red, green, blue for each of [`sh_coefficients`] basis functions.
    ///
    /// # Panics
    /// If `index` is not below [`Gaussians::len`].
    pub fn sh(&self, index: usize) -> &[[f32; 3]] {
        let stride = sh_coefficients(self.sh_degree);
        &self.sh[index * stride..][..stride]
    }

    /// The spherical harmonics of all Gaussians, one after another.
    pub fn all_sh(&self) -> &[[f32; 3]] {
        &self.sh
    }

    /// Degree of the stored spherical harmonics.
    pub fn sh_degree(&self) -> u32 {
        self.sh_degree
    }
}
