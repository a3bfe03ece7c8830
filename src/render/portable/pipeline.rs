//! The frame, top to bottom.

use std::mem::offset_of;

use anyhow::{Result, ensure};

use crate::render::portable::blend::{Blending, LISTED_ALPHA, Target, Variation, extent_code};
use crate::render::gpu_scene::GpuScene;
use crate::render::inspect::inspector::Inspector;
use crate::render::layout::Layout;
use crate::render::shaders::portable::*;
use crate::render::shaders::*;
use crate::render::portable::sort::{RadixSort, SortRange};
use crate::render::frame::{DepthKeys, tile_bits, tiles, view};
use crate::render::portable::workspace::{CULL_CHUNK, PortableWorkspace};
use crate::camera::Camera;
use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Stage};
use crate::options::{Options};
use crate::rules::{Footprint, Order};

/// The stages of a frame, built for one set of options and one layout of a scene.
pub struct PortablePipeline {
    options: Options,
    layout: Layout,
    /// Splats are listed where their alpha reaches this.
    listed_alpha: f32,
    cull: Stage<Cull>,
    cull_offsets: Stage<CullOffsets>,
    cull_compact: Stage<CullCompact>,
    project: Stage<Project>,
    pub(crate) sort: RadixSort,
    scan_sums: Stage<ScanSums>,
    scan_totals: Stage<ScanTotals>,
    scan: Stage<Scan>,
    duplicate: Stage<Duplicate>,
    ranges: Stage<Ranges>,
    tile_order: Stage<TileOrder>,
    blending: Blending,
}

/// Smallest subgroup that the portable path is built for.
const PORTABLE_SUBGROUP: u32 = 4;

/// The least subgroup size that pipelines may run with, and the words of a ballot of the largest.
pub(super) fn subgroups(device: &Device, options: &Options) -> [u32; 2] {
    let [smallest, largest] = device.facts().subgroup_size;
    if options.portable { [PORTABLE_SUBGROUP, 4] } else { [smallest, largest.div_ceil(32)] }
}

impl PortablePipeline {
    pub fn new(device: &Device, options: &Options, layout: &Layout) -> Result<Self> {
        Self::varied(device, options, layout, Variation::default())
    }

    pub fn varied(device: &Device, options: &Options, layout: &Layout, variation: Variation) -> Result<Self> {
        let rules = &options.rules;
        ensure!(rules.order != Order::PerPixel, "only the reference sorts the splats of every pixel anew");
        let [smallest_subgroup, ballot_words] = subgroups(device, options);
        // Where everything that is left out is to be known, it is listed first.
        let (listed_alpha, extent) = match variation.certifies {
            false => (rules.alpha_min, rules.extent),
            true => (LISTED_ALPHA, Footprint::Exact),
        };
        let project = ProjectConstants {
            sh_degree: layout.sh_degree,
            sh_storage: layout.sh.code(),
            shape_storage: layout.shape.code(),
            by_distance: rules.order == Order::Distance,
            antialiased: rules.antialiased,
            alpha_min: listed_alpha,
            extent: extent_code(extent),
            ballot_words,
        };
        Ok(Self {
            options: *options,
            layout: layout.clone(),
            listed_alpha,
            cull: Stage::new(device, &())?,
            cull_offsets: Stage::new(device, &())?,
            cull_compact: Stage::new(device, &())?,
            project: Stage::new(device, &project)?,
            sort: RadixSort::new(device, smallest_subgroup, ballot_words)?,
            scan_sums: Stage::new(device, &())?,
            scan_totals: Stage::new(device, &())?,
            scan: Stage::new(device, &())?,
            duplicate: Stage::new(device, &())?,
            ranges: Stage::new(device, &())?,
            tile_order: Stage::new(device, &())?,
            blending: Blending::new(device, options, variation, [smallest_subgroup, ballot_words])?,
        })
    }

    /// Blend dispatches that a longest tile list of this length takes.
    pub fn passes(&self, longest_list: u32) -> u32 {
        self.blending.passes(longest_list)
    }

    /// The longest tile list that so many of them finish.
    pub(super) fn longest_list(&self, passes: u32) -> u32 {
        self.blending.longest_list(passes)
    }

    /// Passes over its keys that a frame's sort by depth takes, and its sort by tile.
    pub fn sort_passes(&self, scene: &GpuScene, camera: &Camera) -> [u32; 2] {
        let depth_bits = self.depth_keys(scene, camera).bits;
        [depth_bits, tile_bits(tiles(camera.size_px).iter().product())].map(|bits| self.sort.passes(bits))
    }

    pub(crate) fn depth_keys(&self, scene: &GpuScene, camera: &Camera) -> DepthKeys {
        DepthKeys::of(camera, &self.options, &scene.extent)
    }

    pub(crate) fn view(&self, camera: &Camera) -> View {
        view(camera, self.options.rules.near)
    }

    /// Records one frame: `target` shows the scene seen by `camera`, or what an inspector looks at, if there was room in
    /// `work` and `passes` blend passes were enough; `work.totals` says so.
    pub fn record(
        &self,
        cmd: &mut Commands,
        (scene, camera): (&GpuScene, &Camera),
        work: &PortableWorkspace,
        target: Target,
        passes: u32,
        inspector: Option<&Inspector>,
    ) {
        assert_eq!(scene.layout, self.layout, "a renderer draws scenes of the layout it was built for");
        assert!(scene.alpha_min <= self.listed_alpha, "a scene is culled by no higher threshold than it is drawn by");
        let view = self.view(camera);
        let depth_keys = self.depth_keys(scene, camera);
        let [tiles_x, tiles_y] = tiles(camera.size_px);
        let tiles = tiles_x * tiles_y;

        cmd.scope("clear", |cmd| {
            cmd.fill(&work.totals, 0);
            cmd.fill(&work.ranges, 0);
        });
        cmd.barrier(Access::COPY_WRITE, Access::SHADER);
        cmd.scope("cull", |cmd| {
            let elsewhere = inspector.and_then(Inspector::culled_from);
            let culled_from = elsewhere.map_or(view, |c| self.view(&c.sampled(self.options.drawn_size(c.size_px))));
            self.cull(cmd, scene, culled_from, work);
            cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
            if let Some(inspector) = inspector {
                inspector.narrow(cmd, scene, view, work);
            }
            self.compact(cmd, scene, work);
        });
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER | Access::INDIRECT);
        cmd.scope("project", |cmd| self.project(cmd, scene, view, work, depth_keys));
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        if let Some(inspector) = inspector {
            inspector.recolour(cmd, scene, view, work);
        }
        let by_depth = cmd.scope("sort depths", |cmd| self.sort_depths(cmd, work, depth_keys.bits));
        let splat_from_rank = &work.depths.values[by_depth];
        cmd.scope("scan", |cmd| self.scan(cmd, work, splat_from_rank));
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER | Access::INDIRECT);
        cmd.scope("duplicate", |cmd| self.duplicate(cmd, work, splat_from_rank, tiles_x));
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        let by_tile = cmd.scope("sort tiles", |cmd| self.sort_tiles(cmd, work, tiles));
        cmd.scope("ranges", |cmd| {
            self.ranges(cmd, work, &work.instances.keys[by_tile]);
            cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
            self.order_tiles(cmd, work, tiles);
        });
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        let splat_ids = &work.instances.values[by_tile];
        match inspector {
            Some(inspector) => inspector.draw(cmd, &self.blending, (scene, camera), (work, splat_ids), target, passes),
            None => cmd.scope("blend", |cmd| self.blend(cmd, (scene, camera), work, splat_ids, target, passes)),
        }
    }

    /// Of the frame that `work` holds, the splats of all tiles, tile after tile.
    pub(super) fn splat_ids<'w>(&self, work: &'w PortableWorkspace, camera: &Camera) -> &'w Buffer<u32> {
        &work.instances.values[self.sort.sorted(tile_bits(tiles(camera.size_px).iter().product()))]
    }

    /// Which Gaussians may touch the image.
    pub(crate) fn cull(&self, cmd: &mut Commands, scene: &GpuScene, view: View, work: &PortableWorkspace) {
        let bindings = CullBindings {
            bounds: &scene.bounds,
            visible_masks: &work.visible_masks,
            chunk_counts: &work.chunk_counts,
        };
        let push = CullPush { view, gaussians: scene.len() as u32 };
        cmd.dispatch(&self.cull, bindings, push, DispatchSize::Groups(chunks(scene).into()));
    }

    /// The ids of those.
    pub(crate) fn compact(&self, cmd: &mut Commands, scene: &GpuScene, work: &PortableWorkspace) {
        let (chunks, visible_capacity) = (chunks(scene), work.gaussian_from_splat.len() as u32);
        let bindings =
            CullOffsetsBindings { sums: &work.chunk_counts, totals: &work.totals, dispatches: &work.dispatches };
        cmd.dispatch(&self.cull_offsets, bindings, CullOffsetsPush { chunks, visible_capacity }, DispatchSize::Groups(1));
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        let bindings = CullCompactBindings {
            visible_masks: &work.visible_masks,
            chunk_offsets: &work.chunk_counts,
            gaussian_from_splat: &work.gaussian_from_splat,
        };
        let push = CullCompactPush { chunks, visible_capacity };
        cmd.dispatch(&self.cull_compact, bindings, push, DispatchSize::Groups(chunks.into()));
    }

    /// Their splats, depth keys and tiles.
    pub(crate) fn project(&self, cmd: &mut Commands, scene: &GpuScene, view: View, work: &PortableWorkspace, keys: DepthKeys) {
        let bindings = ProjectBindings {
            gaussian_from_splat: &work.gaussian_from_splat,
            bounds: &scene.bounds,
            grids: &scene.grids,
            shapes: scene.shape_planes(),
            sh: scene.sh_planes(),
            splats: &work.splats,
            depth_keys: &work.depths.keys[0],
            span_ranges: &work.span_ranges,
            tile_counts: &work.tile_counts,
            spans: &work.spans,
            totals: &work.totals,
        };
        let push = ProjectPush {
            view,
            span_capacity: work.spans.len() as u32,
            depth_limit: ((1_u64 << keys.bits) - 1) as u32,
            depth_shift: keys.shift,
        };
        cmd.dispatch_indirect(&self.project, bindings, push, &work.dispatches, offset_of!(PortableDispatches, over_visible));
    }

    /// Sorts the splats by depth; returns which of `work.depths` is sorted.
    pub(crate) fn sort_depths(&self, cmd: &mut Commands, work: &PortableWorkspace, bits: u32) -> usize {
        let (lengths, length_index) = (&work.totals.words(), offset_of!(Totals, visible_kept) / 4);
        let range = SortRange { lengths, length_index, bits, values_are_indices: true };
        let groups = (&work.dispatches, offset_of!(PortableDispatches, sort_visible));
        self.sort.record(cmd, &work.depths, &work.sort, range, groups)
    }

    /// Where the instances of each splat begin, splats in the order of `splat_from_rank`.
    pub(crate) fn scan(&self, cmd: &mut Commands, work: &PortableWorkspace, splat_from_rank: &Buffer<u32>) {
        let (totals, tile_counts) = (&work.totals, &work.tile_counts);
        let groups = offset_of!(PortableDispatches, scan_visible);
        let bindings = ScanSumsBindings { totals, splat_from_rank, tile_counts, sums: &work.scan_sums };
        cmd.dispatch_indirect(&self.scan_sums, bindings, (), &work.dispatches, groups);
        // The totals update the dispatches, which the sums were dispatched by.
        cmd.barrier(Access::SHADER_WRITE | Access::INDIRECT, Access::SHADER);
        self.scan_totals(cmd, work);
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER | Access::INDIRECT);
        let bindings = ScanBindings {
            totals,
            splat_from_rank,
            tile_counts,
            sums: &work.scan_sums,
            instance_offsets: &work.instance_offsets,
            first_ranks: &work.first_ranks,
        };
        cmd.dispatch_indirect(&self.scan, bindings, (), &work.dispatches, groups);
    }

    /// The number of instances, and the dispatches over them.
    pub(crate) fn scan_totals(&self, cmd: &mut Commands, work: &PortableWorkspace) {
        let bindings = ScanTotalsBindings { sums: &work.scan_sums, totals: &work.totals, dispatches: &work.dispatches };
        let push = ScanTotalsPush { instance_capacity: work.instances.keys[0].len() as u32 };
        cmd.dispatch(&self.scan_totals, bindings, push, DispatchSize::Groups(1));
    }

    /// Tile and splat of every instance, in the order of the splats.
    pub(crate) fn duplicate(&self, cmd: &mut Commands, work: &PortableWorkspace, splat_from_rank: &Buffer<u32>, tiles_x: u32) {
        let bindings = DuplicateBindings {
            totals: &work.totals,
            splat_from_rank,
            instance_offsets: &work.instance_offsets,
            first_ranks: &work.first_ranks,
            span_ranges: &work.span_ranges,
            spans: &work.spans,
            tile_keys: &work.instances.keys[0],
            splat_ids: &work.instances.values[0],
        };
        let groups = offset_of!(PortableDispatches, duplicate);
        cmd.dispatch_indirect(&self.duplicate, bindings, DuplicatePush { tiles_x }, &work.dispatches, groups);
    }

    /// Sorts the instances by tile, stably; returns which of `work.instances` is sorted.
    pub(crate) fn sort_tiles(&self, cmd: &mut Commands, work: &PortableWorkspace, tiles: u32) -> usize {
        let (lengths, length_index) = (&work.totals.words(), offset_of!(Totals, listed_kept) / 4);
        let range = SortRange { lengths, length_index, bits: tile_bits(tiles), values_are_indices: false };
        let groups = (&work.dispatches, offset_of!(PortableDispatches, sort_instances));
        self.sort.record(cmd, &work.instances, &work.sort, range, groups)
    }

    /// Where each tile's list begins and ends.
    pub(crate) fn ranges(&self, cmd: &mut Commands, work: &PortableWorkspace, tile_keys: &Buffer<u32>) {
        let bindings = RangesBindings { totals: &work.totals, tile_keys, ranges: &work.ranges };
        let groups = offset_of!(PortableDispatches, over_instances);
        cmd.dispatch_indirect(&self.ranges, bindings, (), &work.dispatches, groups);
    }

    /// Tiles with long lists first.
    pub(crate) fn order_tiles(&self, cmd: &mut Commands, work: &PortableWorkspace, tiles: u32) {
        let bindings =
            TileOrderBindings { ranges: &work.ranges, tiles_by_class: &work.tiles_by_class, totals: &work.totals };
        cmd.dispatch(&self.tile_order, bindings, TileOrderPush { tiles }, DispatchSize::Invocations(tiles.into()));
    }

    /// Blends every tile's list of `splat_ids`.
    pub(crate) fn blend(
        &self,
        cmd: &mut Commands,
        view: (&GpuScene, &Camera),
        work: &PortableWorkspace,
        splat_ids: &Buffer<u32>,
        target: Target,
        passes: u32,
    ) {
        self.blending.record(cmd, view, work, splat_ids, target, passes);
    }
}

/// Workgroups that cull the scene.
pub(super) fn chunks(scene: &GpuScene) -> u32 {
    scene.len().div_ceil(CULL_CHUNK) as u32
}
