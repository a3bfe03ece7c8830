//! The patches of a picture that may show anything.

use rayon::prelude::*;

use crate::camera::Camera;
use crate::options::Options;
use crate::render::frame::DepthKeys;
use crate::render::pages::{PageCuller, PlacedCamera};
use crate::render::patches::{PATCH_PX, Patches};
use crate::render::scene::GpuScene;

/// The patches of a picture that splats of pages may touch, each with the number of these pages: those that pages of
/// Gaussians touch, and those that only pages of nodes touch. All others show the background in every picture.
pub struct Touched {
    pub by_gaussians: Vec<(u32, u32)>,
    pub by_nodes: Vec<(u32, u32)>,
}

/// The touched patches of a picture of a scene in pages.
pub fn touched_patches(scene: &GpuScene, camera: &Camera, options: &Options) -> Touched {
    let [columns, rows] = Patches::grid(camera.size_px);
    let Some(paged) = scene.paged() else {
        return Touched { by_gaussians: (0..columns * rows).map(|patch| (patch, 1)).collect(), by_nodes: Vec::new() };
    };
    let cache = paged.cache();
    let pages = cache.pages();
    let culler = PageCuller {
        rules: &options.rules,
        alpha_min: pages.alpha_min(),
        keys: DepthKeys { bits: 32, shift: 0 },
        largest_key: u32::MAX,
        bin_px: [PATCH_PX; 2],
        bins: [columns, rows],
        top_px: 0,
    };
    let cameras: Vec<_> = scene.transforms().iter().map(|place| PlacedCamera::of(camera, place)).collect();
    let (mut by_gaussians, mut by_nodes) = (Counts::new(columns, rows), Counts::new(columns, rows));
    for (numbers, views) in pages.scenes().into_iter().zip(scene.views_of_scenes()) {
        let all: Vec<_> = numbers.flat_map(|page| views.clone().map(move |view| (page, view))).collect();
        let seen = all.par_iter().with_min_len(1024).filter_map(|(page, view)| {
            let seen = culler.page(*page as u32, &pages.pages()[*page], *view, &cameras[*view as usize])?;
            Some((pages.level(*page).level == 0, [seen.columns, seen.rows]))
        });
        for (is_of_gaussians, rectangle) in seen.collect::<Vec<_>>() {
            (if is_of_gaussians { &mut by_gaussians } else { &mut by_nodes }).add(rectangle);
        }
    }
    let by_gaussians = by_gaussians.touched();
    let is_new = |patch: &u32| by_gaussians.binary_search_by_key(patch, |(patch, _)| *patch).is_err();
    let by_nodes = by_nodes.touched().into_iter().filter(|(patch, _)| is_new(patch)).collect();
    Touched { by_gaussians, by_nodes }
}

/// The number of pages that touch each patch.
struct Counts {
    /// Patches in a row, and one more.
    width: usize,
    /// Differences from patch to patch, along rows.
    changes: Vec<i64>,
}

impl Counts {
    fn new(columns: u32, rows: u32) -> Self {
        let width = columns as usize + 1;
        Self { width, changes: vec![0; width * rows as usize] }
    }

    /// Adds a page that touches these columns and rows: first and end.
    fn add(&mut self, [[left, right], [top, bottom]]: [[u16; 2]; 2]) {
        for row in usize::from(top)..usize::from(bottom) {
            self.changes[row * self.width + usize::from(left)] += 1;
            self.changes[row * self.width + usize::from(right)] -= 1;
        }
    }

    /// The patches that a page touches, in ascending order, with the numbers of pages.
    fn touched(&self) -> Vec<(u32, u32)> {
        let mut touched = Vec::new();
        for (row, changes) in self.changes.chunks_exact(self.width).enumerate() {
            let mut pages = 0;
            for (column, change) in changes[..self.width - 1].iter().enumerate() {
                pages += change;
                if pages > 0 {
                    touched.push(((row * (self.width - 1) + column) as u32, pages as u32));
                }
            }
        }
        touched
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patches_are_touched_by_the_rectangles_of_pages() {
        let mut counts = Counts::new(5, 4);
        counts.add([[1, 3], [0, 2]]);
        counts.add([[2, 5], [1, 2]]);
        counts.add([[0, 0], [3, 4]]);
        assert_eq!(counts.touched(), [(1, 1), (2, 1), (6, 1), (7, 2), (8, 1), (9, 1)]);
    }
}
