//! Differences between pictures of nodes.

use glam::DVec3;
use multiversion::multiversion;

use super::node::Nodes;
use super::raster::{Direction, Drawing, Picture, Pixel, Splats, Window};

/// Pixels along a side of the tiles whose sums are added up.
pub const SUM_TILE: usize = 16;

/// Smaller squared differences, and smaller sums over pixels, count as 0: devices take 32-bit floats below 1e-38 for 0.
pub const LEAST: f32 = 1e-24;

/// Sums of squared differences, with pixels of 1 x 1, 2 x 2 and 4 x 4 px.
pub type Sums = [f64; 3];

/// The squared difference of two pictures.
pub struct Difference {
    /// Of each pixel.
    pub squared: Vec<f32>,
    pub sums: Sums,
}

impl Difference {
    /// Of pictures of two lists of nodes. The memory of the drawings is used again.
    pub fn drawn(nodes: [&Nodes; 2], window: Window, drawings: &mut [Drawing; 2]) -> Self {
        let both = nodes.into_iter().zip(&mut *drawings);
        both.for_each(|(nodes, drawing)| Splats::of(nodes, window).draw(nodes, drawing));
        Self::of(window, &drawings[0].picture, &drawings[1].picture)
    }

    pub fn of(window: Window, expected: &Picture, drawn: &Picture) -> Self {
        // Differences of colours and of transmittance.
        let differences: Vec<Pixel> =
            expected.pixels().zip(drawn.pixels()).map(|(a, b)| std::array::from_fn(|k| a[k] - b[k])).collect();
        let [columns, rows] = [window.width, window.height].map(|side| (0..side).step_by(SUM_TILE));
        let tiles = rows.flat_map(|y| columns.clone().map(move |x| (x, y)));
        let sums = tiles.map(|tile| tile_sums(&differences, window, tile));
        Self { sums: total(sums), squared: differences.into_iter().map(mean_square).collect() }
    }
}

/// The total of several sums, in their order.
pub fn total(tiles: impl Iterator<Item = Sums>) -> Sums {
    tiles.fold(Sums::default(), |sum, own| std::array::from_fn(|i| sum[i] + own[i]))
}

/// The mean of the squared differences of the colours dP on black, and of dP + dT on white, with dT of transmittance.
fn mean_square([r, g, b, passing]: Pixel) -> f32 {
    let squares = |[r, g, b]: [f32; 3]| r * r + g * g + b * b;
    let mean = 0.5 * (squares([r, g, b]) + squares([r + passing, g + passing, b + passing]));
    if mean < LEAST { 0.0 } else { mean }
}

/// The sums of a tile, in the order of the invocations of a device. All versions make the same bits.
#[multiversion(targets("x86_64+avx2"))]
fn tile_sums(differences: &[Pixel], window: Window, (x, y): (usize, usize)) -> Sums {
    let mut tile = [[Pixel::default(); SUM_TILE]; SUM_TILE];
    let columns = SUM_TILE.min(window.width - x);
    for (own, row) in tile.iter_mut().zip(y..window.height) {
        own[..columns].copy_from_slice(&differences[row * window.width + x..][..columns]);
    }
    [1, 2, 4].map(|side| {
        let (blocks, pixels) = (SUM_TILE / side, side * side);
        let mut squares = [0.0_f64; SUM_TILE * SUM_TILE];
        for (i, square) in squares[..blocks * blocks].iter_mut().enumerate() {
            let (row, column) = (i / blocks * side, i % blocks * side);
            let mut sum = Pixel::default();
            for pixel in tile[row..][..side].iter().flat_map(|row| &row[column..][..side]) {
                sum.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += value);
            }
            *square = f64::from(mean_square(sum.map(|sum| sum / pixels as f32))) * pixels as f64;
        }
        let mut left = blocks * blocks;
        while left > 1 {
            left /= 2;
            let (low, high) = squares.split_at_mut(left);
            low.iter_mut().zip(high).for_each(|(low, high)| *low += *high);
        }
        squares[0]
    })
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
    use crate::lod::{FitOptions, Node, simplify};
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
        let found = simplify(&children, 2048, 0.0, FitOptions::default());
        let predicted: f64 = found.nodes.nodes.iter().map(|node| f64::from(node.squared_error)).sum();
        let measured = from_other_directions(&children, &found.nodes, f64::from(found.reference_width));
        assert!((0.5..2.0).contains(&(measured / predicted)), "{measured}, predicted {predicted}");
    }
}
