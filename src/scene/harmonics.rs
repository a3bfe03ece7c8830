//! Real spherical harmonics with the basis and signs of the original 3DGS (Kerbl et al. 2023; Sloan 2013 for the
//! polynomials), and the rotation of their coefficients.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec3};

use super::{MAX_SH_DEGREE, sh_coefficients};

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
const C4: [f64; 9] = [
    2.5033429417967046,
    -1.7701307697799304,
    0.9461746957575601,
    -0.6690465435572892,
    0.10578554691520431,
    -0.6690465435572892,
    0.47308734787878004,
    -1.7701307697799304,
    0.6258357354491761,
];

/// Number of the basis functions.
pub const FUNCTIONS: usize = sh_coefficients(MAX_SH_DEGREE);

/// All basis functions, up to degree 4, in the unit direction x y z.
pub fn basis([x, y, z]: [f64; 3]) -> [f64; FUNCTIONS] {
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
        C4[0] * x * y * (xx - yy),
        C4[1] * y * z * (3.0 * xx - yy),
        C4[2] * x * y * (6.0 * zz - xx - yy),
        C4[3] * y * z * (4.0 * zz - 3.0 * xx - 3.0 * yy),
        C4[4] * (8.0 * zz * (zz - 3.0 * xx - 3.0 * yy) + 3.0 * (xx + yy) * (xx + yy)),
        C4[5] * x * z * (4.0 * zz - 3.0 * xx - 3.0 * yy),
        C4[6] * (xx - yy) * (6.0 * zz - xx - yy),
        C4[7] * x * z * (xx - 3.0 * yy),
        C4[8] * (xx * (xx - 3.0 * yy) - yy * (3.0 * xx - yy)),
    ]
}

/// Axes in which each basis function is odd.
#[rustfmt::skip]
const ODD_AXES: [&[usize]; FUNCTIONS] = [
    &[],
    &[1], &[2], &[0],
    &[0, 1], &[1, 2], &[], &[0, 2], &[],
    &[1], &[0, 1, 2], &[1], &[2], &[0], &[2], &[0],
    &[0, 1], &[1, 2], &[0, 1], &[1, 2], &[], &[0, 2], &[], &[0, 2], &[],
];

/// Sign of the coefficient of basis function `index` when these axes are reversed.
pub fn flip_sign(index: usize, axes: [bool; 3]) -> f32 {
    let flips = ODD_AXES[index].iter().filter(|axis| axes[**axis]).count();
    if flips % 2 == 1 { -1.0 } else { 1.0 }
}

/// The matrix that turns coefficients with a scene, by a rotation or a rotation that mirrors. Degrees do not mix: it
/// has blocks of size 1, 3, 5 and so on.
#[derive(Clone, Debug)]
pub struct Turn([[f64; FUNCTIONS]; FUNCTIONS]);

/// Deviation of an entry from 0 or 1 by rounding. Axes that are exchanged or reversed keep every coefficient.
const ENTRY_TOLERANCE: f64 = 1e-14;

impl Turn {
    /// The turned basis projected on the basis: row j, column i is the integral of Y_j(d) Y_i(R^-1 d) over the sphere.
    /// The product is a polynomial of degree 2 L or less, for which 2 L + 1 nodes of Fejer's first rule in z (weights:
    /// Waldvogel 2006) times as many equal steps of azimuth are exact. `turn` must be orthogonal.
    pub fn new(turn: DMat3) -> Self {
        let nodes = 2 * MAX_SH_DEGREE + 1;
        let (n, back) = (f64::from(nodes), turn.transpose());
        let mut matrix = [[0.0; FUNCTIONS]; FUNCTIONS];
        for node in 0..nodes {
            let angle = (f64::from(node) + 0.5) * PI / n;
            let terms = (1..=nodes / 2).map(f64::from).map(|j| (2.0 * j * angle).cos() / (4.0 * j * j - 1.0));
            let weight = 2.0 / n * (1.0 - 2.0 * terms.sum::<f64>()) * TAU / n;
            for step in 0..nodes {
                let (sin, cos) = (TAU * f64::from(step) / n).sin_cos();
                let direction = DVec3::new(angle.sin() * cos, angle.sin() * sin, angle.cos());
                let (values, turned) = (basis(direction.to_array()), basis((back * direction).to_array()));
                for (row, a) in matrix.iter_mut().zip(values) {
                    row.iter_mut().zip(turned).for_each(|(sum, b)| *sum += weight * a * b);
                }
            }
        }
        Self(matrix.map(|row| row.map(|v| if (v - v.round()).abs() < ENTRY_TOLERANCE { v.round() } else { v })))
    }

    /// Turns the coefficients of one Gaussian, of any degree, in f64.
    pub fn apply(&self, sh: &mut [[f32; 3]]) {
        let mut degree = 1;
        while degree * degree < sh.len() {
            let band = degree * degree..(degree + 1) * (degree + 1);
            let mut before = [[0.0; 3]; 2 * MAX_SH_DEGREE as usize + 1];
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
    use glam::DQuat;

    #[test]
    fn a_turn_mixes_no_degrees_and_keeps_lengths() {
        let Turn(matrix) = Turn::new(DMat3::from_quat(DQuat::from_xyzw(0.1, -0.7, 0.3, 0.4).normalize()));
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

    /// Of a rotation, and of one that mirrors.
    #[test]
    fn the_turned_basis_is_the_basis_seen_from_the_direction_turned_back() {
        let rotation = DMat3::from_quat(DQuat::from_xyzw(-0.5, 0.2, 0.8, 0.1).normalize());
        for turn in [rotation, -rotation, rotation * DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0))] {
            let Turn(matrix) = Turn::new(turn);
            for direction in [DVec3::X, DVec3::NEG_Y, DVec3::new(1.0, -2.0, 0.5).normalize()] {
                let (now, before) = (basis(direction.to_array()), basis((turn.transpose() * direction).to_array()));
                for (i, expected) in before.iter().enumerate() {
                    let sum: f64 = now.iter().zip(&matrix).map(|(now, row)| row[i] * now).sum();
                    assert!((sum - expected).abs() < 1e-13, "{i}");
                }
            }
        }
    }

    #[test]
    fn reversed_axes_change_only_signs() {
        for axes in [[true, false, false], [false, true, true], [true; 3]] {
            let signs = axes.map(|flip| if flip { -1.0 } else { 1.0 });
            let Turn(matrix) = Turn::new(DMat3::from_diagonal(signs.into()));
            for (j, row) in matrix.iter().enumerate() {
                for (i, value) in row.iter().enumerate() {
                    assert_eq!(*value, if i == j { f64::from(flip_sign(i, axes)) } else { 0.0 }, "{j} {i}");
                }
            }
        }
    }

    /// The closed formula of every basis function (Sloan 2013, appendix A1): the associated Legendre polynomial times a
    /// sine or cosine of the azimuth, with the sign (-1)^m.
    #[test]
    fn harmonics_are_legendre_functions_times_waves() {
        for direction in [[0.3, -0.5, 0.7], [-0.8, 0.1, -0.2], [0.1, 0.9, 0.4]].map(DVec3::from) {
            let direction = direction.normalize();
            let azimuth = direction.y.atan2(direction.x);
            for (i, value) in basis(direction.to_array()).iter().enumerate() {
                let l = i.isqrt() as i32;
                let m = i as i32 - l * (l + 1);
                let factorial = |n: i32| (1..=n).map(f64::from).product::<f64>();
                let order = m.abs();
                let ratio = factorial(l - order) / factorial(l + order);
                let scale =
                    (f64::from(2 * l + 1) / (2.0 * TAU) * ratio).sqrt() * if m == 0 { 1.0 } else { 2_f64.sqrt() };
                let wave = if m < 0 { (f64::from(order) * azimuth).sin() } else { (f64::from(m) * azimuth).cos() };
                let expected = scale * legendre(l, order, direction.z) * wave;
                assert!((value - expected).abs() < 1e-14, "{i}: {value}, not {expected}");
            }
        }
    }

    /// The associated Legendre polynomial with the sign (-1)^m, by its recurrence in the degree.
    fn legendre(l: i32, m: i32, z: f64) -> f64 {
        let mut last = 0.0;
        let mut value = (0..m).fold(1.0, |product, k| -product * f64::from(2 * k + 1) * (1.0 - z * z).sqrt());
        for degree in m + 1..=l {
            let next = f64::from(2 * degree - 1) * z * value - f64::from(degree + m - 1) * last;
            (last, value) = (value, next / f64::from(degree - m));
        }
        value
    }

    #[test]
    fn a_reversed_axis_changes_the_signs_of_odd_functions() {
        let direction = [0.3, -0.5, 0.7];
        let values = basis(direction);
        for reversed in [[true, false, false], [false, true, false], [false, false, true], [false, true, true]] {
            let mirrored = basis(std::array::from_fn(|i| if reversed[i] { -direction[i] } else { direction[i] }));
            for (i, (value, before)) in mirrored.iter().zip(values).enumerate() {
                assert_eq!(*value, before * f64::from(flip_sign(i, reversed)), "{i}");
            }
        }
    }

    /// The integral of the product of two basis functions over the sphere is 1 if they are the same, else 0.
    #[test]
    fn harmonics_are_orthonormal() {
        let (rings, steps) = (200, 400);
        let mut products = [[0.0; FUNCTIONS]; FUNCTIONS];
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
