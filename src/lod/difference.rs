//! Differences between pictures of nodes.

use glam::DVec3;

use super::node::Nodes;
use super::raster::{Direction, Drawing, Picture, Pixel, Splats, Window};

/// The squared difference of two pictures.
pub struct Difference {
    /// Of each pixel.
    pub squared: Vec<f32>,
    /// Sums over the picture, with pixels of 1 x 1, 2 x 2 and 4 x 4 px.
    pub sums: [f64; 3],
}

impl Difference {
    /// Of pictures of two lists of nodes. The memory of the drawings is used again.
    pub fn drawn(nodes: [&Nodes; 2], window: Window, drawings: &mut [Drawing; 2]) -> Self {
        let both = nodes.into_iter().zip(&mut *drawings);
        both.for_each(|(nodes, drawing)| Splats::of(nodes, window).draw(nodes, drawing));
        Self::of(window.width, &drawings[0].picture, &drawings[1].picture)
    }

    pub fn of(width: usize, expected: &Picture, drawn: &Picture) -> Self {
        // Differences of colours and of transmittance.
        let differences: Vec<Pixel> =
            expected.pixels().zip(drawn.pixels()).map(|(a, b)| std::array::from_fn(|k| a[k] - b[k])).collect();
        let mean_square = |[r, g, b, passing]: Pixel| -> f32 {
            // The mean of |dP|^2 on black and |dP + dT|^2 on white.
            let squares = |background: f32| [r, g, b].map(|v| (v + background * passing).powi(2)).iter().sum::<f32>();
            (squares(0.0) + squares(1.0)) / 2.0
        };
        let coarse = |factor: usize| -> f64 {
            let mut sum = 0.0;
            let rows: Vec<&[Pixel]> = differences.chunks_exact(width).collect();
            for rows in rows.chunks(factor) {
                for x in (0..width).step_by(factor) {
                    let mut total = Pixel::default();
                    for pixel in rows.iter().flat_map(|row| &row[x..width.min(x + factor)]) {
                        total.iter_mut().zip(pixel).for_each(|(total, value)| *total += value);
                    }
                    let pixels = factor * factor;
                    sum += f64::from(mean_square(total.map(|total| total / pixels as f32))) * pixels as f64;
                }
            }
            sum
        };
        let squared: Vec<f32> = differences.iter().map(|pixel| mean_square(*pixel)).collect();
        let sums = [squared.iter().map(|v| f64::from(*v)).sum(), coarse(2), coarse(4)];
        Self { squared, sums }
    }
}

/// The squared difference of colours between pictures of two lists of nodes, in a direction and in pixels of width
/// `px`, world units. It is summed over channels and over the area, and averaged over black and white backgrounds,
/// world units squared: the measure of the error of a node.
pub fn squared_difference(of: &Nodes, others: &Nodes, forward: DVec3, px: f64) -> f64 {
    let window = Window::within(of, Direction::to(forward), px, 4.0 * others.width().max(px));
    Difference::drawn([of, others], window, &mut Default::default()).sums[0] * px * px
}

/// The mean of [`squared_difference`] over four directions in which nothing is fitted or measured.
#[cfg(test)]
pub fn from_other_directions(of: &Nodes, others: &Nodes, px: f64) -> f64 {
    let corners = [[1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [1.0, -1.0, 1.0], [-1.0, 1.0, 1.0]].map(DVec3::from);
    corners.map(|to| squared_difference(of, others, to, px)).iter().sum::<f64>() / 4.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lod::{Node, ShapeFit, simplify};
    use crate::procedural::cactus;
    use crate::scene::along_curve;

    #[test]
    fn a_change_is_that_of_the_pictures() {
        let mut nodes = Nodes::new(0);
        nodes.push(Node::leaf([0.0; 3], [1.0, 0.0, 0.0, 0.0], [1.0; 3], 0.5), &[[0.0; 3]]);
        assert_eq!(squared_difference(&nodes, &nodes, DVec3::Z, 0.1), 0.0);
        // A grey disc of alpha 0.5 exp(-r^2 / 2) is gone: on black and on white, each channel loses half of that alpha,
        // whose square sums to pi / 4 over the plane.
        let mut gone = nodes.clone();
        gone.nodes[0].opacity = 0.0;
        let change = squared_difference(&nodes, &gone, DVec3::Z, 0.02);
        let expected = 3.0 * 0.25 * std::f64::consts::PI / 4.0;
        assert!((change / expected - 1.0).abs() < 0.02, "{change}, not {expected}");
    }

    /// The mean error in other directions is about the measured one.
    #[test]
    fn errors_hold_in_other_directions() {
        let scene = cactus::cactus(60_000).unwrap().gaussians;
        let children = Nodes::of(&scene, along_curve(scene.means())[..4096].iter().map(|index| *index as usize));
        let found = simplify(&children, 2048, 0.0, ShapeFit::default());
        let predicted: f64 = found.nodes.nodes.iter().map(|node| f64::from(node.squared_error)).sum();
        let measured = from_other_directions(&children, &found.nodes, f64::from(found.reference_width));
        assert!((0.5..2.0).contains(&(measured / predicted)), "{measured}, predicted {predicted}");
    }
}
