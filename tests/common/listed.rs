//! The tile lists of a frame in f64, and a walk over a pixel's list, entry by entry.

use glam::{DVec2, DVec3, dvec2};
use smalto::camera::Camera;
use smalto::reference::{self, Lists, Splat, Tiling};
use smalto::rules::{Rules, TILE};
use smalto::scene::Gaussians;

const RULES: &Rules = &Rules::TRAINED;

/// Splats in f64 and the lists of the tiles.
pub struct Listed {
    pub gaussians: Vec<u32>,
    pub splats: Vec<Splat>,
    pub ranges: Vec<[u32; 2]>,
    pub ids: Vec<u32>,
    pub tiling: Tiling,
}

/// The result of walking a pixel's list in f64.
#[derive(Default)]
pub struct Walked {
    pub evaluations: usize,
    /// Splats that were blended.
    pub blended: Vec<u32>,
    pub is_stopped: bool,
}

impl Listed {
    /// The lists of the f64 reference.
    pub fn of(scene: &Gaussians, camera: &Camera) -> Self {
        let gaussians = reference::cull(scene, camera, RULES);
        let splats: Vec<Splat> = gaussians.iter().map(|id| reference::project(scene, *id, camera, RULES)).collect();
        let mut order: Vec<u32> = (0..splats.len() as u32).collect();
        order.sort_by(|a, b| (splats[*a as usize].depth as f32).total_cmp(&(splats[*b as usize].depth as f32)));
        let tiling = Tiling::of(camera.size_px);
        let (keys, ids) = reference::duplicate(&splats, &order, tiling, RULES);
        let (keys, ids) = reference::sort(&keys, &ids, 0..tiling.key_bits());
        Self { gaussians, splats, ranges: reference::ranges(&keys, tiling.tiles()), ids, tiling }
    }

    pub fn list(&self, pixel: usize) -> (&[u32], DVec2) {
        let (x, y) = (pixel as u32 % self.tiling.size_px[0], pixel as u32 / self.tiling.size_px[0]);
        let [begin, end] = self.ranges[(y / TILE * self.tiling.counts[0] + x / TILE) as usize];
        (&self.ids[begin as usize..end as usize], dvec2(f64::from(x) + 0.5, f64::from(y) + 0.5))
    }

    pub fn walk(&self, pixel: usize) -> Walked {
        let (list, centre) = self.list(pixel);
        let (mut walked, mut transmittance) = (Walked::default(), 1.0);
        for id in list {
            walked.evaluations += 1;
            let splat = &self.splats[*id as usize];
            if splat.distance(centre) > splat.level(RULES) {
                continue;
            }
            let alpha = (splat.opacity * (-0.5 * splat.distance(centre)).exp()).min(RULES.alpha_max.into());
            if transmittance * (1.0 - alpha) < f64::from(RULES.transmittance_min) {
                walked.is_stopped = true;
                break;
            }
            transmittance *= 1.0 - alpha;
            walked.blended.push(*id);
        }
        walked
    }

    /// The pixels blended over black, with the doubt of each.
    pub fn blend(&self) -> Vec<reference::Pixel> {
        let lists = Lists { splats: &self.splats, ranges: &self.ranges, splat_ids: &self.ids, rays: None };
        reference::blend(&lists, self.tiling, DVec3::ZERO, RULES)
    }
}
