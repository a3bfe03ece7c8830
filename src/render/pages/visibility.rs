//! Culling of pages on the host: bounds of a page in the image and in depth, and the bins that are still open.

use std::ops::Range;

use glam::{DMat3, DVec3};

use crate::camera::Camera;
use crate::pagefile::Page;
use crate::render::frame::{DepthKeys, SortPosition, position_of};
use crate::rules::{LOW_PASS, Order, Rules};
use crate::scene::Transform;

/// A page that may have a splat in the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VisiblePage {
    pub page: u32,
    /// The number of its placed view.
    pub view: u32,
    /// Smallest and largest depth key of its Gaussians.
    pub keys: [u32; 2],
    /// Columns and rows of bins that its splats may touch: first and end.
    pub columns: [u16; 2],
    pub rows: [u16; 2],
    /// Number of Gaussians.
    pub count: u32,
    /// Estimated number of drawn Gaussians: all of them without levels of detail.
    pub drawn: u32,
    /// Error limits, as codes: for its nodes in the lower half, for their parents in the upper half.
    pub error_limits: u32,
}

impl VisiblePage {
    /// True if the slab may contain some of its Gaussians.
    pub fn is_in(&self, slab: &Range<SortPosition>) -> bool {
        position_of(self.keys[0]) < slab.end && position_of(self.keys[1] + 1) > slab.start
    }
}

/// A camera in the axes and units of a scene with a placement.
#[derive(Clone, Debug)]
pub struct PlacedCamera {
    pub camera: Camera,
    /// World units per unit of the scene.
    pub scale: f64,
}

impl PlacedCamera {
    /// The camera relative to a scene with this placement. The identity changes no bit.
    pub fn of(camera: &Camera, place: &Transform) -> Self {
        if *place == Transform::IDENTITY {
            return Self { camera: camera.clone(), scale: 1.0 };
        }
        let (turn, scale) = (place.rotation(), place.scale());
        let position = turn.inverse() * (camera.position - place.translation()) / scale;
        let rotation = camera.rotation * DMat3::from_quat(turn);
        Self { camera: Camera { position, rotation, ..camera.clone() }, scale }
    }

    /// The near plane, in units of the scene.
    pub fn near(&self, rules: &Rules) -> f64 {
        f64::from(rules.near) / self.scale
    }
}

/// Culls pages: the parameters that all pages of a frame share.
pub struct PageCuller<'a> {
    pub rules: &'a Rules,
    /// The alpha below which the reach of Gaussians in the page file ends.
    pub alpha_min: f32,
    pub keys: DepthKeys,
    /// The largest key of a splat.
    pub largest_key: u32,
    /// Width and height of a bin, in pixels.
    pub bin_px: [u32; 2],
    /// Columns and rows of bins.
    pub bins: [u32; 2],
    /// The row of the picture with which the first bins begin.
    pub top_px: u32,
}

impl PageCuller<'_> {
    /// The bounds of a page in the image and in depth; `None` if it is outside the frustum.
    pub fn page(&self, number: u32, page: &Page, view: u32, placed: &PlacedCamera) -> Option<VisiblePage> {
        if page.reach < 0.0 {
            return None;
        }
        let camera = &placed.camera;
        let [low, high] = [page.low, page.high].map(|corner| DVec3::from(corner.map(f64::from)));
        let (centre, half) = ((low + high) / 2.0, (high - low) / 2.0);
        let offset = centre - camera.position;
        // A bound of the rounding errors of the shaders and of this function, in units of the scene.
        let slack = 1e-6 * (offset.length() + half.length() + camera.position.length() * 1e-6);
        let along = |axis: DVec3| {
            let (middle, reach) = (axis.dot(offset), axis.abs().dot(half) + slack);
            [middle - reach, middle + reach]
        };
        let near = placed.near(self.rules);
        let depth = along(camera.forward());
        if depth[1] < near {
            return None;
        }
        let depth = depth.map(|z| z.max(near));
        let [columns, rows] = self.bins_of(camera, [along(camera.right()), along(camera.down())], depth, page)?;
        let far = match self.rules.order {
            Order::Distance => {
                let outside = (offset.abs() - half).max(DVec3::ZERO).length() - slack;
                [outside.max(0.0), (offset.abs() + half).length() + slack]
            }
            _ => depth,
        };
        let keys = [self.key(far[0] * placed.scale * (1.0 - 1e-6)), self.key(far[1] * placed.scale * (1.0 + 1e-6))];
        Some(VisiblePage {
            page: number,
            view,
            keys,
            columns,
            rows,
            count: page.count,
            drawn: page.count,
            error_limits: 0,
        })
    }

    /// The columns and rows of bins that splats with means in this box may touch; `None` if they miss the image.
    /// `across`: the extent of the box along the right and down axes of the camera; `depth`: along the view direction.
    fn bins_of(&self, camera: &Camera, across: [[f64; 2]; 2], depth: [f64; 2], page: &Page) -> Option<[[u16; 2]; 2]> {
        let opacity = f64::from(page.highest_opacity);
        let deviations = (2.0 * (opacity / f64::from(self.alpha_min)).max(1.0).ln()).sqrt() * 1.02;
        let mut found = [[0; 2]; 2];
        for axis in 0..2 {
            let (focal, centre) = (camera.focal_px[axis], camera.centre_px[axis]);
            let size = f64::from(camera.size_px[axis]);
            // A slope is extreme at a corner of the box.
            let slopes = [across[axis][0] / depth[0], across[axis][0] / depth[1]];
            let least = slopes[0].min(slopes[1]);
            let slopes = [across[axis][1] / depth[0], across[axis][1] / depth[1]];
            let most = slopes[0].max(slopes[1]);
            // The cull test of the shaders (cull_test.glsl), with the extremes of the box.
            let (first, last) = ((-centre - 0.15 * size) / focal, (size - centre + 0.15 * size) / focal);
            let steepest = least.clamp(first, last).abs().max(most.clamp(first, last).abs());
            let extent = focal / depth[0] * (1.0 + steepest * steepest).sqrt() * f64::from(page.reach) * 1.01
                + deviations * LOW_PASS.sqrt();
            let [low, high] = [focal * least + centre, focal * most + centre];
            let slack = 1e-5 * (extent + low.abs().max(high.abs()) + focal) + 1.0;
            let (from, to) = (low - extent - slack, high + extent + slack);
            // Also false for NaN: such a page is kept.
            if to < 0.0 || from > size {
                return None;
            }
            let (bin, bins) = (f64::from(self.bin_px[axis]), f64::from(self.bins[axis]));
            let begin = [0.0, f64::from(self.top_px)][axis];
            let (from, to) = (from - begin, to - begin);
            // The page is beside the rows that are drawn.
            if to < 0.0 || from > bins * bin {
                return None;
            }
            let end = if to.is_nan() { bins } else { ((to / bin).floor() + 1.0).clamp(0.0, bins) };
            found[axis] = [(from / bin).floor().max(0.0).min(bins) as u16, end as u16];
        }
        Some(found)
    }

    /// The depth key of a depth in world units.
    fn key(&self, depth: f64) -> u32 {
        let near = self.rules.near;
        let depth = (depth as f32).clamp(near, f32::MAX);
        ((depth.to_bits() - near.to_bits()) >> self.keys.shift).min(self.largest_key)
    }
}

/// Open bins (bins with a pixel that has not stopped) as a summed-area table, for tests of rectangles.
pub struct OpenBinTable {
    columns: usize,
    /// Number of open bins above and to the left of each corner of bins.
    sums: Vec<u32>,
}

impl OpenBinTable {
    /// The table of `bins` columns and rows, given one bit per bin.
    pub fn of(bits: &[u32], bins: [u32; 2]) -> Self {
        let [columns, rows] = bins.map(|side| side as usize);
        let mut sums = vec![0; (columns + 1) * (rows + 1)];
        for row in 0..rows {
            let mut before = 0;
            for column in 0..columns {
                let bin = row * columns + column;
                before += bits[bin / 32] >> (bin % 32) & 1;
                sums[(row + 1) * (columns + 1) + column + 1] = sums[row * (columns + 1) + column + 1] + before;
            }
        }
        Self { columns: columns + 1, sums }
    }

    /// True if the page may touch an open bin.
    pub fn touches(&self, page: &VisiblePage) -> bool {
        let sum = |row: u16, column: u16| self.sums[usize::from(row) * self.columns + usize::from(column)];
        let ([left, right], [top, bottom]) = (page.columns, page.rows);
        sum(bottom, right) + sum(top, left) > sum(bottom, left) + sum(top, right)
    }

    /// Number of open bins.
    pub fn count(&self) -> u32 {
        self.sums.last().copied().unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rectangle_meets_an_open_bin_in_it_only() {
        let bins = [7, 5];
        let mut bits = vec![0; 2];
        for bin in [0, 9, 33] {
            bits[bin / 32] |= 1 << (bin % 32);
        }
        let open = OpenBinTable::of(&bits, bins);
        assert_eq!([open.count(), OpenBinTable::of(&[0, 0], bins).count()], [3, 0]);
        for left in 0..7 {
            for right in left..=7 {
                for top in 0..5 {
                    for bottom in top..=5 {
                        let inside =
                            |bin: u16| (left..right).contains(&(bin % 7)) && (top..bottom).contains(&(bin / 7));
                        let page = VisiblePage {
                            page: 0,
                            view: 0,
                            keys: [0, 0],
                            columns: [left, right],
                            rows: [top, bottom],
                            count: 1,
                            drawn: 1,
                            error_limits: 0,
                        };
                        assert_eq!(open.touches(&page), [0, 9, 33].into_iter().any(inside), "{page:?}");
                    }
                }
            }
        }
    }
}
