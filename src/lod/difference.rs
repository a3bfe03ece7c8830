//! How far apart pictures of nodes are.

use glam::DVec3;

use super::node::Nodes;
use super::raster::{Direction, Drawing, Pixel, Splats, Window};

/// The squared difference of two pictures in each pixel, and the same where 2 x 2 and 4 x 4 pixels are one, summed.
pub struct Difference {
    pub squared: Vec<f32>,
    pub sums: [f64; 3],
}

impl Difference {
    pub fn of(width: usize, wanted: &[Pixel], drawn: &[Pixel]) -> Self {
        // Of the colours, and of what passes.
        let apart: Vec<Pixel> = wanted.iter().zip(drawn).map(|(a, b)| std::array::from_fn(|k| a[k] - b[k])).collect();
        let energy = |[r, g, b, passing]: Pixel| -> f32 {
            // The mean of |dP|^2 on black and |dP + dT|^2 on white.
            let squares = |ground: f32| [r, g, b].map(|v| (v + ground * passing).powi(2)).iter().sum::<f32>();
            (squares(0.0) + squares(1.0)) / 2.0
        };
        let coarse = |factor: usize| -> f64 {
            let mut sum = 0.0;
            let rows: Vec<&[Pixel]> = apart.chunks_exact(width).collect();
            for rows in rows.chunks(factor) {
                for x in (0..width).step_by(factor) {
                    let mut total = Pixel::default();
                    for pixel in rows.iter().flat_map(|row| &row[x..width.min(x + factor)]) {
                        total.iter_mut().zip(pixel).for_each(|(total, value)| *total += value);
                    }
                    let pixels = factor * factor;
                    sum += f64::from(energy(total.map(|total| total / pixels as f32))) * pixels as f64;
                }
            }
            sum
        };
        let squared: Vec<f32> = apart.iter().map(|pixel| energy(*pixel)).collect();
        let sums = [squared.iter().map(|v| f64::from(*v)).sum(), coarse(2), coarse(4)];
        Self { squared, sums }
    }
}

/// The squared difference of colours between the pictures of nodes and of others in their place, seen in a direction in
/// pixels of this width, world units: summed over channels and over the area, the mean of black and white ground, world
/// units squared. What each node is measured by, in any direction and at any width.
pub fn squared_change(of: &Nodes, others: &Nodes, forward: DVec3, px: f64) -> f64 {
    let window = Window::within(of, Direction::to(forward), px, 4.0 * others.width().max(px));
    let [of, others] = [of, others].map(|nodes| {
        let mut drawing = Drawing::default();
        Splats::of(nodes, window).draw(nodes, &mut drawing);
        drawing.pixels
    });
    Difference::of(window.width, &of, &others).sums[0] * px * px
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lod::{Node, parents};
    use crate::procedural::cactus;
    use crate::scene::along_curve;

    #[test]
    fn a_change_is_that_of_the_pictures() {
        let mut nodes = Nodes::new(0);
        nodes.push(Node::leaf([0.0; 3], [1.0, 0.0, 0.0, 0.0], [1.0; 3], 0.5), &[[0.0; 3]]);
        assert_eq!(squared_change(&nodes, &nodes, DVec3::Z, 0.1), 0.0);
        // A grey disc of alpha 0.5 exp(-r^2 / 2) is gone: on black and on white, each channel loses half of that alpha,
        // whose square sums to pi / 4 over the plane.
        let mut gone = nodes.clone();
        gone.nodes[0].opacity = 0.0;
        let change = squared_change(&nodes, &gone, DVec3::Z, 0.02);
        let expected = 3.0 * 0.25 * std::f64::consts::PI / 4.0;
        assert!((change / expected - 1.0).abs() < 0.02, "{change}, not {expected}");
    }

    /// In other directions than those in which it was measured, the mean of the error is about the measured one.
    #[test]
    fn errors_hold_where_they_were_not_measured() {
        let scene = cactus::cactus(60_000).unwrap().gaussians;
        let children = Nodes::of(&scene).selected(&along_curve(scene.means())[..4096]);
        let found = parents(&children, 2048, 0.0);
        let predicted: f64 = found.nodes.nodes.iter().map(|node| f64::from(node.energy)).sum();
        let corners = [[1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [1.0, -1.0, 1.0], [-1.0, 1.0, 1.0]].map(DVec3::from);
        let px = f64::from(found.detail);
        let measured: f64 =
            corners.iter().map(|to| squared_change(&children, &found.nodes, *to, px)).sum::<f64>() / 4.0;
        assert!((0.5..2.0).contains(&(measured / predicted)), "{measured}, predicted {predicted}");
    }
}
