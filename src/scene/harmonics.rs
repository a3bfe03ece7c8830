//! Real spherical harmonics with the basis and signs of the original 3DGS (Kerbl et al. 2023; Sloan 2013 for the
//! polynomials), and the rotation of their coefficients.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

/// The basis function of degree 0, a constant.
pub const C0: f64 = 0.28209479177387814;
const C1: f64 = 0.4886025119029199;
const C2: [f64; 5] =
    [1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396];
const C3: [f64; 7] = [
    -0.5900435899266435,
    2.890611442640554,
    -0.4570457994644658,
    0.3731763325901154,
    -0.4570457994644658,
    1.445305721320277,
    -0.5900435899266435,
];

/// All 16 basis functions up to degree 3 in the unit direction x y z.
pub fn basis([x, y, z]: [f64; 3]) -> [f64; 16] {
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        C0,
        -C1 * y,
        C1 * z,
        -C1 * x,
        C2[0] * x * y,
        C2[1] * y * z,
        C2[2] * (2.0 * zz - xx - yy),
        C2[3] * x * z,
        C2[4] * (xx - yy),
        C3[0] * y * (3.0 * xx - yy),
        C3[1] * x * y * z,
        C3[2] * y * (4.0 * zz - xx - yy),
        C3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        C3[4] * x * (4.0 * zz - xx - yy),
        C3[5] * z * (xx - yy),
        C3[6] * x * (xx - 3.0 * yy),
    ]
}

/// Axes in which each basis function is odd.
const ODD_AXES: [&[usize]; 16] =
    [&[], &[1], &[2], &[0], &[0, 1], &[1, 2], &[], &[0, 2], &[], &[1], &[0, 1, 2], &[1], &[2], &[0], &[2], &[0]];

/// Sign of the coefficient of basis function `index` when these axes are reversed.
pub fn flip_sign(index: usize, axes: [bool; 3]) -> f32 {
    let flips = ODD_AXES[index].iter().filter(|axis| axes[**axis]).count();
    if flips % 2 == 1 { -1.0 } else { 1.0 }
}

/// The matrix that rotates coefficients with a scene. Degrees do not mix: it has blocks of size 1, 3, 5 and 7.
pub struct Turn([[f64; 16]; 16]);

impl Turn {
    /// The rotated basis projected on the basis: row j, column i is the integral of Y_j(d) Y_i(R^-1 d) over the sphere.
    /// The product is a polynomial of degree 6 or less, for which 4 Gauss-Legendre nodes in z times 8 equal steps of
    /// azimuth are exact (Abramowitz and Stegun 1964, 25.4.30). `rotation` must have unit length.
    pub fn new(rotation: DQuat) -> Self {
        let (inner, outer) = ((18.0 + 30_f64.sqrt()) / 36.0, (18.0 - 30_f64.sqrt()) / 36.0);
        let node = |sign: f64| (3.0 / 7.0 + sign * 2.0 / 7.0 * 1.2_f64.sqrt()).sqrt();
        let nodes = [(node(-1.0), inner), (-node(-1.0), inner), (node(1.0), outer), (-node(1.0), outer)];
        let back = rotation.conjugate();
        let mut matrix = [[0.0; 16]; 16];
        for (z, weight) in nodes {
            for step in 0..8 {
                let (sin, cos) = (TAU * f64::from(step) / 8.0).sin_cos();
                let r = (1.0 - z * z).sqrt();
                let direction = DVec3::new(r * cos, r * sin, z);
                let (values, turned) = (basis(direction.to_array()), basis((back * direction).to_array()));
                for (row, a) in matrix.iter_mut().zip(values) {
                    row.iter_mut().zip(turned).for_each(|(sum, b)| *sum += weight * TAU / 8.0 * a * b);
                }
            }
        }
        Self(matrix)
    }

    /// Rotates the coefficients of one Gaussian, of any degree, in f64.
    pub fn apply(&self, sh: &mut [[f32; 3]]) {
        let mut degree = 1;
        while degree * degree < sh.len() {
            let band = degree * degree..(degree + 1) * (degree + 1);
            let mut before = [[0.0; 3]; 7];
            before.iter_mut().zip(&sh[band.clone()]).for_each(|(wide, k)| *wide = k.map(f64::from));
            for j in band.clone() {
                let turned = self.0[j][band.clone()].iter().zip(before);
                let sum = turned.fold(DVec3::ZERO, |sum, (m, k)| sum + *m * DVec3::from(k));
                sh[j] = sum.to_array().map(|v| v as f32);
            }
            degree += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_mixes_no_degrees_and_keeps_lengths() {
        let Turn(matrix) = Turn::new(DQuat::from_xyzw(0.1, -0.7, 0.3, 0.4).normalize());
        for (j, row) in matrix.iter().enumerate() {
            for (i, value) in row.iter().enumerate() {
                assert!(j.isqrt() == i.isqrt() || value.abs() < 1e-14, "{j} {i}: {value}");
            }
            for (k, other) in matrix.iter().enumerate() {
                let product: f64 = row.iter().zip(other).map(|(a, b)| a * b).sum();
                assert!((product - f64::from(j == k)).abs() < 1e-13, "rows {j} and {k}");
            }
        }
    }

    #[test]
    fn the_turned_basis_is_the_basis_seen_from_the_direction_turned_back() {
        let rotation = DQuat::from_xyzw(-0.5, 0.2, 0.8, 0.1).normalize();
        let Turn(matrix) = Turn::new(rotation);
        for direction in [DVec3::X, DVec3::NEG_Y, DVec3::new(1.0, -2.0, 0.5).normalize()] {
            let (now, before) = (basis(direction.to_array()), basis((rotation.conjugate() * direction).to_array()));
            for (i, expected) in before.iter().enumerate() {
                let sum: f64 = (0..16).map(|j| matrix[j][i] * now[j]).sum();
                assert!((sum - expected).abs() < 1e-13, "{i}");
            }
        }
    }

    /// The integral of the product of two basis functions over the sphere is 1 if they are the same, else 0.
    #[test]
    fn harmonics_are_orthonormal() {
        let (rings, steps) = (200, 400);
        let mut products = [[0.0; 16]; 16];
        for ring in 0..rings {
            let z = (ring as f64 + 0.5) / rings as f64 * 2.0 - 1.0;
            for step in 0..steps {
                let angle = std::f64::consts::TAU * step as f64 / steps as f64;
                let r = (1.0 - z * z).sqrt();
                let values = basis([r * angle.cos(), r * angle.sin(), z]);
                let area = 4.0 * std::f64::consts::PI / (rings * steps) as f64;
                for (row, a) in products.iter_mut().zip(values) {
                    row.iter_mut().zip(values).for_each(|(sum, b)| *sum += area * a * b);
                }
            }
        }
        for (i, row) in products.iter().enumerate() {
            for (j, product) in row.iter().enumerate() {
                let expected = f64::from(i == j);
                assert!((product - expected).abs() < 1e-3, "{i} {j}: {product}");
            }
        }
    }
}
