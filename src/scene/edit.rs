//! Derives scenes from others: a selection, another order, a lower SH degree, other axes.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::harmonics::{C0, flip_sign};
use super::{Gaussians, sh_coefficients};
use crate::host_memory::{OutOfMemory, host_vec};

/// The axes that change sign between right, down, forward and right, up, back.
pub const RIGHT_UP_BACK: [bool; 3] = [false, true, true];

/// Signs of coordinates when these axes are reversed.
pub(crate) fn axis_signs(axes: [bool; 3]) -> [f32; 3] {
    axes.map(|flip| if flip { -1.0 } else { 1.0 })
}

/// Signs of a quaternion w x y z when these axes are reversed: reversing an axis reverses rotations about the other
/// two.
pub(crate) fn rotation_signs(axes: [bool; 3]) -> [f32; 4] {
    let [x, y, z] = axis_signs(axes);
    [1.0, y * z, x * z, x * y]
}

impl Gaussians {
    /// The Gaussians with these indices, in this order.
    ///
    /// # Errors
    /// [`OutOfMemory`] if the copy cannot be allocated.
    ///
    /// # Panics
    /// If an index is not below [`Gaussians::len`].
    pub fn selected(&self, indices: &[u32]) -> Result<Self, OutOfMemory> {
        let stride = sh_coefficients(self.sh_degree);
        let mut selected = Self {
            means: host_vec(indices.len(), "means")?,
            scales: host_vec(indices.len(), "scales")?,
            rotations: host_vec(indices.len(), "rotations")?,
            opacities: host_vec(indices.len(), "opacities")?,
            sh: host_vec(indices.len() * stride, "spherical harmonics")?,
            sh_degree: self.sh_degree,
        };
        let indices = || indices.iter().map(|i| *i as usize);
        selected.means.extend(indices().map(|i| self.means[i]));
        selected.scales.extend(indices().map(|i| self.scales[i]));
        selected.rotations.extend(indices().map(|i| self.rotations[i]));
        selected.opacities.extend(indices().map(|i| self.opacities[i]));
        indices().for_each(|i| selected.sh.extend_from_slice(self.sh(i)));
        Ok(selected)
    }

    /// The scene with a linear map of its colours, in every direction, and a factor on its opacities, which stay at
    /// most 1. Computed in f64 and rounded once.
    pub fn adjusted(mut self, colours: DMat3, opacity: f64) -> Self {
        // A colour is 0.5 and the sum of the harmonics.
        let offset = (colours * DVec3::splat(0.5) - 0.5) / C0;
        self.sh.par_chunks_exact_mut(sh_coefficients(self.sh_degree)).for_each(|sh| {
            for (i, coefficient) in sh.iter_mut().enumerate() {
                let mapped = colours * DVec3::from(coefficient.map(f64::from));
                *coefficient = (if i == 0 { mapped + offset } else { mapped }).to_array().map(|value| value as f32);
            }
        });
        let changed = |own: f32| ((f64::from(own) * opacity) as f32).min(own.max(1.0));
        self.opacities.par_iter_mut().for_each(|own| *own = changed(*own));
        self
    }

    /// Removes the spherical harmonics above this degree.
    pub fn of_degree(mut self, degree: u32) -> Self {
        if degree < self.sh_degree {
            let (from, to) = (sh_coefficients(self.sh_degree), sh_coefficients(degree));
            for i in 0..self.means.len() {
                self.sh.copy_within(i * from..i * from + to, i * to);
            }
            self.sh.truncate(self.means.len() * to);
            self.sh.shrink_to_fit();
            self.sh_degree = degree;
        }
        self
    }

    /// The scene with these axes reversed. An odd number of them mirrors it.
    pub fn flipped(mut self, axes: [bool; 3]) -> Self {
        let sign = axis_signs(axes);
        self.means.par_iter_mut().for_each(|mean| mean.iter_mut().zip(sign).for_each(|(v, sign)| *v *= sign));
        let turned = rotation_signs(axes);
        self.rotations.par_iter_mut().for_each(|q| q.iter_mut().zip(turned).for_each(|(v, sign)| *v *= sign));
        let signs: Vec<f32> = (0..sh_coefficients(self.sh_degree)).map(|index| flip_sign(index, axes)).collect();
        self.sh.par_chunks_exact_mut(signs.len()).for_each(|sh| {
            sh.iter_mut().zip(&signs).for_each(|(c, sign)| *c = c.map(|v| v * sign));
        });
        self
    }
}
