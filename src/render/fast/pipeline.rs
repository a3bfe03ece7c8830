//! The pipelines of the fast path and the frame that they draw, one method per stage.
//!
//! The structure is that of HiGS (two scales of tiles). It differs in how lists keep one order in every run.

use std::mem::offset_of;

use anyhow::Result;

use super::denormals::flushes_denormals;
use super::grid::BinGrid;
use super::stages::{self, BLOCK_FORMS, blend_constants, sort_constants};
use super::workspace::{FastWorkspace, bin_chunks};
use crate::gpu::{Access, Commands, Device, DispatchSize, Shader, Stage};
use crate::options::Options;
use crate::packing::Layout;
use crate::render::constants::{are_drawn_alike, shared};
use crate::render::frame::{DepthKeys, Shot, Target};
use crate::render::shaders::fast::*;
use crate::render::shaders::{Bin, FastDispatches, SharedConstants, Totals};
use crate::rules::{Footprint, Order};
use crate::threads::{self, joined};

/// Pictures with fewer pixels have the lowest blocks, and rings.
const SMALL_PICTURE: u64 = 1 << 20;
/// Pictures with at least this many pixels have the highest blocks.
const LARGE_PICTURE: u64 = 1 << 22;
// A lane of sort loads the starts of four chunk lists.
const _: () = assert!(MAX_BIN_CHUNKS <= 4 * Sort::WORKGROUP[0]);

/// The stages of a fast frame, built for one set of options and one layout of a scene.
pub struct FastPipeline {
    options: Options,
    layout: Layout,
    project: Stage<Project>,
    list: Stage<List>,
    offsets: Stage<Offsets>,
    sort: Stage<Sort>,
    merge_runs: Stage<MergeRuns>,
    merge_pairs: Stage<MergePairs>,
    masks: Stage<Masks>,
    /// One for each of [`BLOCK_FORMS`], made when the first picture needs it.
    blend: [Option<Stage<Blend>>; BLOCK_FORMS.len()],
    constants: SharedConstants,
    subgroup: u32,
    longest_list: u32,
    /// The index in [`BLOCK_FORMS`] of all pictures, if set; otherwise it depends on the size of the picture.
    pub(in crate::render) forced_block_form: Option<usize>,
}

impl FastPipeline {
    /// The size of the subgroups with which it draws; `None` where the device or the options require the portable path.
    pub fn subgroup(device: &Device, options: &Options) -> Option<u32> {
        let rules = &options.rules;
        let is_asked_for = !options.portable && rules.extent == Footprint::Exact && rules.order != Order::PerPixel;
        device.capabilities().fast_subgroup().filter(|_| is_asked_for)
    }

    /// Builds the stages; `None` where the device or the options require the portable path.
    ///
    /// # Errors
    /// If a pipeline cannot be made.
    pub fn new(device: &Device, options: &Options, layout: &Layout) -> Result<Option<Self>> {
        let Some(subgroup) = Self::subgroup(device, options) else { return Ok(None) };
        let mut constants = shared(options, layout, subgroup);
        constants.flushes = constants.compact && flushes_denormals(device)?;
        let sort = sort_constants(&constants, subgroup);
        // A driver compiles on the calling thread.
        threads::scope(|threads| {
            let project = threads.spawn(|| Stage::of_subgroups(device, &ProjectConstants::of(&constants), subgroup))?;
            let list = threads.spawn(|| Stage::of_subgroups(device, &ListConstants::of(&constants), subgroup))?;
            let offsets = threads.spawn(|| Stage::new(device, &()))?;
            let sort = threads.spawn(|| Stage::of_subgroups(device, &sort, subgroup))?;
            let merge_runs = threads.spawn(|| Stage::new(device, &()))?;
            let merge_pairs = threads.spawn(|| Stage::new(device, &()))?;
            let masks = threads.spawn(|| Stage::of_subgroups(device, &MasksConstants::of(&constants), subgroup))?;
            Ok(Some(Self {
                options: *options,
                layout: layout.clone(),
                project: joined(project)?,
                list: joined(list)?,
                offsets: joined(offsets)?,
                sort: joined(sort)?,
                merge_runs: joined(merge_runs)?,
                merge_pairs: joined(merge_pairs)?,
                masks: joined(masks)?,
                blend: Default::default(),
                constants,
                subgroup,
                forced_block_form: None,
                // The loops of one invocation together take at most two iterations per entry of a list.
                longest_list: device.capabilities().loop_limit.map_or(u32::MAX, |limit| limit / 2),
            }))
        })
    }

    /// A fingerprint of all stages, including the blends that the first picture of a size makes.
    ///
    /// # Errors
    /// If a shader cannot be compiled at run time.
    pub fn fingerprint(&self, device: &Device) -> Result<blake3::Hash> {
        stages::fingerprint(device, &self.constants, self.subgroup)
    }

    /// True if it can draw this band of a picture.
    pub(in crate::render) fn takes(&self, shot: Shot, gaussians: usize) -> bool {
        self.grid_of(shot, gaussians).count() <= MAX_BINS
    }

    /// Makes the blend pipeline for pictures of this size.
    ///
    /// # Errors
    /// If the pipeline cannot be made.
    pub fn prepare(&mut self, device: &Device, grid: BinGrid) -> Result<()> {
        let form = grid.form_index;
        let constants = blend_constants(&self.constants, BLOCK_FORMS[form]);
        if self.blend[form].is_none() {
            self.blend[form] = Some(Stage::of_subgroups(device, &constants, self.subgroup)?);
        }
        Ok(())
    }

    /// The indices in [`BLOCK_FORMS`] of the forms that its pictures can have.
    pub fn forms(&self) -> impl Iterator<Item = usize> + use<> {
        let subgroup = self.subgroup;
        (0..BLOCK_FORMS.len()).filter(move |form| BLOCK_FORMS[*form].suits(subgroup))
    }

    /// Makes the blend pipelines for all forms of blocks at the same time.
    ///
    /// # Errors
    /// If a pipeline cannot be made.
    pub fn make_all_blends(&mut self, device: &Device) -> Result<()> {
        let forms = self.forms();
        let Self { constants, subgroup, blend, .. } = self;
        let (constants, subgroup) = (&*constants, *subgroup);
        let make =
            move |form: usize| Stage::of_subgroups(device, &blend_constants(constants, BLOCK_FORMS[form]), subgroup);
        threads::scope(|threads| {
            let making: Vec<_> = forms.map(|form| (form, threads.spawn(move || make(form)))).collect();
            for (form, making) in making {
                blend[form] = Some(joined(making?)?);
            }
            Ok(())
        })
    }

    /// The bins and blocks of a picture of a scene with `gaussians` Gaussians.
    pub fn grid(&self, size_px: [u32; 2], gaussians: usize) -> BinGrid {
        if let Some(form) = self.forced_block_form {
            return BinGrid::new(size_px, form);
        }
        let pixels: u64 = size_px.iter().map(|side| u64::from(*side)).product();
        let is_crowded = gaussians as u64 > 2 * pixels;
        let may_be_low = BLOCK_FORMS[0].suits(self.subgroup);
        let least = match pixels {
            ..SMALL_PICTURE if may_be_low => 0,
            _ if may_be_low && is_crowded => 1,
            ..LARGE_PICTURE => 2,
            _ => 3,
        };
        let fits = |form: &usize| BinGrid::new(size_px, *form).count() <= MAX_BINS;
        BinGrid::new(size_px, (least..3).find(fits).unwrap_or(3))
    }

    /// The bins and blocks of a band. They are those of the whole picture, so that the band has its bits.
    pub(in crate::render) fn grid_of(&self, Shot { camera, band, .. }: Shot, gaussians: usize) -> BinGrid {
        BinGrid::of_band(band, camera.size_px, self.grid(camera.size_px, gaussians).form_index)
    }

    /// The longest list of a bin that it can draw.
    pub fn longest_list(&self) -> u32 {
        self.longest_list
    }

    /// Lists any length from now on, also where loops of `blend` end early: for tests of the other stages.
    #[doc(hidden)]
    pub fn list_any_length(&mut self) {
        self.longest_list = u32::MAX;
    }

    /// The constants and the subgroup size of its stages.
    pub(in crate::render) fn constants(&self) -> (&SharedConstants, u32) {
        (&self.constants, self.subgroup)
    }

    /// 16-byte elements of a splat's record.
    pub fn splat_elements(&self) -> usize {
        if self.layout.is_compact(&self.options) { 2 } else { 3 }
    }

    /// Records one frame: `target` shows `shot` if the capacity of `work` is enough for the counts in
    /// `work.totals`.
    ///
    /// # Panics
    /// If the scene has another layout than the pipeline was built for or is culled by a higher threshold, or if
    /// [`prepare`](Self::prepare) was not called for this size.
    pub fn record(&self, cmd: &mut Commands, shot: Shot, work: &FastWorkspace, target: Target) {
        let scene = shot.scene;
        assert!(
            are_drawn_alike(&self.options, [&scene.layout, &self.layout]),
            "a renderer draws scenes of the layout it was built for"
        );
        let drawn_alpha = self.options.rules.alpha_min;
        assert!(scene.alpha_min <= drawn_alpha, "a scene is culled by no higher threshold than it is drawn by");
        let grid = self.grid_of(shot, scene.len());
        cmd.scope("project", |cmd| self.project(cmd, shot, work, grid));
        self.record_projected(cmd, work, grid, target);
    }

    /// Records the stages after the projection.
    pub(in crate::render) fn record_projected(
        &self,
        cmd: &mut Commands,
        work: &FastWorkspace,
        grid: BinGrid,
        target: Target,
    ) {
        between_stages(cmd);
        cmd.scope("list", |cmd| self.list(cmd, work, grid));
        between_stages(cmd);
        self.sort_lists(cmd, work, grid);
        between_stages(cmd);
        cmd.scope("blend", |cmd| self.blend(cmd, work, grid, target));
    }

    /// Records the stages from lists to sorted lists with masks.
    pub(in crate::render) fn sort_lists(&self, cmd: &mut Commands, work: &FastWorkspace, grid: BinGrid) {
        self.order_lists(cmd, work, grid);
        between_stages(cmd);
        cmd.scope("masks", |cmd| self.masks(cmd, work, grid));
    }

    /// Records the stages from lists to sorted lists.
    pub(in crate::render) fn order_lists(&self, cmd: &mut Commands, work: &FastWorkspace, grid: BinGrid) {
        cmd.scope("offsets", |cmd| self.offsets(cmd, work, grid));
        between_stages(cmd);
        cmd.scope("sort", |cmd| self.sort(cmd, work, grid));
        between_stages(cmd);
        cmd.scope("merge", |cmd| self.merge(cmd, work));
    }

    /// The fewest bytes that each stage moves through device memory: each input read once, each output written once.
    pub fn least_bytes(&self, shot: Shot, totals: &Totals) -> Vec<(&'static str, u64)> {
        let scene = shot.scene;
        let [visible, spans, entries] = [totals.visible_kept, totals.spans, totals.listed_kept].map(u64::from);
        let grid = self.grid_of(shot, scene.len());
        let bins = u64::from(grid.count());
        let pixels: u64 = shot.size().iter().map(|side| u64::from(*side)).product();
        let splat = 16 * self.splat_elements() as u64;
        // Of a scene in pages, at least the visible Gaussians are read.
        let gaussians = if scene.is_paged() { visible } else { scene.len() as u64 };
        let (bounds, key, id) = (16, 4, 4);
        let walk = 8 * visible + 4 * spans; // span ranges and spans
        let chunk_lists = u64::from(bin_chunks(totals.visible_kept, grid)) * 4 * (bins + 1);
        // Only lists of several runs are merged. The totals have the longest only, so others are left out.
        let merged = if totals.longest_list > BIN_RUN { u64::from(totals.longest_list) } else { 0 };
        vec![
            // Bounds of all Gaussians in, other attributes of visible ones; splat, id, key and spans out.
            ("project", bounds * gaussians + visible * (scene.bytes_each() - bounds + splat + id + key) + walk),
            // The starts of chunk lists, the splat of every entry out.
            ("list", walk + chunk_lists + id * entries),
            // Counts in; zeros in their place, bins, their order, the dispatches out.
            ("offsets", bins * (4 + 4 + size_of::<Bin>() as u64 + 4) + size_of::<FastDispatches>() as u64),
            // The splats of entries and depth keys in, each key once; the splats out again.
            ("sort", (id + id) * entries + key * visible),
            ("merge", (8 + 4) * merged),
            // Splat ids and the shapes of splats in; a word of block masks per entry out.
            ("masks", (id + 4) * entries + 32 * visible),
            // Ids, masks and splats in, each splat once; the image out.
            ("blend", (id + 4) * entries + splat * visible + 16 * pixels),
        ]
    }

    /// Projects the Gaussians that may touch the image, and finds the bins of each splat, as one span per row of bins.
    pub fn project(&self, cmd: &mut Commands, shot: Shot, work: &FastWorkspace, grid: BinGrid) {
        let scene = shot.scene;
        let keys = DepthKeys::of(shot.camera, &self.options, &scene.extent);
        let bindings = ProjectBindings {
            bounds: &scene.bounds,
            grids: &scene.grids,
            shapes: scene.shape_planes(),
            sh: scene.sh_planes(),
            gaussian_from_splat: &work.gaussian_from_splat,
            splats: &work.splats,
            depth_keys: &work.depth_keys,
            span_ranges: &work.span_ranges,
            spans: &work.spans,
            counters: &work.counters,
        };
        let push = ProjectPush {
            view: shot.view(self.options.rules.near),
            gaussians: scene.len() as u32,
            visible_capacity: work.visible_capacity(),
            span_capacity: work.spans.len() as u32,
            depth_limit: keys.limit(),
            depth_shift: keys.shift,
            block_height: grid.block_height,
        };
        let groups = scene.len().div_ceil(PROJECT_CHUNK as usize) as u64;
        cmd.dispatch(&self.project, bindings, push, DispatchSize::Groups(groups));
    }

    /// Writes the splat of every entry, chunk by chunk, and counts the splats of every bin.
    pub fn list(&self, cmd: &mut Commands, work: &FastWorkspace, grid: BinGrid) {
        let bindings = ListBindings {
            counters: &work.counters,
            span_ranges: &work.span_ranges,
            spans: &work.spans,
            listed_in_bins: &work.listed_in_bins,
            list_starts: &work.list_starts,
            unsorted: &work.unsorted,
        };
        let push = ListPush {
            bins_x: grid.bins[0],
            bins: grid.count(),
            visible_capacity: work.visible_capacity(),
            entry_capacity: work.entry_capacity(),
        };
        cmd.dispatch(&self.list, bindings, push, DispatchSize::Groups(work.bin_chunks(grid).into()));
    }

    /// Finds the begin of each bin's list, and the dispatches over runs and segments.
    pub fn offsets(&self, cmd: &mut Commands, work: &FastWorkspace, grid: BinGrid) {
        let bindings = OffsetsBindings {
            totals: &work.totals,
            listed_in_bins: &work.listed_in_bins,
            bins: &work.bins,
            bin_order: &work.bin_order,
            run_bins: &work.run_bins,
            segment_bins: &work.segment_bins,
            dispatches: &work.dispatches,
            counters: &work.counters,
        };
        let push = OffsetsPush {
            bins: grid.count(),
            visible_capacity: work.visible_capacity(),
            span_capacity: work.spans.len() as u32,
            entry_capacity: work.entry_capacity(),
            // A longer list is cut into slabs, and must not be drawn in part.
            longest_list: work.longest_list().min(self.longest_list),
        };
        cmd.dispatch(&self.offsets, bindings, push, DispatchSize::Groups(1));
    }

    /// Sorts every run by depth, then by Gaussian.
    pub fn sort(&self, cmd: &mut Commands, work: &FastWorkspace, grid: BinGrid) {
        let bindings = SortBindings {
            run_bins: &work.run_bins,
            bins: &work.bins,
            gaussian_from_splat: &work.gaussian_from_splat,
            depth_keys: &work.depth_keys,
            entries: &work.entries,
            splat_ids: &work.splat_ids,
            dispatches: &work.dispatches,
            list_starts: &work.list_starts,
            unsorted: &work.unsorted,
        };
        let (push, groups) = (SortPush { bins: grid.count() }, offset_of!(FastDispatches, over_runs));
        cmd.dispatch_indirect(&self.sort, bindings, push, &work.dispatches, groups);
    }

    /// Merges the runs of every list that has several: all at once, or in pairs if the workspace is made for that.
    pub fn merge(&self, cmd: &mut Commands, work: &FastWorkspace) {
        if work.pair_merges().next().is_none() {
            self.merge_runs(cmd, work);
        } else {
            self.merge_pairs(cmd, work);
        }
    }

    /// Merges all runs of every list at once.
    pub fn merge_runs(&self, cmd: &mut Commands, work: &FastWorkspace) {
        let FastWorkspace { run_bins, bins, gaussian_from_splat, entries, splat_ids, dispatches, .. } = work;
        let bindings = MergeRunsBindings { run_bins, bins, gaussian_from_splat, entries, splat_ids, dispatches };
        cmd.dispatch_indirect(&self.merge_runs, bindings, (), dispatches, offset_of!(FastDispatches, over_runs));
    }

    /// Merges inputs of lists in pairs, until each list is one.
    pub fn merge_pairs(&self, cmd: &mut Commands, work: &FastWorkspace) {
        let FastWorkspace { run_bins, bins, gaussian_from_splat, splat_ids, dispatches, .. } = work;
        for (input_length, [entries, merged]) in work.pair_merges() {
            if input_length > BIN_RUN {
                between_stages(cmd);
            }
            let bindings =
                MergePairsBindings { run_bins, bins, gaussian_from_splat, entries, splat_ids, dispatches, merged };
            let groups = offset_of!(FastDispatches, over_runs);
            cmd.dispatch_indirect(&self.merge_pairs, bindings, MergePairsPush { input_length }, dispatches, groups);
        }
    }

    /// Marks the blocks of its bin that every entry's splat reaches.
    pub fn masks(&self, cmd: &mut Commands, work: &FastWorkspace, grid: BinGrid) {
        let bindings = MasksBindings {
            segment_bins: &work.segment_bins,
            bins: &work.bins,
            splat_ids: &work.splat_ids,
            splats: &work.splats,
            masks: &work.masks,
            dispatches: &work.dispatches,
        };
        let push = MasksPush { bins_x: grid.bins[0], block_height: grid.block_height, top_px: grid.top_px };
        let groups = offset_of!(FastDispatches, over_segments);
        cmd.dispatch_indirect(&self.masks, bindings, push, &work.dispatches, groups);
    }

    /// Blends every block front to back.
    pub fn blend(&self, cmd: &mut Commands, work: &FastWorkspace, grid: BinGrid, target: Target) {
        let bindings = BlendBindings {
            bins: &work.bins,
            bin_order: &work.bin_order,
            splat_ids: &work.splat_ids,
            splats: &work.splats,
            masks: &work.masks,
            image: target.image,
            depth_keys: &work.depth_keys,
            stop_keys: &work.stop_keys,
        };
        let push = BlendPush {
            size_px: target.image.size(),
            bins_x: grid.bins[0],
            bins: grid.count(),
            background: target.background.colour(),
            top_px: grid.top_px,
        };
        let blend = self.blend[grid.form_index].as_ref().expect("`prepare` made it");
        let lanes = u64::from(grid.count()) * u64::from(BLOCKS * self.subgroup);
        cmd.dispatch(blend, bindings, push, DispatchSize::Invocations(lanes));
    }
}

/// Waits for the buffers and the dispatches that a stage wrote.
pub(in crate::render) fn between_stages(cmd: &mut Commands) {
    cmd.barrier(Access::SHADER_WRITE, Access::SHADER | Access::INDIRECT);
}
