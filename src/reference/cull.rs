//! Culling: selects the Gaussians that touch the image.

use rayon::prelude::*;

use super::{Tiling, project, tiles};
use crate::camera::Camera;
use crate::rules::Rules;
use crate::scene::Gaussians;

/// Ascending ids of the Gaussians that touch at least one tile: beyond the near plane, with an opacity of at least the
/// alpha threshold, and with their ellipse on the image.
pub fn cull(gaussians: &Gaussians, camera: &Camera, rules: &Rules) -> Vec<u32> {
    let tiling = Tiling::of(camera.size_px);
    let is_visible = |id: &u32| {
        let index = *id as usize;
        let depth = camera.view(glam::DVec3::from(gaussians.means()[index].map(f64::from))).z;
        depth as f32 > rules.near
            && gaussians.opacities()[index] >= rules.alpha_min
            && !tiles(&project(gaussians, *id, camera, rules), tiling, rules).is_empty()
    };
    (0..gaussians.len() as u32).into_par_iter().filter(is_visible).collect()
}
