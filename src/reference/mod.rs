//! The pipelines on the CPU in f64: the oracle that GPU pictures are compared with.
//!
//! Each stage of the portable path has a file. The stages of the fast path between projection and blend share `bins`.
//! `ray` is no stage: it has the ideal sort key of a pixel. `prune` has the stages that measure contributions.
//! `ray_splat` and `ray_lists` are projection and lists of cameras with a lens.
//!
//! It follows the given [`Rules`]: EWA splatting (Zwicker et al. 2001) with the clamp and dilation of the original
//! 3DGS, and by default alpha in [1/255, 0.99], an exclusive stop at T < 1e-4, and one global order by (f32 view depth,
//! index). [`Rules::complete`] leaves nothing out, and [`Order::PerPixel`] sorts ideally. Together they separate the
//! errors of arithmetic, of approximation and of the model. Tests compare the reference itself with stored results of
//! gsplat.
//!
//! A camera with a lens, and with [`Response::Ray`] every camera, draws the exact response along the ray of each pixel,
//! in the order of the depths of [`Camera::depth`] for both [`Order::Depth`] and [`Order::Distance`]. The near plane is
//! one of these depths, too.

mod bins;
mod blend;
mod cull;
mod duplicate;
mod project;
mod prune;
mod ranges;
mod ray;
mod ray_lists;
mod ray_splat;
#[cfg(test)]
mod ray_tests;
mod scan;
mod sort;

use rayon::prelude::*;

pub use bins::{
    BinBlocks, BinOffsets, BinRange, Entry, bin_offsets, bins_of, block_mask, count_bins, list_bins, merge_inputs,
    sort_run,
};
pub use blend::{Lists, Pixel, blend, blend_rays};
pub use cull::cull;
pub use duplicate::{Tiling, duplicate, tiles};
pub use project::{Splat, project};
pub use prune::{Change, Contribution, bound, changes, contribute, contributions};
pub use ranges::ranges;
pub use ray::Rays;
pub use ray_lists::RayLists;
pub use ray_splat::{RaySplat, ray_splat};
pub use scan::scan;
pub use sort::sort;

use crate::camera::{Camera, Footprints};
use crate::pixels::{Depths, Pixels, Plane};
use crate::rules::{Background, Order, Response, Rules};
use crate::scene::Gaussians;

/// A rendered image in full precision.
pub struct Rendering {
    /// Width and height.
    pub size_px: [u32; 2],
    /// One per pixel, row by row from the top left.
    pub pixels: Vec<Pixel>,
}

/// Renders a scene in f64. Pixels that a lens sees nothing at are transparent black, over any background.
pub fn render(gaussians: &Gaussians, camera: &Camera, rules: &Rules, background: Background) -> Rendering {
    let along_rays = (rules.response == Response::Ray).then(|| camera.along_rays());
    let camera = along_rays.as_ref().unwrap_or(camera);
    let background = background.colour().map(f64::from).into();
    let rays = |visible: &[u32]| (rules.order == Order::PerPixel).then(|| Rays::new(gaussians, visible, camera));
    let pixels = match Footprints::of(camera) {
        None => {
            let listed = Listed::of(gaussians, camera, rules);
            let rays = rays(&listed.visible);
            blend(&listed.lists(rays.as_ref()), Tiling::of(camera.size_px), background, rules)
        }
        Some(footprints) => {
            let lists = RayLists::of(gaussians, camera, &footprints, rules);
            blend_rays(&lists, rays(&lists.visible).as_ref(), background, rules)
        }
    };
    Rendering { size_px: camera.size_px, pixels }
}

/// The splats of a pinhole's view and the list of every tile.
struct Listed {
    /// The Gaussian of each splat.
    visible: Vec<u32>,
    splats: Vec<Splat>,
    ranges: Vec<[u32; 2]>,
    splat_ids: Vec<u32>,
}

impl Listed {
    fn of(gaussians: &Gaussians, camera: &Camera, rules: &Rules) -> Self {
        let is_on_screen = camera.lens.is_none() && rules.response == Response::Screen;
        assert!(is_on_screen, "lists along rays are those of the rays");
        let tiling = Tiling::of(camera.size_px);
        let visible = cull(gaussians, camera, rules);
        let splats: Vec<Splat> = visible.par_iter().map(|id| project(gaussians, *id, camera, rules)).collect();
        let (_, order) = sort(&depth_keys(&splats, rules), &(0..splats.len() as u32).collect::<Vec<_>>(), 0..32);
        let (tile_keys, splat_ids) = duplicate(&splats, &order, tiling, rules);
        let (tile_keys, splat_ids) = sort(&tile_keys, &splat_ids, 0..tiling.key_bits());
        let ranges = ranges(&tile_keys, tiling.tiles());
        Self { visible, splats, ranges, splat_ids }
    }

    fn lists<'l>(&'l self, rays: Option<&'l Rays>) -> Lists<'l> {
        Lists { splats: &self.splats, ranges: &self.ranges, splat_ids: &self.splat_ids, rays }
    }
}

/// Sort keys of the splats. The bits of positive floats have the order of the floats.
fn depth_keys(splats: &[Splat], rules: &Rules) -> Vec<u32> {
    let key = |splat: &Splat| if rules.order == Order::Distance { splat.distance_world } else { splat.depth };
    splats.iter().map(|splat| (key(splat) as f32).to_bits()).collect()
}

impl Rendering {
    /// The picture rounded to f32.
    pub fn to_pixels(&self) -> Pixels {
        let rgba = self.pixels.iter().map(|p| {
            let [r, g, b] = p.colour.map(|v| v as f32);
            [r, g, b, (1.0 - p.transmittance) as f32]
        });
        Pixels { size: self.size_px, rgba: rgba.collect() }
    }

    /// Depths and splat counts rounded to f32.
    pub fn depths(&self) -> Depths {
        let plane = |value: fn(&Pixel) -> f64| Plane {
            size: self.size_px,
            values: self.pixels.iter().map(|p| value(p) as f32).collect(),
        };
        Depths {
            expected: plane(|p| if p.blended > 0 { p.depth / (1.0 - p.transmittance) } else { f64::NAN }),
            median: plane(|p| if p.median_depth > 0.0 { p.median_depth } else { f64::NAN }),
            counts: plane(|p| p.blended.into()),
        }
    }
}
