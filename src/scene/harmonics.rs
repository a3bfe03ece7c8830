//! The spherical harmonics that scenes store their colour in: the real basis of the original 3DGS, signs included
//! (Kerbl et al. 2023; Sloan 2013 for the polynomials).

/// Y_0^0.
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

#[cfg(test)]
mod tests {
    use super::*;

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
