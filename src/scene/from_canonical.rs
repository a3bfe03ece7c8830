//! Builds Gaussians from values that are canonical already, as page files hold them.

use anyhow::{Result, ensure};
use rayon::prelude::*;

use super::Gaussians;
use super::canonical::is_canonical;
use crate::host_memory::OutOfMemory;

/// Buffers for Gaussians that are filled in any order.
pub struct CanonicalBuilder {
    pub means: Vec<[f32; 3]>,
    pub scales: Vec<[f32; 3]>,
    pub rotations: Vec<[f32; 4]>,
    pub opacities: Vec<f32>,
    /// [`sh_coefficients`](super::sh_coefficients) of each Gaussian, one after another.
    pub sh: Vec<[f32; 3]>,
    sh_degree: u32,
}

impl CanonicalBuilder {
    /// Buffers for `count` Gaussians of this SH degree, filled with zeros.
    ///
    /// # Errors
    /// [`OutOfMemory`] if it cannot be allocated.
    pub fn new(sh_degree: u32, count: usize) -> Result<Self, OutOfMemory> {
        let Gaussians { means, scales, rotations, opacities, sh, sh_degree } = Gaussians::zeros(sh_degree, count)?;
        Ok(Self { means, scales, rotations, opacities, sh, sh_degree })
    }

    /// The Gaussians.
    ///
    /// # Errors
    /// If some values are not canonical: not finite, a rotation that is no unit quaternion, an opacity that is not
    /// above 0 and at most 1, a scale below 0.
    pub fn finish(self) -> Result<Gaussians> {
        let Self { means, scales, rotations, opacities, sh, sh_degree } = self;
        let gaussians = Gaussians { means, scales, rotations, opacities, sh, sh_degree };
        let wrong = (0..gaussians.len()).into_par_iter().with_min_len(4096).find_any(|i| !is_canonical(&gaussians, *i));
        ensure!(wrong.is_none(), "a Gaussian has values that no reader makes");
        Ok(gaussians)
    }
}
