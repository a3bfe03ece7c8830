//! Where the Gaussians of a file lie in the world. It is applied in f64, before positions are rounded.

use glam::{DAffine3, DMat3, DQuat, DVec3};

use super::edit::{axis_signs, rotation_signs};
use super::harmonics::{Turn, flip_sign};
use super::stored::{Activated, unit};
use super::{MAX_SH_DEGREE, Transform, sh_coefficients};

/// The map from the axes of a file to the world: axes are reversed, then an affine map is applied. It may mirror, shear
/// and scale axes differently.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Placement {
    flip: [bool; 3],
    affine: DAffine3,
}

impl Placement {
    pub const IDENTITY: Self = Self { flip: [false; 3], affine: DAffine3::IDENTITY };

    /// First these axes are reversed, then follows `transform`.
    pub fn new(flip: [bool; 3], transform: &Transform) -> Self {
        let turn = DMat3::from_quat(transform.rotation()).to_cols_array();
        // Quarter turns only exchange and reverse axes.
        let turn = turn.map(|v| if (v - v.round()).abs() < 2.0 * f64::EPSILON { v.round() } else { v });
        let matrix3 = DMat3::from_cols_array(&turn) * transform.scale();
        Self { flip, affine: DAffine3 { matrix3, translation: transform.translation() } }
    }

    /// First `node`, then these axes are reversed, then follows this placement.
    pub fn after(&self, node: &DAffine3, axes: [bool; 3]) -> Self {
        let flip = std::array::from_fn(|i| self.flip[i] != axes[i]);
        // The axes are reversed first: F A = (F A F) F.
        let signs = DMat3::from_diagonal(DVec3::from(axis_signs(flip).map(f64::from)));
        let matrix3 = signs * node.matrix3 * signs;
        Self { flip, affine: self.affine * DAffine3 { matrix3, translation: signs * node.translation } }
    }
}

/// Applies a placement to Gaussians.
#[derive(Debug)]
pub(crate) struct Placer {
    /// Axes that are reversed first, with the signs of the coefficients.
    flip: Option<([bool; 3], Vec<f32>)>,
    map: Option<Map>,
}

/// An affine map, with its effect on shapes and colours.
#[derive(Debug)]
struct Map {
    affine: DAffine3,
    shape: Shape,
    /// The turn of the spherical harmonics. `None` if they stay.
    turn: Option<Turn>,
}

/// The effect of an affine map on shapes.
#[derive(Debug)]
enum Shape {
    /// A rotation, and a scale. The mirror image of a Gaussian in its centre is the same Gaussian.
    Similar(DQuat, f64),
    /// The axes are scaled differently: the covariance S becomes A S A^T.
    Stretched,
}

/// Largest deviation of a scale from the others of a similarity, relative to them: the rounding of 32-bit floats.
const SCALE_TOLERANCE: f64 = 1e-5;

impl Placer {
    pub fn new(placement: &Placement) -> Self {
        let Placement { flip, affine } = *placement;
        let signs = || (0..sh_coefficients(MAX_SH_DEGREE)).map(|index| flip_sign(index, flip)).collect();
        let is_flipped = flip != [false; 3];
        let map = (affine != DAffine3::IDENTITY).then(|| Map::new(affine));
        Self { flip: is_flipped.then(|| (flip, signs())), map }
    }

    /// True if the axes are scaled differently. Colours then only follow the rotation: spherical harmonics of a limited
    /// degree cannot be stretched.
    pub fn stretches(&self) -> bool {
        self.map.as_ref().is_some_and(|map| matches!(map.shape, Shape::Stretched))
    }

    /// The Gaussian in the world. Values that are not finite stay so.
    pub fn placed(&self, mut stored: Activated, sh: &mut [[f32; 3]]) -> Activated {
        if let Some((axes, signs)) = &self.flip {
            stored.mean.iter_mut().zip(axis_signs(*axes)).for_each(|(v, sign)| *v *= f64::from(sign));
            stored.rotation.iter_mut().zip(rotation_signs(*axes)).for_each(|(v, sign)| *v *= f64::from(sign));
            sh.iter_mut().zip(signs).for_each(|(c, sign)| *c = c.map(|v| v * sign));
        }
        if let Some(map) = &self.map {
            map.apply(&mut stored);
            if let Some(turn) = &map.turn {
                turn.apply(sh);
            }
        }
        stored
    }
}

impl Map {
    fn new(affine: DAffine3) -> Self {
        let (left, lengths, right) = decomposed(affine.matrix3);
        let turn = left * right.transpose();
        let is_similar = lengths.max_element() <= lengths.min_element() * (1.0 + SCALE_TOLERANCE);
        let scale = lengths.to_array().map(f64::cbrt).iter().product();
        let shape = if is_similar { Shape::Similar(rotation(turn), scale) } else { Shape::Stretched };
        Self { affine, shape, turn: (turn != DMat3::IDENTITY).then(|| Turn::new(turn)) }
    }

    fn apply(&self, stored: &mut Activated) {
        stored.mean = self.affine.transform_point3(stored.mean.into()).to_array();
        match self.shape {
            Shape::Similar(turn, scale) => {
                let [w, x, y, z] = stored.rotation;
                let q = turn * DQuat::from_xyzw(x, y, z, w);
                stored.rotation = [q.w, q.x, q.y, q.z];
                stored.scale = stored.scale.map(|s| s * scale);
            }
            Shape::Stretched => {
                // Wrong values stay, and are counted.
                let is_usable = stored.scale.iter().all(|s| (0.0..f64::INFINITY).contains(s));
                let Some([w, x, y, z]) = unit(stored.rotation).filter(|_| is_usable) else { return };
                let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w)) * DMat3::from_diagonal(stored.scale.into());
                let (left, lengths, _) = decomposed(self.affine.matrix3 * axes);
                let q = rotation(left);
                stored.rotation = [q.w, q.x, q.y, q.z];
                stored.scale = lengths.to_array();
            }
        }
    }
}

/// The rotation by an orthogonal matrix, or by its negative if it mirrors.
fn rotation(turn: DMat3) -> DQuat {
    DQuat::from_mat3(&if turn.determinant() < 0.0 { -turn } else { turn }).normalize()
}

/// Sweeps after which the decomposition ends. Three columns need about five.
const SWEEPS: usize = 30;

/// The singular value decomposition: `matrix = left * diagonal(lengths) * right^T` with orthogonal matrices, by
/// one-sided rotations (Hestenes 1958), which keep the relative precision of small values (Demmel and Veselic 1992).
/// `right` does not mirror.
fn decomposed(matrix: DMat3) -> (DMat3, DVec3, DMat3) {
    // Squares must not over- or underflow.
    let largest = matrix.to_cols_array().into_iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    if largest == 0.0 {
        return (DMat3::IDENTITY, DVec3::ZERO, DMat3::IDENTITY);
    }
    let mut left = [0, 1, 2].map(|i| matrix.col(i) / largest);
    let mut right = [DVec3::X, DVec3::Y, DVec3::Z];
    for _ in 0..SWEEPS {
        let mut is_orthogonal = true;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let (a, b, product) = (left[p].length(), left[q].length(), left[p].dot(left[q]));
            if product.abs() <= 4.0 * f64::EPSILON * a * b || product.is_nan() {
                continue;
            }
            is_orthogonal = false;
            // The smaller of the two angles that make the columns orthogonal.
            let cotangent = (b - a) * (b + a) / (2.0 * product);
            let tangent = cotangent.signum() / (cotangent.abs() + cotangent.hypot(1.0));
            let cos = tangent.hypot(1.0).recip();
            for columns in [&mut left, &mut right] {
                let (x, y) = (columns[p], columns[q]);
                (columns[p], columns[q]) = (cos * x - cos * tangent * y, cos * tangent * x + cos * y);
            }
        }
        if is_orthogonal {
            break;
        }
    }
    let lengths = DVec3::from(left.map(DVec3::length));
    (matrix_of(orthonormal(left)), lengths * largest, matrix_of(right))
}

fn matrix_of([x, y, z]: [DVec3; 3]) -> DMat3 {
    DMat3::from_cols(x, y, z)
}

/// The columns with length 1. Zeros become the directions that are missing, without a mirror.
fn orthonormal(columns: [DVec3; 3]) -> [DVec3; 3] {
    let mut units = columns.map(DVec3::normalize_or_zero);
    let first = (0..3).find(|i| units[*i] != DVec3::ZERO).unwrap_or(0);
    for i in [1, 2].map(|step| (first + step) % 3) {
        if units[i] == DVec3::ZERO {
            let [after, last] = [1, 2].map(|step| units[(i + step) % 3]);
            units[i] = match after.cross(last) {
                DVec3::ZERO => (after + last).any_orthonormal_vector(),
                missing => missing,
            };
        }
    }
    units
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Flat and needle-shaped matrices: the product gives every entry back, and the matrices are orthogonal.
    #[test]
    fn a_decomposition_is_orthogonal_and_gives_the_matrix_back() {
        let mut random = crate::scene::Random::of(5);
        for i in 0..2000 {
            let mut column = |size: f64| DVec3::from([(); 3].map(|()| random.normal())) * size;
            let size = [1.0, 1e-6, 0.0][i % 3];
            let first = column(1.0);
            let third = [column(1e9), first * 2.0, column(1e-12), DVec3::ZERO][i % 4];
            let matrix = DMat3::from_cols(first, column(size), third);
            let (left, lengths, right) = decomposed(matrix);
            let parts = (left * DMat3::from_diagonal(lengths) * right.transpose() - matrix).to_cols_array();
            assert!(parts.iter().all(|v| v.abs() < 1e-14 * lengths.max_element()), "{matrix}");
            for orthogonal in [left, right] {
                let error = (orthogonal * orthogonal.transpose() - DMat3::IDENTITY).to_cols_array();
                assert!(error.iter().all(|v| v.abs() < 1e-13), "{matrix}: {orthogonal}");
            }
            assert!(right.determinant() > 0.0);
            assert!(lengths.min_element() >= 0.0);
        }
    }

    /// A node below reversed axes is the reversed node.
    #[test]
    fn placements_follow_nodes() {
        let turn = DQuat::from_xyzw(0.2, 0.5, -0.1, 0.8).normalize();
        let transform = Transform::new(turn, DVec3::new(1.0, -2.0, 3.0), 0.5).unwrap();
        let shear = DMat3::from_cols(DVec3::X, DVec3::new(0.3, -1.0, 0.0), DVec3::new(0.0, 0.7, 2.0));
        let node = DAffine3 { matrix3: shear, translation: DVec3::new(4.0, 5.0, -6.0) };
        let (flip, axes) = ([true, true, false], [false, true, true]);
        let placer = Placer::new(&Placement::new(flip, &transform).after(&node, axes));
        let mean = [0.3, -0.7, 1.1];
        let stored = Activated { mean, scale: [1.0; 3], rotation: [1.0, 0.0, 0.0, 0.0], opacity: 0.5 };
        let reversed = |point: DVec3, axes: [bool; 3]| point * DVec3::from(axis_signs(axes).map(f64::from));
        let expected = transform.point(reversed(reversed(node.transform_point3(mean.into()), axes), flip));
        let found = DVec3::from(placer.placed(stored, &mut [[0.0; 3]]).mean);
        assert!(found.distance(expected) < 1e-13, "{found}, not {expected}");
    }
}
