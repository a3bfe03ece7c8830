//! The stages of the portable path one at a time, for the ladder (`benches/ladder`), which replaces some of them.

use anyhow::Result;

use super::pipeline::PortablePipeline;
use super::workspace::PortableWorkspace;
use crate::camera::Camera;
use crate::gpu::{Access, Buffer, Commands, Device};
use crate::options::Options;
use crate::render::capacity::Capacity;
use crate::render::frame::{Shot, Target, tiles};
use crate::render::scene::GpuScene;

/// The stages of a scene, and the buffers between them. Each method records one stage; barriers between stages are the
/// caller's.
pub struct PortableStages<'s> {
    pipeline: PortablePipeline,
    scene: &'s GpuScene,
    /// The buffers between the stages.
    pub work: PortableWorkspace,
}

impl<'s> PortableStages<'s> {
    /// Builds the stages, and buffers of a guessed capacity.
    ///
    /// # Errors
    /// If the options ask for what only the reference draws, a pipeline cannot be made, or memory runs out.
    pub fn new(device: &Device, options: &Options, scene: &'s GpuScene) -> Result<Self> {
        let pipeline = PortablePipeline::new(device, options, scene.layout())?;
        let work = PortableWorkspace::new(device, Capacity::guess(device, scene.len(), 1))?;
        Ok(Self { pipeline, scene, work })
    }

    /// Blend dispatches that a longest tile list of this length takes.
    pub fn passes(&self, longest_list: u32) -> u32 {
        self.pipeline.passes(longest_list)
    }

    /// Marks the Gaussians that may touch the image.
    pub fn cull(&self, cmd: &mut Commands, camera: &Camera) {
        self.pipeline.cull(cmd, self.scene, self.pipeline.view(camera), &self.work);
    }

    /// Writes the ids of the marked Gaussians, in order.
    pub fn compact(&self, cmd: &mut Commands) {
        self.pipeline.compact(cmd, self.scene, &self.work);
    }

    /// Projects the visible Gaussians to splats, depth keys and tiles.
    pub fn project(&self, cmd: &mut Commands, camera: &Camera) {
        let keys = self.pipeline.depth_keys(self.scene, camera);
        self.pipeline.project(cmd, self.scene, self.pipeline.view(camera), &self.work, keys);
    }

    /// Sorts the splats by depth. Returns the splats in this order.
    pub fn sort_depths(&self, cmd: &mut Commands, camera: &Camera) -> &Buffer<u32> {
        let bits = self.pipeline.depth_keys(self.scene, camera).bits;
        &self.work.depths.values[self.pipeline.sort_depths(cmd, &self.work, bits)]
    }

    /// Finds where the instances of each splat begin, splats in the order of `splat_from_rank`.
    pub fn scan(&self, cmd: &mut Commands, splat_from_rank: &Buffer<u32>) {
        self.pipeline.scan(cmd, &self.work, splat_from_rank);
    }

    /// Counts the instances and sets the dispatches over them, without a scan.
    pub fn scan_totals(&self, cmd: &mut Commands) {
        self.pipeline.scan_totals(cmd, &self.work);
    }

    /// Writes tile and splat of every instance, in the order of the splats.
    pub fn duplicate(&self, cmd: &mut Commands, splat_from_rank: &Buffer<u32>, tiles_x: u32) {
        self.pipeline.duplicate(cmd, &self.work, splat_from_rank, tiles_x);
    }

    /// Sorts the instances by tile, stably. Returns their tile keys and splats.
    pub fn sort_tiles(&self, cmd: &mut Commands, tiles: u32) -> [&Buffer<u32>; 2] {
        let (instances, sorted) = (&self.work.instances, self.pipeline.sort_tiles(cmd, &self.work, tiles));
        [&instances.keys[sorted], &instances.values[sorted]]
    }

    /// Finds where each tile's list begins and ends.
    pub fn ranges(&self, cmd: &mut Commands, tile_keys: &Buffer<u32>) {
        self.pipeline.ranges(cmd, &self.work, tile_keys);
    }

    /// Blends every tile's list of `splat_ids`, tiles with the longest lists first.
    pub fn blend(&self, cmd: &mut Commands, camera: &Camera, splat_ids: &Buffer<u32>, target: Target, passes: u32) {
        self.pipeline.order_tiles(cmd, &self.work, tiles(camera.size_px).iter().product());
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        let shot = Shot::new(self.scene, camera);
        self.pipeline.blend(cmd, shot, &self.work, splat_ids, target, passes);
    }
}
