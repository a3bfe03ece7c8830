//! The similarity that moves points onto others with the least squares of distances.

use glam::{DMat3, DQuat, DVec3};

use crate::scene::Transform;

/// The similarity with the least sum of squared distances between the images of the first points of `pairs` and the
/// second ones (Horn, "Closed-form solution of absolute orientation using unit quaternions", 1987). Without
/// `scales`, its scale is 1. `None` for less than three pairs, and for points on a line.
pub fn aligning(pairs: &[[DVec3; 2]], scales: bool) -> Option<Transform> {
    if pairs.len() < 3 {
        return None;
    }
    let count = pairs.len() as f64;
    let [from, to] = [0, 1].map(|side: usize| pairs.iter().map(|pair| pair[side]).sum::<DVec3>() / count);
    let arms: Vec<[DVec3; 2]> = pairs.iter().map(|[a, b]| [*a - from, *b - to]).collect();
    // Entry [i][j] of the correlation is the sum of coordinate i of the first times coordinate j of the second.
    let mut correlation = DMat3::ZERO;
    for [a, b] in &arms {
        correlation += DMat3::from_cols(*a * b.x, *a * b.y, *a * b.z);
    }
    let rotation = best_rotation(&correlation)?;
    let [squares, moved] =
        arms.iter().fold([0.0; 2], |[s, m], [a, b]| [s + a.length_squared(), m + b.dot(rotation * *a)]);
    let scale = if scales { moved / squares } else { 1.0 };
    Transform::new(rotation, to - scale * (rotation * from), scale).ok()
}

/// The rotation R with the greatest sum of b · R a; `None` if it is not unique.
fn best_rotation(correlation: &DMat3) -> Option<DQuat> {
    let s = |i: usize, j: usize| correlation.col(j)[i];
    // Horn's matrix, whose greatest eigenvector is the quaternion w, x, y, z.
    let matrix = [
        [s(0, 0) + s(1, 1) + s(2, 2), s(1, 2) - s(2, 1), s(2, 0) - s(0, 2), s(0, 1) - s(1, 0)],
        [s(1, 2) - s(2, 1), s(0, 0) - s(1, 1) - s(2, 2), s(0, 1) + s(1, 0), s(2, 0) + s(0, 2)],
        [s(2, 0) - s(0, 2), s(0, 1) + s(1, 0), s(1, 1) - s(0, 0) - s(2, 2), s(1, 2) + s(2, 1)],
        [s(0, 1) - s(1, 0), s(2, 0) + s(0, 2), s(1, 2) + s(2, 1), s(2, 2) - s(0, 0) - s(1, 1)],
    ];
    let (values, vectors) = eigen(matrix);
    let mut order = [0, 1, 2, 3];
    order.sort_by(|a, b| values[*b].total_cmp(&values[*a]));
    let size = values.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
    // For points on a line, any turn around it is as good.
    if values[order[0]] - values[order[1]] <= 1e-9 * size {
        return None;
    }
    let [w, x, y, z] = std::array::from_fn(|row| vectors[row][order[0]]);
    Some(DQuat::from_xyzw(x, y, z, w).normalize())
}

/// Eigenvalues and eigenvectors (columns) of a symmetric matrix, by Jacobi's rotations.
fn eigen(mut a: [[f64; 4]; 4]) -> ([f64; 4], [[f64; 4]; 4]) {
    /// After some six sweeps the other entries are below the rounding of the values.
    const SWEEPS: usize = 20;
    let mut vectors: [[f64; 4]; 4] = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    for (p, q) in (0..SWEEPS).flat_map(|_| (0..4).flat_map(|p| (p + 1..4).map(move |q| (p, q)))) {
        if a[p][q] == 0.0 {
            continue;
        }
        // The rotation of p and q that makes their common entry zero.
        let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
        let tangent = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
        let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
        let sine = tangent * cosine;
        let turn = |x: f64, y: f64| (cosine * x - sine * y, sine * x + cosine * y);
        for row in &mut a {
            (row[p], row[q]) = turn(row[p], row[q]);
        }
        let rows = [a[p], a[q]];
        (a[p], a[q]) = (
            std::array::from_fn(|k| turn(rows[0][k], rows[1][k]).0),
            std::array::from_fn(|k| turn(rows[0][k], rows[1][k]).1),
        );
        for row in &mut vectors {
            (row[p], row[q]) = turn(row[p], row[q]);
        }
    }
    (std::array::from_fn(|i| a[i][i]), vectors)
}

#[cfg(test)]
mod tests {
    use glam::EulerRot;

    use super::*;

    const POINTS: [[f64; 3]; 5] =
        [[0.0, 0.0, 0.0], [1.0, 0.2, -0.3], [-0.4, 1.5, 0.1], [0.3, -0.8, 2.0], [2.0, 1.0, 0.5]];

    fn known() -> Transform {
        let rotation = DQuat::from_euler(EulerRot::YXZ, 2.1, -0.7, 0.4);
        Transform::new(rotation, DVec3::new(3.0, -1.0, 0.5), 2.5).unwrap()
    }

    #[test]
    fn pairs_of_a_similarity_give_it_back() {
        let known = known();
        // Three points are in a plane, and a half turn has a zero real part.
        let turned = Transform::new(DQuat::from_rotation_x(3.0), DVec3::ONE, 0.5).unwrap();
        for (count, known) in [(3, known), (5, known), (4, turned)] {
            let pairs: Vec<_> = POINTS[..count].iter().map(|p| [(*p).into(), known.point((*p).into())]).collect();
            let found = aligning(&pairs, true).unwrap();
            for p in POINTS {
                assert!(found.point(p.into()).distance(known.point(p.into())) < 1e-9, "{count}: {found:?}");
            }
        }
    }

    /// No similarity nearby has a smaller sum of squares.
    #[test]
    fn the_sum_of_squares_is_the_least() {
        let known = known();
        let noise = [[0.1, 0.0, -0.1], [0.0, 0.2, 0.1], [-0.2, 0.0, 0.1], [0.1, -0.1, 0.0], [0.0, 0.1, -0.2]];
        let pairs: Vec<[DVec3; 2]> = (POINTS.iter().zip(noise))
            .map(|(p, n)| [DVec3::from(*p), known.point(DVec3::from(*p)) + DVec3::from(n)])
            .collect();
        let squares = |s: &Transform| pairs.iter().map(|[a, b]| s.point(*a).distance_squared(*b)).sum::<f64>();
        for scales in [true, false] {
            let best = aligning(&pairs, scales).unwrap();
            let least = squares(&best);
            let then = |rotation, translation, scale| {
                squares(&best.then(&Transform::new(rotation, translation, scale).unwrap()).unwrap())
            };
            for step in [1e-3, -1e-3] {
                for axis in DVec3::AXES {
                    assert!(then(DQuat::IDENTITY, axis * step, 1.0) > least, "{axis} {step}");
                    assert!(then(DQuat::from_axis_angle(axis, step), DVec3::ZERO, 1.0) > least, "{axis} {step}");
                }
                assert!(!scales || then(DQuat::IDENTITY, DVec3::ZERO, 1.0 + step) > least, "{step}");
            }
            assert!(scales || best.scale() == 1.0);
        }
    }

    #[test]
    fn too_few_points_and_points_on_a_line_are_refused() {
        let pair = |p: [f64; 3]| [DVec3::from(p), known().point(p.into())];
        assert_eq!(aligning(&[pair(POINTS[0]), pair(POINTS[1])], true), None);
        let line: Vec<_> = (0..4).map(|i| pair([f64::from(i), 2.0 * f64::from(i), 0.0])).collect();
        assert_eq!(aligning(&line, true), None);
    }
}
