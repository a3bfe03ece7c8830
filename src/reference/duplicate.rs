//! Lists the tiles that each splat touches, one instance per tile.

use glam::{DVec2, dvec2};
use rayon::prelude::*;

use super::Splat;
use crate::rules::{Footprint, Rules, TILE};

/// The grid of tiles of an image.
#[derive(Clone, Copy, Debug)]
pub struct Tiling {
    /// Width and height of the image.
    pub size_px: [u32; 2],
    /// Columns and rows.
    pub counts: [u32; 2],
}

impl Tiling {
    /// The tiles of an image of this size.
    pub fn of(size_px: [u32; 2]) -> Self {
        Self { size_px, counts: size_px.map(|s| s.div_ceil(TILE)) }
    }

    /// Number of tiles.
    pub fn tiles(self) -> usize {
        self.counts[0] as usize * self.counts[1] as usize
    }

    /// Number of bits that hold every tile number.
    pub fn key_bits(self) -> u32 {
        (self.tiles() as u32).next_power_of_two().trailing_zeros()
    }

    /// Smallest and largest pixel centre of tile (column, row).
    fn centres(self, column: u32, row: u32) -> (DVec2, DVec2) {
        let low = [column, row].map(|t| f64::from(t * TILE) + 0.5);
        let high: [f64; 2] =
            std::array::from_fn(|i| f64::from(([column, row][i] * TILE + TILE).min(self.size_px[i])) - 0.5);
        (low.into(), high.into())
    }
}

/// Ascending numbers of the tiles that the splat is drawn in: those in whose box of pixel centres its alpha reaches the
/// threshold, or those of the square of the original 3DGS.
pub fn tiles(splat: &Splat, tiling: Tiling, rules: &Rules) -> Vec<u32> {
    let level = splat.level(rules);
    let mut touched = Vec::new();
    if level.is_nan() || level < 0.0 {
        return touched;
    }
    if rules.extent == Footprint::ThreeSigmaSquares {
        return square_tiles(splat, tiling);
    }
    let extent = dvec2(splat.covariance.x_axis.x, splat.covariance.y_axis.y).map(|v| (level * v).sqrt());
    let tile = f64::from(TILE);
    let last = DVec2::from(tiling.counts.map(f64::from)) - 1.0;
    let from = ((splat.mean_px - extent) / tile).floor().clamp(DVec2::ZERO, last);
    let to = ((splat.mean_px + extent) / tile).floor().clamp(DVec2::ZERO, last);
    for row in from.y as u32..=to.y as u32 {
        for column in from.x as u32..=to.x as u32 {
            let (low, high) = tiling.centres(column, row);
            if least_distance(splat, low, high) <= level {
                touched.push(row * tiling.counts[0] + column);
            }
        }
    }
    touched
}

/// The tiles of the square of three standard deviations along the longest axis, as the original 3DGS computes them:
/// with pixel centres at integers, and a lower bound of 0.1 under the root.
fn square_tiles(splat: &Splat, tiling: Tiling) -> Vec<u32> {
    let [a, b, c] = [splat.covariance.x_axis.x, splat.covariance.x_axis.y, splat.covariance.y_axis.y];
    let longest = 0.5 * (a + c) + (0.25 * (a - c).powi(2) + b * b).max(0.1).sqrt();
    let radius = (3.0 * longest.sqrt()).ceil();
    let tile = f64::from(TILE);
    let low = ((splat.mean_px - 0.5 - radius) / tile).floor();
    let high = ((splat.mean_px - 0.5 + radius + tile - 1.0) / tile).floor();
    let counts = DVec2::from(tiling.counts.map(f64::from));
    let (low, high) = (low.clamp(DVec2::ZERO, counts), high.clamp(DVec2::ZERO, counts));
    let rows = low.y as u32..high.y as u32;
    rows.flat_map(|row| (low.x as u32..high.x as u32).map(move |column| row * tiling.counts[0] + column)).collect()
}

/// Smallest squared Mahalanobis distance of the points in a box: 0 if it contains the mean, else attained on an edge.
pub(super) fn least_distance(splat: &Splat, low: DVec2, high: DVec2) -> f64 {
    if splat.mean_px.cmpge(low).all() && splat.mean_px.cmple(high).all() {
        return 0.0;
    }
    let conic = splat.conic;
    let mean = splat.mean_px;
    // On a vertical edge at x the distance is smallest at y = mean.y - B / C (x - mean.x); on a horizontal edge
    // likewise.
    let on_vertical = |x: f64| {
        let y = mean.y - conic.x_axis.y / conic.y_axis.y * (x - mean.x);
        splat.distance(dvec2(x, y.clamp(low.y, high.y)))
    };
    let on_horizontal = |y: f64| {
        let x = mean.x - conic.x_axis.y / conic.x_axis.x * (y - mean.y);
        splat.distance(dvec2(x.clamp(low.x, high.x), y))
    };
    let candidates = [on_vertical(low.x), on_vertical(high.x), on_horizontal(low.y), on_horizontal(high.y)];
    candidates.into_iter().fold(f64::INFINITY, f64::min)
}

/// Tile number and splat id of every instance, splat after splat in the given order.
pub fn duplicate(splats: &[Splat], order: &[u32], tiling: Tiling, rules: &Rules) -> (Vec<u32>, Vec<u32>) {
    let touched: Vec<Vec<u32>> = order.par_iter().map(|id| tiles(&splats[*id as usize], tiling, rules)).collect();
    let repeated = order.iter().zip(&touched).flat_map(|(id, tiles)| std::iter::repeat_n(*id, tiles.len()));
    let splat_ids = repeated.collect();
    (touched.concat(), splat_ids)
}
