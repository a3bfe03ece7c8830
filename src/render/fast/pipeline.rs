//! The fast path: splats are listed and sorted in bins of 8x4 blocks, and blended in blocks of 8 pixels by 4 to 16.
//!
//! The structure is that of HiGS (two scales of tiles); what differs is how lists are kept in one order in every run, and
//! that long lists are neither cut nor composed: a block's splats are blended from the first to the last by one subgroup.

use std::mem::offset_of;

use anyhow::Result;

use crate::render::portable::blend::{Target, extent_code};
use crate::render::fast::workspace::{BIN_CHUNKS, BIN_SHAPE, BLOCK_WIDTH, BLOCKS, FastWorkspace, MAX_BINS, PROJECT_CHUNK};
use crate::render::gpu_scene::GpuScene;
use crate::render::layout::Layout;
use crate::render::shaders::fast::*;
use crate::render::shaders::*;
use crate::render::portable::sort::digit_bits;
use crate::render::frame::{DepthKeys, view};
use crate::camera::Camera;
use crate::gpu::{Access, Commands, Device, DispatchSize, Shader, Stage};
use crate::options::{Options, Storage};
use crate::rules::{Footprint, Order};

/// Heights of blocks, px. Low ones balance small pictures and crowded ones, high ones list fewer splats twice.
pub(super) const BLOCK_HEIGHTS: [u32; 3] = [4, 8, 16];
/// Pixels of a picture up to which its blocks are the lowest.
const SMALL_PICTURE: u64 = 1 << 20;
/// Pixels of a picture from which on its blocks are the highest.
const LARGE_PICTURE: u64 = 1 << 22;

/// The stages of a fast frame.
pub struct FastPipeline {
    options: Options,
    layout: Layout,
    project: Stage<Project>,
    count: Stage<Count>,
    offsets: Stage<Offsets>,
    fill: Stage<Fill>,
    sort: Stage<Sort>,
    /// Of runs, and of what was merged.
    merge: [Stage<Merge>; 2],
    masks: Stage<Masks>,
    /// For every height of blocks; and for long bins.
    blend: [Option<Stage<Blend>>; BLOCK_HEIGHTS.len()],
    blend_long: [Option<Stage<BlendLong>>; BLOCK_HEIGHTS.len()],
    /// Of these, but for the height.
    blend_constants: BlendConstants,
    subgroup: u32,
    longest_list: u32,
    /// Which of [`BLOCK_HEIGHTS`] every picture has, if not its own.
    pub(super) block_height: Option<usize>,
}

impl FastPipeline {
    /// `None` where the device or the options call for the portable path.
    pub fn new(device: &Device, options: &Options, layout: &Layout) -> Result<Option<Self>> {
        let rules = &options.rules;
        let [subgroup, _] = device.facts().subgroup_size;
        let is_asked_for = !options.portable
            && rules.extent == Footprint::Exact
            && rules.order != Order::PerPixel;
        if !is_asked_for || !device.facts().has_fast_path() {
            return Ok(None);
        }
        let (alpha_min, extent, ballot_words) = (rules.alpha_min, extent_code(rules.extent), subgroup.div_ceil(32));
        let compact = is_compact(options);
        let (sh_degree, sh_storage, shape_storage) = (layout.sh_degree, layout.sh.code(), layout.shape.code());
        let project = ProjectConstants {
            sh_degree,
            sh_storage,
            shape_storage,
            by_distance: rules.order == Order::Distance,
            antialiased: rules.antialiased,
            compact,
            alpha_min,
            extent,
            ballot_words,
            ..ProjectConstants::default()
        };
        let subgroups = Sort::WORKGROUP[0] / subgroup;
        let digit_bits = digit_bits(subgroups, 16 << 10);
        let sort = SortConstants { digit_bits, subgroups, ballot_words };
        let merge = |of_runs| Stage::new(device, &MergeConstants { of_runs });
        let blend_constants = BlendConstants {
            subgroup,
            block_height: 0,
            alpha_min,
            extent,
            alpha_max: rules.alpha_max,
            has_clamped_alphas: layout.has_clamped_alphas,
            transmittance_min: rules.transmittance_min,
            stop: options.stop,
            compact,
        };
        Ok(Some(Self {
            options: *options,
            layout: layout.clone(),
            project: Stage::new(device, &project)?,
            count: Stage::new(device, &CountConstants { subgroup })?,
            offsets: Stage::new(device, &())?,
            fill: Stage::new(device, &FillConstants { subgroup })?,
            sort: Stage::new(device, &sort)?,
            merge: [merge(true)?, merge(false)?],
            masks: Stage::new(device, &MasksConstants { subgroup, alpha_min, extent, compact })?,
            blend_constants,
            blend: Default::default(),
            blend_long: Default::default(),
            subgroup,
            block_height: None,
            // Of all loops of an invocation together: two iterations for an entry of a list that is not long, a part of one
            // for those of others.
            longest_list: device.facts().loop_limit.unwrap_or(u32::MAX),
        }))
    }

    /// Whether it can draw pictures of this size.
    pub fn takes(&self, size_px: [u32; 2], gaussians: usize) -> bool {
        self.bins(size_px, gaussians).iter().product::<u32>() <= MAX_BINS
    }

    /// Columns and rows of bins of a picture of a scene of so many Gaussians.
    pub fn bins(&self, size_px: [u32; 2], gaussians: usize) -> [u32; 2] {
        bins_of(size_px, BLOCK_HEIGHTS[self.block_height(size_px, gaussians)])
    }

    /// Makes what blends such pictures, and bins with long lists if there may be some.
    pub fn prepare(
        &mut self,
        device: &Device,
        size_px: [u32; 2],
        gaussians: usize,
        has_long_lists: bool,
    ) -> Result<()> {
        let height = self.block_height(size_px, gaussians);
        let block_height = BLOCK_HEIGHTS[height].max(self.subgroup / BLOCK_WIDTH);
        let constants = BlendConstants { block_height, ..self.blend_constants };
        if self.blend[height].is_none() {
            self.blend[height] = Some(Stage::new(device, &constants)?);
        }
        if has_long_lists && self.blend_long[height].is_none() {
            let BlendConstants { subgroup, block_height, alpha_min, extent, .. } = constants;
            let BlendConstants { alpha_max, has_clamped_alphas, transmittance_min, stop, compact, .. } = constants;
            self.blend_long[height] = Some(Stage::new(
                device,
                &BlendLongConstants {
                    subgroup,
                    block_height,
                    alpha_min,
                    extent,
                    alpha_max,
                    has_clamped_alphas,
                    transmittance_min,
                    stop,
                    compact,
                },
            )?);
        }
        Ok(())
    }

    /// Which of the heights its blocks have.
    fn block_height(&self, size_px: [u32; 2], gaussians: usize) -> usize {
        if let Some(height) = self.block_height {
            return height;
        }
        let pixels: u64 = size_px.iter().map(|side| u64::from(*side)).product();
        let is_crowded = gaussians as u64 > 2 * pixels;
        let every_lane_has_a_pixel = self.subgroup <= BLOCK_WIDTH * BLOCK_HEIGHTS[0];
        let least = match pixels {
            _ if every_lane_has_a_pixel && (is_crowded || pixels < SMALL_PICTURE) => 0,
            ..LARGE_PICTURE => 1,
            _ => 2,
        };
        let fits = |height: &usize| bins_of(size_px, BLOCK_HEIGHTS[*height]).iter().product::<u32>() <= MAX_BINS;
        (least..2).find(fits).unwrap_or(2)
    }

    /// The longest list of a bin that it can draw.
    pub fn longest_list(&self) -> u32 {
        self.longest_list
    }

    /// Elements of a splat's record.
    pub fn splat_elements(&self) -> usize {
        if is_compact(&self.options) { 2 } else { 3 }
    }

    /// Records one frame: `target` shows the scene seen by `camera`, if there was room in `work`; `work.totals` says so.
    pub fn record(
        &self,
        cmd: &mut Commands,
        (scene, camera): (&GpuScene, &Camera),
        work: &FastWorkspace,
        target: Target,
    ) {
        assert_eq!(scene.layout, self.layout, "a renderer draws scenes of the layout it was built for");
        let drawn_alpha = self.options.rules.alpha_min;
        assert!(scene.alpha_min <= drawn_alpha, "a scene is culled by no higher threshold than it is drawn by");
        let view = view(camera, self.options.rules.near);
        let keys = DepthKeys::of(camera, &self.options, &scene.extent);
        let [bins_x, bins_y] = self.bins(camera.size_px, scene.len());
        let bins = bins_x * bins_y;
        let height = self.block_height(camera.size_px, scene.len());
        let block_height = BLOCK_HEIGHTS[height];
        let visible_capacity = work.gaussian_from_splat.len() as u32;
        let entry_capacity = work.entries.len() as u32;
        let between_stages = |cmd: &mut Commands| {
            cmd.barrier(Access::SHADER_WRITE, Access::SHADER | Access::INDIRECT);
        };

        cmd.scope("clear", |cmd| {
            cmd.fill(&work.totals, 0);
            cmd.fill(&work.listed_in_bins, 0);
        });
        cmd.barrier(Access::COPY_WRITE, Access::SHADER);
        cmd.scope("project", |cmd| {
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
                totals: &work.totals,
            };
            let push = ProjectPush {
                view,
                gaussians: scene.len() as u32,
                visible_capacity,
                span_capacity: work.spans.len() as u32,
                depth_limit: ((1_u64 << keys.bits) - 1) as u32,
                depth_shift: keys.shift,
                block_height,
            };
            cmd.dispatch(&self.project, bindings, push, DispatchSize::Groups(scene.len().div_ceil(PROJECT_CHUNK) as u64));
        });
        between_stages(cmd);
        let (totals, span_ranges, spans) = (&work.totals, &work.span_ranges, &work.spans);
        let parts = DispatchSize::Groups(BIN_CHUNKS as u64);
        cmd.scope("count", |cmd| {
            let bindings = CountBindings {
                totals,
                span_ranges,
                spans,
                listed_in_bins: &work.listed_in_bins,
                part_places: &work.part_places,
            };
            cmd.dispatch(&self.count, bindings, CountPush { bins_x, bins, visible_capacity }, parts);
        });
        between_stages(cmd);
        cmd.scope("offsets", |cmd| {
            let bindings = OffsetsBindings {
                totals,
                listed_in_bins: &work.listed_in_bins,
                bins: &work.bins,
                bin_order: &work.bin_order,
                run_bins: &work.run_bins,
                stretch_bins: &work.stretch_bins,
                dispatches: &work.dispatches,
            };
            let push = OffsetsPush { bins, visible_capacity, entry_capacity };
            cmd.dispatch(&self.offsets, bindings, push, DispatchSize::Groups(1));
        });
        between_stages(cmd);
        cmd.scope("fill", |cmd| {
            let bindings = FillBindings {
                totals,
                span_ranges,
                spans,
                part_places: &work.part_places,
                bins: &work.bins,
                depth_keys: &work.depth_keys,
                entries: &work.entries,
            };
            let push = FillPush { bins_x, bins, visible_capacity, entry_capacity };
            cmd.dispatch(&self.fill, bindings, push, parts);
        });
        between_stages(cmd);
        let over_runs = offset_of!(FastDispatches, over_runs);
        cmd.scope("sort", |cmd| {
            let bindings = SortBindings {
                run_bins: &work.run_bins,
                bins: &work.bins,
                gaussian_from_splat: &work.gaussian_from_splat,
                depth_keys: &work.depth_keys,
                entries: &work.entries,
                splat_ids: &work.splat_ids,
                dispatches: &work.dispatches,
            };
            cmd.dispatch_indirect(&self.sort, bindings, (), &work.dispatches, over_runs);
        });
        between_stages(cmd);
        cmd.scope("merge", |cmd| {
            for (index, (piece, [entries, merged])) in work.mergers().enumerate() {
                if index > 0 {
                    between_stages(cmd);
                }
                let bindings = MergeBindings {
                    run_bins: &work.run_bins,
                    bins: &work.bins,
                    gaussian_from_splat: &work.gaussian_from_splat,
                    entries,
                    splat_ids: &work.splat_ids,
                    dispatches: &work.dispatches,
                    merged,
                };
                cmd.dispatch_indirect(
                    &self.merge[index.min(1)],
                    bindings,
                    MergePush { piece },
                    &work.dispatches,
                    over_runs,
                );
            }
        });
        between_stages(cmd);
        cmd.scope("masks", |cmd| {
            let bindings = MasksBindings {
                stretch_bins: &work.stretch_bins,
                bins: &work.bins,
                splat_ids: &work.splat_ids,
                splats: &work.splats,
                masks: &work.masks,
                dispatches: &work.dispatches,
            };
            let over_stretches = offset_of!(FastDispatches, over_stretches);
            cmd.dispatch_indirect(
                &self.masks,
                bindings,
                MasksPush { bins_x, block_height },
                &work.dispatches,
                over_stretches,
            );
        });
        between_stages(cmd);
        cmd.scope("blend", |cmd| {
            let bindings = BlendBindings {
                bins: &work.bins,
                bin_order: &work.bin_order,
                splat_ids: &work.splat_ids,
                splats: &work.splats,
                masks: &work.masks,
                image: target.image,
            };
            let BlendBindings { bins: listed, bin_order, splat_ids, splats, masks, image } = bindings;
            let long_bindings = BlendLongBindings { bins: listed, bin_order, splat_ids, splats, masks, image };
            let (size_px, background) = (image.size(), target.background.colour());
            let push = BlendPush { size_px, bins_x, bins, background };
            let long_push = BlendLongPush { size_px, bins_x, bins, background };
            let over_long_blocks = offset_of!(FastDispatches, over_long_blocks);
            if work.has_long_lists() {
                let long = self.blend_long[height].as_ref().expect("it is prepared");
                cmd.dispatch_indirect(long, long_bindings, long_push, &work.dispatches, over_long_blocks);
                between_stages(cmd);
            }
            let lanes = DispatchSize::Invocations(u64::from(bins) * BLOCKS * u64::from(self.subgroup));
            cmd.dispatch(self.blend[height].as_ref().expect("it is prepared"), bindings, push, lanes);
        });
    }
}

fn bins_of(size_px: [u32; 2], block_height: u32) -> [u32; 2] {
    let block = [BLOCK_WIDTH, block_height];
    std::array::from_fn(|axis| size_px[axis].div_ceil(BIN_SHAPE[axis] * block[axis]))
}

/// Whether colours of splats are kept in 16-bit floats: where those of Gaussians may be, and pixels may stop early.
fn is_compact(options: &Options) -> bool {
    matches!(options.sh_storage, Storage::F16 | Storage::U8) && options.stop > 0.0
}
