//! The pipelines of the portable path and the frame that they draw, one method per stage.

use std::mem::offset_of;

use anyhow::{Result, ensure};

use super::blend::{Blending, Walk};
use super::sort::{Pairs, RadixSort, SortRange};
use super::workspace::PortableWorkspace;
use crate::camera::Camera;
use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Stage};
use crate::options::Options;
use crate::packing::Layout;
use crate::render::constants::{are_drawn_alike, shared};
use crate::render::frame::{
    DepthKeys, Shot, SubgroupLimits, Target, Variation, drawn_camera, footprint_code, tile_bits, tiles, view,
};
use crate::render::scene::GpuScene;
use crate::render::shaders::portable::*;
use crate::render::shaders::{PortableDispatches, SharedConstants, Totals, View};
use crate::rules::Order;

/// The stages of a portable frame, built for one set of options and one layout of a scene.
pub struct PortablePipeline {
    options: Options,
    layout: Layout,
    /// The least alpha of a listed splat.
    listed_alpha: f32,
    cull: Stage<Cull>,
    cull_offsets: Stage<CullOffsets>,
    cull_compact: Stage<CullCompact>,
    project: Stage<Project>,
    /// The constants of the stages that make splats.
    projecting: SharedConstants,
    sort: RadixSort,
    scan_sums: Stage<ScanSums>,
    scan_totals: Stage<ScanTotals>,
    scan: Stage<Scan>,
    duplicate: Stage<Duplicate>,
    ranges: Stage<Ranges>,
    tile_order: Stage<TileOrder>,
    pub(in crate::render) blending: Blending,
}

impl PortablePipeline {
    /// Builds the stages that only draw.
    ///
    /// # Errors
    /// As [`varied`](Self::varied).
    pub fn new(device: &Device, options: &Options, layout: &Layout) -> Result<Self> {
        Self::varied(device, options, layout, Variation::default())
    }

    /// Builds the stages of a variation.
    ///
    /// # Errors
    /// If only the reference draws by these options, or a pipeline cannot be made.
    pub fn varied(device: &Device, options: &Options, layout: &Layout, variation: Variation) -> Result<Self> {
        let rules = &options.rules;
        ensure!(rules.order != Order::PerPixel, "only the reference sorts the splats of every pixel on its own");
        let subgroups = SubgroupLimits::of(device, options);
        let constants = shared(options, layout, 32 * subgroups.ballot_words);
        let (listed_alpha, footprint) = variation.listing(rules);
        let projecting = SharedConstants { alpha_min: listed_alpha, extent: footprint_code(footprint), ..constants };
        Ok(Self {
            options: *options,
            layout: layout.clone(),
            listed_alpha,
            cull: Stage::new(device, &())?,
            cull_offsets: Stage::new(device, &())?,
            cull_compact: Stage::new(device, &())?,
            project: Stage::new(device, &ProjectConstants::of(&projecting))?,
            projecting,
            sort: RadixSort::new(device, subgroups.smallest, subgroups.ballot_words)?,
            scan_sums: Stage::new(device, &())?,
            scan_totals: Stage::new(device, &())?,
            scan: Stage::new(device, &())?,
            duplicate: Stage::new(device, &())?,
            ranges: Stage::new(device, &())?,
            tile_order: Stage::new(device, &())?,
            blending: Blending::new(device, options, variation, &constants, subgroups)?,
        })
    }

    /// The constants of the stages that make splats.
    pub(in crate::render) fn projecting(&self) -> &SharedConstants {
        &self.projecting
    }

    /// The number of blend dispatches for a longest tile list of this length.
    pub fn passes(&self, longest_list: u32) -> u32 {
        self.blending.passes(longest_list)
    }

    /// The longest tile list that this number of blend dispatches finishes.
    pub(in crate::render) fn longest_list(&self, passes: u32) -> u32 {
        self.blending.longest_list(passes)
    }

    /// The numbers of passes of a frame's sort by depth, and of its sort by tile.
    pub fn sort_passes(&self, scene: &GpuScene, camera: &Camera) -> [u32; 2] {
        let depth_bits = self.depth_keys(scene, camera).bits;
        [depth_bits, tile_bits(tiles(camera.size_px).iter().product())].map(|bits| self.sort.passes(bits))
    }

    pub(in crate::render) fn depth_keys(&self, scene: &GpuScene, camera: &Camera) -> DepthKeys {
        DepthKeys::of(camera, &self.options, &scene.extent)
    }

    pub(in crate::render) fn view(&self, camera: &Camera) -> View {
        view(camera, self.options.rules.near)
    }

    /// The view of a camera at the size at which its pictures are drawn.
    pub(in crate::render) fn sampled_view(&self, camera: &Camera) -> View {
        self.view(&drawn_camera(&self.options, camera))
    }

    /// Records one frame: `target` shows `shot` if the capacity of `work` and the blend dispatches (`passes`) were
    /// enough for the counts in `work.totals`.
    ///
    /// # Panics
    /// If the scene has another layout than the pipeline was built for or is culled by a higher threshold, or if a
    /// certifying pipeline is given no image for the certificate.
    pub fn record(&self, cmd: &mut Commands, shot: Shot, work: &PortableWorkspace, target: Target, passes: u32) {
        let view = shot.view(self.options.rules.near);
        self.clear(cmd, work);
        cmd.scope("cull", |cmd| {
            self.cull(cmd, shot.scene, view, work);
            cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
            self.compact(cmd, shot.scene, work);
        });
        self.project_visible(cmd, shot, view, work);
        let splat_ids = self.bin(cmd, shot, work);
        cmd.scope("blend", |cmd| self.blend(cmd, shot, work, splat_ids, target, passes));
    }

    /// Clears the buffers that the stages count into.
    pub(in crate::render) fn clear(&self, cmd: &mut Commands, work: &PortableWorkspace) {
        cmd.scope("clear", |cmd| {
            cmd.fill(&work.totals, 0);
            cmd.fill(&work.ranges, 0);
        });
        cmd.barrier(Access::COPY_WRITE, Access::SHADER);
    }

    /// # Panics
    /// If the scene has another layout, or is culled by a higher threshold than it is drawn by.
    pub(in crate::render) fn check(&self, scene: &GpuScene) {
        assert!(
            are_drawn_alike(&self.options, [&scene.layout, &self.layout]),
            "a renderer draws scenes of the layout it was built for"
        );
        assert!(scene.alpha_min <= self.listed_alpha, "a scene is culled by no higher threshold than it is drawn by");
    }

    /// Projects the Gaussians that were culled and compacted to splats.
    pub(in crate::render) fn project_visible(
        &self,
        cmd: &mut Commands,
        shot: Shot,
        view: View,
        work: &PortableWorkspace,
    ) {
        let Shot { scene, camera, .. } = shot;
        self.check(scene);
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER | Access::INDIRECT);
        cmd.scope("project", |cmd| self.project(cmd, scene, view, work, self.depth_keys(scene, camera)));
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
    }

    /// Makes the list of every tile from the splats. Returns the splats of all lists, tile after tile.
    pub(in crate::render) fn bin<'w>(
        &self,
        cmd: &mut Commands,
        shot: Shot,
        work: &'w PortableWorkspace,
    ) -> &'w Buffer<u32> {
        let bits = self.depth_keys(shot.scene, shot.camera).bits;
        let by_depth = cmd.scope("sort depths", |cmd| self.sort_depths(cmd, work, bits));
        self.list(cmd, shot, work, by_depth)
    }

    /// Makes the lists like [`bin`](Self::bin), from splats that are sorted by depth: `by_depth` is the index of the
    /// sorted pair.
    pub(in crate::render) fn list<'w>(
        &self,
        cmd: &mut Commands,
        shot: Shot,
        work: &'w PortableWorkspace,
        by_depth: usize,
    ) -> &'w Buffer<u32> {
        let splat_from_rank = &work.depths.values[by_depth];
        cmd.scope("scan", |cmd| self.scan(cmd, work, splat_from_rank));
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER | Access::INDIRECT);
        cmd.scope("duplicate", |cmd| self.duplicate(cmd, work, splat_from_rank, tiles(shot.size())[0]));
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        self.sort_lists(cmd, shot, work)
    }

    /// Sorts the instances by tile, and finds and orders the lists. Returns the splats of all lists, tile after tile.
    pub(in crate::render) fn sort_lists<'w>(
        &self,
        cmd: &mut Commands,
        shot: Shot,
        work: &'w PortableWorkspace,
    ) -> &'w Buffer<u32> {
        let tiles = shot.tiles();
        let by_tile = cmd.scope("sort tiles", |cmd| self.sort_tiles(cmd, work, tiles));
        cmd.scope("ranges", |cmd| {
            self.ranges(cmd, work, &work.instances.keys[by_tile]);
            cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
            self.order_tiles(cmd, work, tiles);
        });
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        &work.instances.values[by_tile]
    }

    /// The splats of all `tiles`, tile after tile, of the frame that `work` holds.
    pub(in crate::render) fn splat_ids<'w>(&self, work: &'w PortableWorkspace, tiles: u32) -> &'w Buffer<u32> {
        &work.instances.values[self.sort.sorted(tile_bits(tiles))]
    }

    /// Marks the Gaussians that may touch the image.
    pub(in crate::render) fn cull(&self, cmd: &mut Commands, scene: &GpuScene, view: View, work: &PortableWorkspace) {
        let bindings = CullBindings {
            bounds: &scene.bounds,
            visible_masks: &work.visible_masks,
            chunk_counts: &work.chunk_counts,
        };
        let push = CullPush { view, gaussians: scene.len() as u32 };
        cmd.dispatch(&self.cull, bindings, push, DispatchSize::Groups(chunks(scene).into()));
    }

    /// Writes the ids of the marked Gaussians, in order.
    pub(in crate::render) fn compact(&self, cmd: &mut Commands, scene: &GpuScene, work: &PortableWorkspace) {
        self.compact_chunks(cmd, chunks(scene), work);
    }

    /// Writes the ids of the marked Gaussians of the first `chunks` chunks, in order.
    pub(in crate::render) fn compact_chunks(&self, cmd: &mut Commands, chunks: u32, work: &PortableWorkspace) {
        let visible_capacity = work.gaussian_from_splat.len() as u32;
        let bindings =
            CullOffsetsBindings { sums: &work.chunk_counts, totals: &work.totals, dispatches: &work.dispatches };
        cmd.dispatch(
            &self.cull_offsets,
            bindings,
            CullOffsetsPush { chunks, visible_capacity },
            DispatchSize::Groups(1),
        );
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        let bindings = CullCompactBindings {
            visible_masks: &work.visible_masks,
            chunk_offsets: &work.chunk_counts,
            gaussian_from_splat: &work.gaussian_from_splat,
        };
        let push = CullCompactPush { chunks, visible_capacity };
        cmd.dispatch(&self.cull_compact, bindings, push, DispatchSize::Groups(chunks.into()));
    }

    /// Projects the visible Gaussians to splats, depth keys and tiles.
    pub(in crate::render) fn project(
        &self,
        cmd: &mut Commands,
        scene: &GpuScene,
        view: View,
        work: &PortableWorkspace,
        keys: DepthKeys,
    ) {
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
            depth_limit: keys.limit(),
            depth_shift: keys.shift,
        };
        cmd.dispatch_indirect(
            &self.project,
            bindings,
            push,
            &work.dispatches,
            offset_of!(PortableDispatches, over_visible),
        );
    }

    /// Sorts the splats by depth; returns the index of the sorted pair of `work.depths`.
    pub(in crate::render) fn sort_depths(&self, cmd: &mut Commands, work: &PortableWorkspace, bits: u32) -> usize {
        self.sort_visible(cmd, &work.depths, work, bits, true)
    }

    /// Sorts pairs, one for each splat, by `bits` bits of their keys; returns the index of the sorted pair.
    pub(in crate::render) fn sort_visible(
        &self,
        cmd: &mut Commands,
        pairs: &Pairs,
        work: &PortableWorkspace,
        bits: u32,
        values_are_indices: bool,
    ) -> usize {
        let (lengths, length_index) = (&work.totals.words(), offset_of!(Totals, visible_kept) / 4);
        let range = SortRange { lengths, length_index, bits, values_are_indices };
        let groups = (&work.dispatches, offset_of!(PortableDispatches, sort_visible));
        self.sort.record(cmd, pairs, &work.sort, range, groups)
    }

    /// Finds the begin of the instances of each splat, splats in the order of `splat_from_rank`.
    pub(in crate::render) fn scan(&self, cmd: &mut Commands, work: &PortableWorkspace, splat_from_rank: &Buffer<u32>) {
        let (totals, tile_counts) = (&work.totals, &work.tile_counts);
        let groups = offset_of!(PortableDispatches, scan_visible);
        let bindings = ScanSumsBindings { totals, splat_from_rank, tile_counts, sums: &work.scan_sums };
        cmd.dispatch_indirect(&self.scan_sums, bindings, (), &work.dispatches, groups);
        // scan_totals writes the buffer that scan_sums was dispatched from.
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

    /// Counts the instances and sets the dispatches over them.
    pub(in crate::render) fn scan_totals(&self, cmd: &mut Commands, work: &PortableWorkspace) {
        let bindings = ScanTotalsBindings { sums: &work.scan_sums, totals: &work.totals, dispatches: &work.dispatches };
        let push = ScanTotalsPush { instance_capacity: work.instances.keys[0].len() as u32 };
        cmd.dispatch(&self.scan_totals, bindings, push, DispatchSize::Groups(1));
    }

    /// Writes tile and splat of every instance, in the order of the splats.
    pub(in crate::render) fn duplicate(
        &self,
        cmd: &mut Commands,
        work: &PortableWorkspace,
        splat_from_rank: &Buffer<u32>,
        tiles_x: u32,
    ) {
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

    /// Sorts the instances by tile, stably; returns the index of the sorted pair of `work.instances`.
    pub(in crate::render) fn sort_tiles(&self, cmd: &mut Commands, work: &PortableWorkspace, tiles: u32) -> usize {
        let (lengths, length_index) = (&work.totals.words(), offset_of!(Totals, listed_kept) / 4);
        let range = SortRange { lengths, length_index, bits: tile_bits(tiles), values_are_indices: false };
        let groups = (&work.dispatches, offset_of!(PortableDispatches, sort_instances));
        self.sort.record(cmd, &work.instances, &work.sort, range, groups)
    }

    /// Finds the begin and the end of each tile's list.
    pub(in crate::render) fn ranges(&self, cmd: &mut Commands, work: &PortableWorkspace, tile_keys: &Buffer<u32>) {
        let bindings = RangesBindings { totals: &work.totals, tile_keys, ranges: &work.ranges };
        let groups = offset_of!(PortableDispatches, over_instances);
        cmd.dispatch_indirect(&self.ranges, bindings, (), &work.dispatches, groups);
    }

    /// Orders tiles by the length of their list, the longest first.
    pub(in crate::render) fn order_tiles(&self, cmd: &mut Commands, work: &PortableWorkspace, tiles: u32) {
        let bindings =
            TileOrderBindings { ranges: &work.ranges, tiles_by_class: &work.tiles_by_class, totals: &work.totals };
        cmd.dispatch(&self.tile_order, bindings, TileOrderPush { tiles }, DispatchSize::Invocations(tiles.into()));
    }

    /// Blends every tile's list of `splat_ids`.
    pub(in crate::render) fn blend(
        &self,
        cmd: &mut Commands,
        shot: Shot,
        work: &PortableWorkspace,
        splat_ids: &Buffer<u32>,
        target: Target,
        passes: u32,
    ) {
        self.blending.record(cmd, shot, work, splat_ids, target, Walk::whole(passes));
    }
}

/// The number of workgroups that cull the scene.
pub(in crate::render) fn chunks(scene: &GpuScene) -> u32 {
    scene.len().div_ceil(CULL_CHUNK as usize) as u32
}
