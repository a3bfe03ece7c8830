//! The error of nodes that a source has in place of finer ones, without saying which stands for which.

use rayon::prelude::*;

use super::difference::Difference;
use super::fit::{pixel_width, reference_width};
use super::node::Nodes;
use super::raster::{Window, directions};

/// Most pixels along the diagonal of a picture.
const MOST_PX: f64 = 2048.0;
/// Pixels along a side of the tiles in which a picture is drawn, for memory of a bounded size. A multiple of the widest
/// pixels of [`Difference`].
const TILE: usize = 256;

/// What nodes change that are drawn in place of others.
pub struct Replacement {
    /// The squared difference of colours, summed over the channels and over the area, world units squared: the mean
    /// over six directions and over black and white backgrounds.
    pub squared_error: f64,
    /// The reference pixel width, world units: in wider pixels, the difference falls with the square of the width.
    pub reference_width: f64,
}

/// Measures `nodes` in place of `finer` ones, in pixels as wide as the median node.
pub fn replacement(finer: &Nodes, nodes: &Nodes) -> Replacement {
    let (px, views) = (pixel_width(nodes, finer, MOST_PX), directions());
    let tiles = views.into_iter().flat_map(|direction| Window::around(finer, direction, px).tiles(TILE));
    let sums_of = |drawings: &mut _, tile| Difference::drawn([finer, nodes], tile, drawings).sums;
    let each: Vec<[f64; 3]> = tiles.collect::<Vec<_>>().into_par_iter().map_init(Default::default, sums_of).collect();
    // In order, so that the sum is the same on any number of cores.
    let sums = each.into_iter().fold([0.0; 3], |sum, own| std::array::from_fn(|i| sum[i] + own[i]));
    Replacement { squared_error: sums[0] * px * px / views.len() as f64, reference_width: reference_width(sums, px) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lod::{FitOptions, Node, simplify};
    use crate::procedural::cactus;
    use crate::scene::along_curve;

    /// Merged nodes have the sum of the errors that they have one by one.
    #[test]
    fn the_error_of_all_is_the_sum_of_all() {
        let scene = cactus::cactus(60_000).unwrap().gaussians;
        let finer = Nodes::of(&scene, along_curve(scene.means())[..4096].iter().map(|index| *index as usize));
        let found = simplify(&finer, 2048, 0.0, FitOptions::default());
        let expected: f64 = found.nodes.nodes.iter().map(|node| f64::from(node.squared_error)).sum();
        let Replacement { squared_error, reference_width } = replacement(&finer, &found.nodes);
        // The pixels are those of the parents after the fit, not before.
        assert!((squared_error / expected - 1.0).abs() < 0.05, "{squared_error}, not {expected}");
        assert!((reference_width / f64::from(found.reference_width) - 1.0).abs() < 0.05);
        assert_eq!(replacement(&finer, &finer).squared_error, 0.0);
    }

    /// A disc that is missing makes the same error wherever it lies, also where tiles meet.
    #[test]
    fn tiles_add_up_to_the_picture() {
        let mut finer = Nodes::new(0);
        for i in 0..200 {
            let mean = [14.0 * (i % 20) as f32, 14.0 * (i / 20) as f32, 0.0];
            finer.push(Node::leaf(mean, [1.0, 0.0, 0.0, 0.0], [0.25; 3], 0.5), &[[0.0; 3]]);
        }
        let error = |gone: usize| {
            let mut nodes = finer.clone();
            nodes.nodes[gone].opacity = 0.0;
            replacement(&finer, &nodes).squared_error
        };
        let sharp = 3.0 * 0.25 * std::f64::consts::PI / 4.0 * 0.25_f64.powi(2);
        let part = error(95) / sharp;
        assert!((0.4..0.6).contains(&part), "with the low-pass less than a sharp disc: {part}");
        for gone in 0..200 {
            let found = error(gone) / sharp;
            assert!((found / part - 1.0).abs() < 0.1, "node {gone}: {found}, not {part}");
        }
    }
}
