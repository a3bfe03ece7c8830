//! The Gaussians of a scene on the CPU.

/// Highest degree of spherical harmonics that a scene may have.
pub const MAX_SH_DEGREE: u32 = 3;

/// Coefficients of spherical harmonics up to `degree`, for one colour channel.
pub const fn sh_coefficients(degree: u32) -> usize {
    ((degree + 1) * (degree + 1)) as usize
}

/// Numbers that files keep apart from the first coefficient: those of the others, for all three channels.
pub(super) const fn rest_values(degree: u32) -> usize {
    3 * (sh_coefficients(degree) - 1)
}

/// A scene on the CPU as a structure of arrays: canonical, finite, ready for every renderer.
///
/// World axes are COLMAP's (right, down, forward). A [`Builder`] is the only way to make one, [`Gaussians::transformed`] and
/// [`Gaussians::joined`] make others of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gaussians {
    pub(super) means: Vec<[f32; 3]>,
    pub(super) scales: Vec<[f32; 3]>,
    pub(super) rotations: Vec<[f32; 4]>,
    pub(super) opacities: Vec<f32>,
    pub(super) sh: Vec<[f32; 3]>,
    pub(super) sh_degree: u32,
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
