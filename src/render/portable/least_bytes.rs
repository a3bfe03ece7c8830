//! The fewest bytes that the stages of the portable path move through device memory.

use super::pipeline::PortablePipeline;
use crate::render::frame::Shot;
use crate::render::shaders::{PortableDispatches, Splat, Totals};

impl PortablePipeline {
    /// The fewest bytes that each stage moves through device memory: each input read once, each output written once, in
    /// each pass of a sort.
    pub fn least_bytes(&self, shot: Shot, totals: &Totals) -> Vec<(&'static str, u64)> {
        let Shot { scene, camera, .. } = shot;
        let gaussians = scene.len() as u64;
        let [visible, spans, instances] = [totals.visible_kept, totals.spans, totals.listed_kept].map(u64::from);
        let tiles: u64 = shot.tiles().into();
        let pixels: u64 = shot.size().iter().map(|side| u64::from(*side)).product();
        let splat = size_of::<Splat>() as u64;
        let [depth_passes, tile_passes] = self.sort_passes(scene, camera).map(u64::from);
        // Bytes per key and pass: keys in to count, keys and values in to move, keys and values out.
        let pass = 4 + 8 + 8;
        vec![
            ("clear", (size_of::<Totals>() + size_of::<PortableDispatches>()) as u64 + 8 * tiles),
            // Bounds in; a bit out and in; ids out.
            ("cull", 16 * gaussians + gaussians / 4 + 4 * visible),
            // Id and Gaussian in; splat, depth key, span range, tile count and spans out.
            ("project", visible * (4 + scene.bytes_each() + splat + 4 + 8 + 4) + 4 * spans),
            // The values of the first pass are indices, which are not read.
            ("sort depths", visible * (pass * depth_passes).saturating_sub(4)),
            // Order and tile count in, twice; offset out.
            ("scan", visible * (2 * 8 + 4)),
            // Order, offset, span range and spans in; tile key and splat out.
            ("duplicate", visible * (4 + 4 + 8) + 4 * spans + 8 * instances),
            ("sort tiles", instances * pass * tile_passes),
            // Keys in; ranges out and in; order out.
            ("ranges", 4 * instances + 20 * tiles),
            // Ids in; every splat in once, because later reads may hit a cache; the image out.
            ("blend", 4 * instances + splat * visible + 16 * pixels),
        ]
    }
}
