//! The stages that draw along rays, and the frame that they make with those of the portable path.

use std::mem::offset_of;

use anyhow::Result;

use super::tables::RayTables;
use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Stage};
use crate::options::Options;
use crate::packing::Layout;
use crate::render::constants::shared;
use crate::render::frame::{DepthKeys, Shot, SubgroupLimits, Target, Variation, footprint_code, tiles};
use crate::render::portable::{Pass, PortablePipeline, PortableWorkspace, Walk, chunks, unlisted};
use crate::render::shaders::rays::*;
use crate::render::shaders::{PortableDispatches, RaySplat, SharedConstants, Totals};
use crate::rules::{Footprint, Order, Rules};

/// The stages of a frame along rays, for one set of options and one layout of a scene.
pub struct RaysPipeline {
    options: Options,
    cull: Stage<Cull>,
    project: Stage<Project>,
    list: Stage<List>,
    blend: Blends,
}

/// The first of each pair begins pixels, the second resumes them.
enum Blends {
    Plain([Stage<Blend>; 2]),
    Certified([Stage<BlendCertified>; 2]),
}

/// A frame: what it shows, its tables and its buffers.
#[derive(Clone, Copy)]
pub struct RaysFrame<'f> {
    pub shot: Shot<'f>,
    pub tables: &'f RayTables,
    /// Without splats and spans.
    pub work: &'f PortableWorkspace,
    pub splats: &'f Buffer<RaySplat>,
}

/// Keys of z for a parallel lens, of distances for others.
pub fn depth_keys(Shot { scene, camera, .. }: Shot, options: &Options) -> DepthKeys {
    let order = if camera.is_parallel() { Order::Depth } else { Order::Distance };
    let options = Options { rules: Rules { order, ..options.rules }, ..*options };
    DepthKeys::of(camera, &options, &scene.extent)
}

impl RaysPipeline {
    /// Builds the stages.
    ///
    /// # Errors
    /// If a pipeline cannot be made.
    pub fn new(device: &Device, options: &Options, layout: &Layout, variation: Variation) -> Result<Self> {
        let subgroups = SubgroupLimits::of(device, options);
        let constants = shared(options, layout, 32 * subgroups.ballot_words);
        let (listed_alpha, footprint) = match variation.listing(&options.rules) {
            // Rays know no squares on the screen.
            (alpha, Footprint::ThreeSigmaSquares) => (alpha, Footprint::ThreeSigma),
            other => other,
        };
        let listing = SharedConstants { alpha_min: listed_alpha, extent: footprint_code(footprint), ..constants };
        let count = variation == Variation::Counting;
        let plain = |resume| {
            let cull_pixel_blocks = !options.portable;
            Stage::new(device, &BlendConstants { cull_pixel_blocks, resume, count, ..BlendConstants::of(&listing) })
        };
        let certified =
            |resume| Stage::new(device, &BlendCertifiedConstants { resume, ..BlendCertifiedConstants::of(&constants) });
        let blend = match variation {
            Variation::Certifying => Blends::Certified([certified(false)?, certified(true)?]),
            Variation::Plain | Variation::Counting => Blends::Plain([plain(false)?, plain(true)?]),
        };
        Ok(Self {
            options: *options,
            cull: Stage::new(device, &())?,
            project: Stage::new(device, &ProjectConstants::of(&listing))?,
            list: Stage::new(device, &ListConstants::of(&listing))?,
            blend,
        })
    }

    /// Records one frame, like [`PortablePipeline::record`], whose stages `portable` are used between these.
    pub fn record(
        &self,
        cmd: &mut Commands,
        portable: &PortablePipeline,
        frame: RaysFrame,
        target: Target,
        passes: u32,
    ) {
        self.record_splats(cmd, portable, frame);
        let splat_ids = self.record_lists(cmd, portable, frame);
        cmd.scope("blend", |cmd| self.blend(cmd, portable, frame, splat_ids, target, passes));
    }

    /// Records the stages up to the projection.
    pub fn record_splats(&self, cmd: &mut Commands, portable: &PortablePipeline, frame: RaysFrame) {
        let RaysFrame { shot, work, .. } = frame;
        portable.check(shot.scene);
        portable.clear(cmd, work);
        cmd.scope("cull", |cmd| {
            self.cull(cmd, frame);
            cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
            portable.compact(cmd, shot.scene, work);
        });
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER | Access::INDIRECT);
        cmd.scope("project", |cmd| self.project(cmd, frame));
    }

    /// Records the stages that list the splats of [`record_splats`](Self::record_splats) in tiles, by depth. Returns
    /// the lists.
    pub fn record_lists<'f>(
        &self,
        cmd: &mut Commands,
        portable: &PortablePipeline,
        frame: RaysFrame<'f>,
    ) -> &'f Buffer<u32> {
        let work = frame.work;
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        let bits = depth_keys(frame.shot, &self.options).bits;
        let by_depth = cmd.scope("sort depths", |cmd| portable.sort_depths(cmd, work, bits));
        let splat_from_rank = &work.depths.values[by_depth];
        cmd.scope("scan", |cmd| portable.scan(cmd, work, splat_from_rank));
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER | Access::INDIRECT);
        cmd.scope("list", |cmd| self.list(cmd, frame, splat_from_rank));
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        portable.sort_lists(cmd, frame.shot, work)
    }

    /// The fewest bytes that each stage moves through device memory, as [`PortablePipeline::least_bytes`].
    pub fn least_bytes(
        &self,
        portable: &PortablePipeline,
        frame: RaysFrame,
        totals: &Totals,
    ) -> Vec<(&'static str, u64)> {
        let RaysFrame { shot, .. } = frame;
        let scene = shot.scene;
        let [visible, instances] = [totals.visible_kept, totals.listed_kept].map(u64::from);
        let pixels: u64 = shot.size().iter().map(|side| u64::from(*side)).product();
        let splat = size_of::<RaySplat>() as u64;
        let mut stages = portable.least_bytes(frame.shot, totals);
        for (stage, bytes) in &mut stages {
            match *stage {
                // Id and Gaussian in; splat, depth key and tile count out.
                "project" => *bytes = visible * (4 + scene.bytes_each() + splat + 4 + 4),
                // Order, offset, tile count and splat in; tile key and splat out.
                "duplicate" => (*stage, *bytes) = ("list", visible * (4 + 4 + 4 + splat) + 8 * instances),
                // Ids in; every splat in once; the rays in; the image out.
                "blend" => *bytes = 4 * instances + splat * visible + (12 + 16) * pixels,
                _ => {}
            }
        }
        stages
    }

    /// Marks the Gaussians that rays may meet.
    pub fn cull(&self, cmd: &mut Commands, frame: RaysFrame) {
        let RaysFrame { shot, tables, work, .. } = frame;
        let bindings = CullBindings {
            bounds: &shot.scene.bounds,
            visible_masks: &work.visible_masks,
            chunk_counts: &work.chunk_counts,
            cones: &tables.cones,
        };
        let push = CullPush {
            view: shot.view(self.options.rules.near),
            gaussians: shot.scene.len() as u32,
            is_parallel: shot.camera.is_parallel().into(),
            widest: tables.lens.footprints.widest,
            cones: tables.cones.len() as u32,
        };
        cmd.dispatch(&self.cull, bindings, push, DispatchSize::Groups(chunks(shot.scene).into()));
    }

    /// Projects the visible Gaussians, and counts the tiles of each.
    pub fn project(&self, cmd: &mut Commands, frame: RaysFrame) {
        let RaysFrame { shot, tables, work, splats } = frame;
        let bindings = ProjectBindings {
            gaussian_from_splat: &work.gaussian_from_splat,
            bounds: &shot.scene.bounds,
            grids: &shot.scene.grids,
            shapes: shot.scene.shape_planes(),
            sh: shot.scene.sh_planes(),
            splats,
            depth_keys: &work.depths.keys[0],
            tile_counts: &work.tile_counts,
            cones: &tables.cones,
            footprints: &tables.lens.footprints.table,
            totals: &work.totals,
        };
        let keys = depth_keys(shot, &self.options);
        let push = ProjectPush {
            view: shot.view(self.options.rules.near),
            is_parallel: shot.camera.is_parallel().into(),
            cones: tables.cones.len() as u32,
            depth_limit: keys.limit(),
            depth_shift: keys.shift,
            half_sine: tables.lens.footprints.half_sine,
            large: tables.large,
        };
        let groups = offset_of!(PortableDispatches, over_visible);
        cmd.dispatch_indirect(&self.project, bindings, push, &work.dispatches, groups);
    }

    /// Writes tile and splat of every instance, in the order of the splats.
    pub fn list(&self, cmd: &mut Commands, frame: RaysFrame, splat_from_rank: &Buffer<u32>) {
        let RaysFrame { tables, work, splats, .. } = frame;
        let bindings = ListBindings {
            totals: &work.totals,
            splat_from_rank,
            instance_offsets: &work.instance_offsets,
            tile_counts: &work.tile_counts,
            splats,
            cones: &tables.cones,
            tile_keys: &work.instances.keys[0],
            splat_ids: &work.instances.values[0],
        };
        let push = ListPush { cones: tables.cones.len() as u32, large: tables.large };
        let groups = offset_of!(PortableDispatches, over_visible);
        cmd.dispatch_indirect(&self.list, bindings, push, &work.dispatches, groups);
    }

    /// Blends every tile's list of `splat_ids` along the rays of its pixels.
    pub fn blend(
        &self,
        cmd: &mut Commands,
        portable: &PortablePipeline,
        frame: RaysFrame,
        splat_ids: &Buffer<u32>,
        target: Target,
        passes: u32,
    ) {
        let RaysFrame { shot, tables, work, splats } = frame;
        let (image, background) = (target.image, target.background.colour());
        let (ranges, totals, rays, size_px) = (&work.ranges, &work.totals, &tables.lens.rays, image.size());
        let tiles: u32 = tiles(size_px).iter().product();
        let groups = DispatchSize::Groups(tiles.into());
        Walk::whole(passes).record(cmd, portable.blending.entries_per_pass, |cmd, pass| {
            let Pass { stage, begin: pass_begin, limit: pass_limit, last: last_pass } = pass;
            match &self.blend {
                Blends::Plain(stages) => {
                    let tiles_by_class = &work.tiles_by_class;
                    let bindings = BlendBindings { ranges, splat_ids, splats, totals, tiles_by_class, image, rays };
                    let push = BlendPush { size_px, tiles, background, pass_begin, pass_limit, last_pass };
                    cmd.dispatch(&stages[stage], bindings, push, groups);
                }
                Blends::Certified(stages) => {
                    let certificate = target.certificate.expect("a certifying renderer is given an image for it");
                    let bindings =
                        BlendCertifiedBindings { ranges, splat_ids, splats, totals, image, certificate, rays };
                    let unlisted = unlisted(shot.scene, background);
                    let push =
                        BlendCertifiedPush { size_px, tiles, background, pass_begin, pass_limit, last_pass, unlisted };
                    cmd.dispatch(&stages[stage], bindings, push, groups);
                }
            }
        });
    }
}
