//! The lists of the tiles of a camera with a lens: the splats that the rays of a tile may meet.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::ray_splat::RayBox;
use super::{RaySplat, Tiling, ray_splat};
use crate::camera::{Camera, Footprints};
use crate::rules::{Rules, TILE};
use crate::scene::Gaussians;

/// The rays of a camera with a lens, its splats, and the list of every tile.
pub struct RayLists {
    /// The ray of each pixel, row by row: [`Camera::ray`] of its centre.
    pub rays: Vec<Option<DVec3>>,
    /// The Gaussian of each splat.
    pub visible: Vec<u32>,
    pub splats: Vec<RaySplat>,
    tiling: Tiling,
    /// The splats of each tile, front to back.
    pub(super) lists: Vec<Vec<u32>>,
}

impl RayLists {
    /// The lists of a camera with a lens, whose footprints are given.
    pub fn of(gaussians: &Gaussians, camera: &Camera, footprints: &Footprints, rules: &Rules) -> Self {
        let tiling = Tiling::of(camera.size_px);
        let [width, height] = camera.size_px;
        let ray = |pixel: usize| {
            let place = [pixel as u32 % width, pixel as u32 / width].map(|at| f64::from(at) + 0.5);
            camera.ray(place.into())
        };
        let rays = (0..width as usize * height as usize).into_par_iter().map(ray).collect();
        let is_visible = |id: &u32| {
            let index = *id as usize;
            let depth = camera.depth(camera.view(DVec3::from(gaussians.means()[index].map(f64::from))));
            depth > 0.0 && depth as f32 > rules.near && gaussians.opacities()[index] >= rules.alpha_min
        };
        let visible: Vec<u32> = (0..gaussians.len() as u32).into_par_iter().filter(is_visible).collect();
        let splats = visible.par_iter().map(|id| ray_splat(gaussians, *id, camera, footprints, rules)).collect();
        let mut found = Self { rays, visible, splats, tiling, lists: vec![Vec::new(); tiling.tiles()] };
        let mut order: Vec<u32> = (0..found.splats.len() as u32).collect();
        order.par_sort_by_key(|id| (found.splats[*id as usize].depth as f32).to_bits());
        for (tile, list) in found.walk(tiling.counts.map(|count| 0..count), &order, rules) {
            found.lists[tile as usize] = list;
        }
        found
    }

    /// The splats that a pixel may show, front to back.
    pub fn at(&self, pixel: usize) -> &[u32] {
        let [x, y] = [pixel as u32 % self.tiling.size_px[0], pixel as u32 / self.tiling.size_px[0]];
        &self.lists[((y / TILE) * self.tiling.counts[0] + x / TILE) as usize]
    }

    /// The lists of the tiles in some columns and rows. Their splats are among `ids`.
    fn walk(&self, area: [Range<u32>; 2], ids: &[u32], rules: &Rules) -> Vec<(u32, Vec<u32>)> {
        let Some(rays) = self.rays_of(&area) else { return Vec::new() };
        let may_reach = |id: &u32| {
            let splat = &self.splats[*id as usize];
            splat.may_reach(&rays, splat.level(rules))
        };
        let ids: Vec<u32> = ids.iter().copied().filter(may_reach).collect();
        let [columns, rows] = area;
        if columns.len() == 1 && rows.len() == 1 {
            return vec![(rows.start * self.tiling.counts[0] + columns.start, ids)];
        }
        let halves = |of: &Range<u32>| {
            let middle = of.start + of.len() as u32 / 2;
            [of.start..middle, middle..of.end]
        };
        let areas = if columns.len() > rows.len() {
            halves(&columns).map(|columns| [columns, rows.clone()])
        } else {
            halves(&rows).map(|rows| [columns.clone(), rows])
        };
        let [first, second] = areas;
        let (mut found, more) = rayon::join(|| self.walk(first, &ids, rules), || self.walk(second, &ids, rules));
        found.extend(more);
        found
    }

    /// The box of the rays of the tiles in some columns and rows.
    fn rays_of(&self, area: &[Range<u32>; 2]) -> Option<RayBox> {
        let [columns, rows] =
            [0, 1].map(|axis| area[axis].start * TILE..(area[axis].end * TILE).min(self.tiling.size_px[axis]));
        let row = |y: u32| {
            let start = (y * self.tiling.size_px[0]) as usize;
            self.rays[start + columns.start as usize..start + columns.end as usize].iter()
        };
        RayBox::of(rows.flat_map(row).flatten().copied())
    }
}
