//! The fewest bytes that each stage of a frame moves through device memory: each input read once, each output written
//! once, pass by pass of a sort. What a stage takes longer than a copy of as many bytes, it spends on something else.

use crate::render::{PortableDispatches, GpuScene, Splat, Totals};

/// What a frame worked on.
pub struct Work<'a> {
    pub scene: &'a GpuScene,
    pub totals: &'a Totals,
    pub tiles: u32,
    pub pixels: u64,
    /// Passes of the sort by depth and of the sort by tile.
    pub sort_passes: [u32; 2],
}

impl Work<'_> {
    /// Bytes of the stage with this name.
    pub fn least_bytes(&self, stage: &str) -> u64 {
        let gaussians = self.scene.len() as u64;
        let [visible, spans, instances] =
            [self.totals.visible_kept, self.totals.spans, self.totals.listed_kept].map(u64::from);
        let (tiles, splat) = (u64::from(self.tiles), size_of::<Splat>() as u64);
        let [depth_passes, tile_passes] = self.sort_passes.map(u64::from);
        // Of each key and value: counted, moved.
        let pass = 4 + 8 + 8;
        match stage {
            "clear" => (size_of::<Totals>() + size_of::<PortableDispatches>()) as u64 + 8 * tiles,
            // Bounds in; a bit out and in; ids out.
            "cull" => 16 * gaussians + gaussians / 4 + 4 * visible,
            // Id and Gaussian in; splat, depth key, span range and tile count out.
            "project" => visible * (4 + self.scene.bytes_each() + splat + 4 + 8 + 4) + 4 * spans,
            // The values of the first pass are indices, and not read.
            "sort depths" => visible * (pass * depth_passes).saturating_sub(4),
            // Order and tile count in, twice; offset out.
            "scan" => visible * (2 * 8 + 4),
            // Order, offset, span range and spans in; tile key and splat out.
            "duplicate" => visible * (4 + 4 + 8) + 4 * spans + 8 * instances,
            "sort tiles" => instances * pass * tile_passes,
            // Keys in; ranges out and in; order out.
            "ranges" => 4 * instances + 20 * tiles,
            // Of the fast path, whose instances are entries of bins. Span ranges and spans in.
            "count" => 8 * visible + 4 * spans,
            // The same and depth keys in; depth key and splat of every entry out.
            "fill" => 12 * visible + 4 * spans + 8 * instances,
            "sort" => (8 + 4) * instances,
            // Splat ids and the shapes of splats in; a bit for each of 32 blocks out.
            "masks" => (4 + 4) * instances + 32 * visible,
            // Every splat in once, from wherever it is cached; the image out.
            "blend" => visible * splat + 4 * instances + 16 * self.pixels,
            _ => 0,
        }
    }
}
