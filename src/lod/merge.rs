//! Merges several nodes into their parent.
//!
//! Its mean, covariance and colours are means weighted by opacity times area, with the spread of the means in the
//! covariance; its opacity keeps the sum of opacity times area, and so may exceed 1 (H3DGS, Kerbl et al. 2024).

use glam::{DMat3, DQuat, DVec3};

use super::node::{Node, Nodes, area};

/// The parent of the nodes with these indices, and its spherical harmonics.
pub fn parent(nodes: &Nodes, members: &[u32]) -> (Node, Vec<[f32; 3]>) {
    let all = || members.iter().map(|index| &nodes.nodes[*index as usize]);
    // Keeps the weight of a Gaussian without area above 0.
    let least = 1e-6 * all().map(Node::area).fold(0.0, f64::max) + f64::MIN_POSITIVE;
    let weight = |node: &Node| f64::from(node.opacity) * (node.area() + least);
    let total: f64 = all().map(weight).sum();
    let mean = all().map(|node| node.centre() * weight(node)).sum::<DVec3>() / total;
    let mut covariance = DMat3::ZERO;
    for node in all() {
        let apart = node.centre() - mean;
        let spread = DMat3::from_cols(apart * apart.x, apart * apart.y, apart * apart.z);
        covariance += (node.covariance() + spread) * (weight(node) / total);
    }
    let (scale, rotation) = half_axes(covariance);
    let node = Node {
        mean: mean.as_vec3().to_array(),
        rotation: [rotation.w, rotation.x, rotation.y, rotation.z].map(|v| v as f32),
        scale: scale.map(|v| v as f32),
        opacity: (total / (area(scale) + least)) as f32,
        opacity_sum: all().map(|node| node.opacity_sum).sum(),
        error: all().map(|node| node.error).fold(0.0, f32::max),
        size: all().map(|node| node.size).chain(scale.map(|v| v as f32)).fold(0.0, f32::max),
        squared_error: all().map(|node| node.squared_error).sum(),
    };
    let mut sh = vec![[0.0_f64; 3]; nodes.sh(0).len()];
    for index in members {
        let part = weight(&nodes.nodes[*index as usize]) / total;
        for (sum, value) in sh.iter_mut().zip(nodes.sh(*index as usize)) {
            (0..3).for_each(|channel| sum[channel] += part * f64::from(value[channel]));
        }
    }
    (node, sh.iter().map(|value| value.map(|v| v as f32)).collect())
}

/// Standard deviations and the rotation to the axes of a covariance, by Jacobi's method (Golub and Van Loan, Matrix
/// Computations, 8.5).
fn half_axes(covariance: DMat3) -> ([f64; 3], DQuat) {
    let mut m = covariance.to_cols_array_2d();
    let mut axes = [DVec3::X, DVec3::Y, DVec3::Z];
    for _ in 0..12 {
        for (p, q, r) in [(0, 1, 2), (1, 2, 0), (0, 2, 1)] {
            let (off, apart) = (m[p][q], m[q][q] - m[p][p]);
            if off.abs() <= 1e-18 * (m[p][p].abs() + m[q][q].abs()) {
                continue;
            }
            // The smaller of the two angles that make this entry 0.
            let t = 2.0 * off / (apart.abs() + (apart * apart + 4.0 * off * off).sqrt())
                * if apart < 0.0 { -1.0 } else { 1.0 };
            let c = 1.0 / (1.0 + t * t).sqrt();
            let s = t * c;
            m[p][p] -= t * off;
            m[q][q] += t * off;
            let (u, v) = (c * m[p][r] - s * m[q][r], s * m[p][r] + c * m[q][r]);
            (m[p][q], m[q][p]) = (0.0, 0.0);
            (m[p][r], m[r][p]) = (u, u);
            (m[q][r], m[r][q]) = (v, v);
            (axes[p], axes[q]) = (axes[p] * c - axes[q] * s, axes[p] * s + axes[q] * c);
        }
    }
    let mut axes = DMat3::from_cols(axes[0], axes[1], axes[2]);
    if axes.determinant() < 0.0 {
        axes.z_axis = -axes.z_axis;
    }
    let scale = [0, 1, 2].map(|i| m[i][i].max(0.0).sqrt());
    (scale, DQuat::from_mat3(&axes).normalize())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nodes(all: &[Node]) -> Nodes {
        let mut nodes = Nodes::new(0);
        all.iter().enumerate().for_each(|(i, node)| nodes.push(*node, &[[i as f32, 1.0, -1.0]]));
        nodes
    }

    fn close(a: DMat3, b: DMat3) -> bool {
        let size = b.to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max);
        (a - b).to_cols_array().iter().all(|v| v.abs() <= 1e-5 * size)
    }

    #[test]
    fn a_parent_has_the_moments_of_its_children() {
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let all = [
            Node::leaf([1.0, 2.0, 3.0], [1.0, 0.0, 0.0, 0.0], [0.3, 0.1, 0.2], 0.9),
            Node::leaf([1.5, 2.0, 2.0], [half, half, 0.0, 0.0], [0.1, 0.4, 0.02], 0.5),
            Node::leaf([0.0, 2.5, 3.0], [half, 0.0, half, 0.0], [0.2, 0.2, 0.0], 1.0),
        ];
        let (node, sh) = parent(&nodes(&all), &[0, 1, 2]);
        let weights: Vec<f64> = all.iter().map(|node| f64::from(node.opacity) * node.area()).collect();
        let total: f64 = weights.iter().sum();
        let part = |f: &dyn Fn(&Node) -> DVec3| -> DVec3 {
            all.iter().zip(&weights).map(|(node, weight)| f(node) * *weight / total).sum()
        };
        let mean = part(&|node| node.centre());
        assert!((node.centre() - mean).length() < 1e-5);
        let second = |node: &Node, mean: DVec3| {
            let apart = node.centre() - mean;
            node.covariance() + DMat3::from_cols(apart * apart.x, apart * apart.y, apart * apart.z)
        };
        let expected =
            all.iter().zip(&weights).fold(DMat3::ZERO, |sum, (node, w)| sum + second(node, mean) * (*w / total));
        assert!(close(node.covariance(), expected), "{} {expected}", node.covariance());
        assert!((f64::from(node.opacity) * node.area() / total - 1.0).abs() < 1e-4, "opacity times area is kept");
        assert!((node.opacity_sum - 2.4).abs() < 1e-6);
        assert!((f64::from(sh[0][0]) - (weights[1] + 2.0 * weights[2]) / total).abs() < 1e-5);
        assert_eq!(sh[0][1..], [1.0, -1.0]);
    }

    #[test]
    fn many_in_one_place_have_an_opacity_above_1() {
        let node = Node::leaf([1.0; 3], [1.0, 0.0, 0.0, 0.0], [0.1, 0.2, 0.3], 0.8);
        let (merged, _) = parent(&nodes(&[node; 5]), &[0, 1, 2, 3, 4]);
        assert!((merged.opacity - 4.0).abs() < 1e-4 && close(merged.covariance(), node.covariance()), "{merged:?}");
        let point = Node { scale: [0.0; 3], ..node };
        let (merged, _) = parent(&nodes(&[point; 2]), &[0, 1]);
        assert!(merged.opacity.is_finite() && merged.mean == [1.0; 3], "{merged:?}");
    }

    /// Directions of a sphere and of a disc are not unique, but covariances are.
    #[test]
    fn half_axes_make_the_covariance_again() {
        let turn = DQuat::from_xyzw(0.3, -0.5, 0.2, 0.7).normalize();
        let turned = DMat3::from_quat(turn);
        for scales in [[1.0, 1.0, 1.0], [2.0, 2.0, 0.1], [0.1, 2.0, 2.0], [3.0, 1e-3, 0.0], [0.0, 0.0, 0.0]] {
            let variances = DMat3::from_diagonal(DVec3::from(scales.map(|s: f64| s * s)));
            let covariance = turned * variances * turned.transpose();
            let (found, rotation) = half_axes(covariance);
            let axes = DMat3::from_quat(rotation) * DMat3::from_diagonal(DVec3::from(found));
            assert!(close(axes * axes.transpose(), covariance), "{scales:?} {found:?}");
        }
    }
}
