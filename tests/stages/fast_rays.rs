//! The stages of the fast path along rays in whole frames: what they wrote, against the rays of the reference.

use smalto::camera::{Camera, Footprints};
use smalto::options::Options;
use smalto::reference::RayLists;
use smalto::render::shaders::Bin;
use smalto::render::{BinGrid, Path};
use smalto::rules::Rules;
use smalto::scene::Gaussians;

use crate::common::lens::{all, around};
use crate::common::{Captured, Gpu, Random};

const RULES: &Rules = &Rules::TRAINED;
/// Columns and rows of blocks in a bin, and the width of a block, px.
const BLOCKS: [u32; 2] = [8, 4];
const WIDTH: u32 = 8;

struct Case {
    name: &'static str,
    camera: Camera,
    gaussians: Gaussians,
    captured: Captured,
}

fn cases() -> Vec<Case> {
    let gpu = Gpu::new();
    let case = |(i, (name, camera)): (usize, (&'static str, Camera))| {
        let gaussians = around(&mut Random(30 + i as u64), &camera, 700);
        let captured = gpu.capture(&gaussians, &camera, &Options::EXACT);
        Case { name, camera, gaussians, captured }
    };
    all([300, 150]).into_iter().enumerate().map(case).collect()
}

/// A Gaussian and the block of a bin that it reaches.
type Reached = (u32, u32, u32);

impl Case {
    fn grid(&self) -> BinGrid {
        // Small pictures have the lowest blocks.
        BinGrid::new(self.camera.size_px, 0)
    }

    /// The blocks that the masks of the GPU mark.
    fn marked(&self) -> Vec<Reached> {
        let bins: Vec<Bin> = self.captured.buffer("bins");
        let ids: Vec<u32> = self.captured.buffer("splat ids");
        let gaussians: Vec<u32> = self.captured.buffer("gaussian from splat");
        let masks: Vec<u32> = self.captured.buffer("unsorted splats or masks");
        let mut marked = Vec::new();
        for (number, bin) in (0..self.grid().count()).zip(&bins) {
            for entry in 0..bin.count {
                let gaussian = gaussians[ids[(bin.first + entry) as usize] as usize];
                let segment = bin.first_segment + entry / 1024;
                let word = |block: u32| masks[((segment * 32 + block) * 32 + entry % 1024 / 32) as usize];
                marked.extend(
                    (0..32).filter(|block| word(*block) >> (entry % 32) & 1 == 1).map(|b| (gaussian, number, b)),
                );
            }
        }
        marked.sort_unstable();
        marked
    }

    /// The blocks in which the reference sees a Gaussian at the centre of some pixel.
    fn touched(&self) -> Vec<Reached> {
        let exact = RayLists::of(&self.gaussians, &self.camera, &Footprints::of(&self.camera).unwrap(), RULES);
        let (grid, width) = (self.grid(), self.camera.size_px[0]);
        let mut touched = Vec::new();
        for (pixel, ray) in (0..).zip(&exact.rays) {
            let Some(ray) = *ray else { continue };
            let [x, y] = [pixel % width / WIDTH, pixel / width / grid.block_height];
            let bin = y / BLOCKS[1] * grid.bins[0] + x / BLOCKS[0];
            let block = y % BLOCKS[1] * BLOCKS[0] + x % BLOCKS[0];
            let met = exact.visible.iter().zip(&exact.splats);
            let met = met.filter(|(_, splat)| splat.distance(ray) < splat.level(RULES) * (1.0 - 1e-4));
            touched.extend(met.map(|(id, _)| (*id, bin, block)));
        }
        touched.sort_unstable();
        touched.dedup();
        touched
    }
}

#[test]
fn every_block_that_a_ray_touches_is_marked_and_hardly_more() {
    for case in cases() {
        assert_eq!(case.captured.frame.path, Path::FastRays, "{}", case.name);
        let (marked, touched) = (case.marked(), case.touched());
        assert!(marked.is_sorted_by(|a, b| a < b), "{}: no splat is listed twice", case.name);
        let missing: Vec<_> = touched.iter().filter(|reached| marked.binary_search(reached).is_err()).collect();
        assert!(missing.is_empty(), "{}: Gaussians, bins and blocks {missing:?} are missing", case.name);
        println!("{}: {} marked, {} touched", case.name, marked.len(), touched.len());
        assert!(touched.len() > 3000, "{}: {} touched", case.name, touched.len());
        // The bins at the poles of a panorama see many directions, and are wide in bounds.
        let most = if case.name == "EQUIRECTANGULAR" { 3 } else { 2 };
        assert!(marked.len() < most * touched.len(), "{}: {} for {}", case.name, marked.len(), touched.len());
    }
}
