//! The stages that draw along rays with the lists of the fast path.

use std::mem::offset_of;

use anyhow::Result;

use super::tables::BinTables;
use crate::gpu::{Commands, Device, DispatchSize, Stage};
use crate::options::Options;
use crate::packing::Layout;
use crate::render::fast::{BLOCK_FORMS, BinGrid, BlockForm, FastPipeline, FastWorkspace, between_stages};
use crate::render::frame::{Shot, Target};
use crate::render::rays::depth_keys;
use crate::render::shaders::fast::{BLOCKS, PROJECT_CHUNK};
use crate::render::shaders::fast_rays::*;
use crate::render::shaders::{FastDispatches, SharedConstants, Totals};

/// The stages of a fast frame along rays that differ from those of a pinhole.
pub struct FastRaysPipeline {
    options: Options,
    project: Stage<Project>,
    masks: Stage<Masks>,
    /// One for each of [`BLOCK_FORMS`], made when the first picture needs it.
    blend: [Option<Stage<Blend>>; BLOCK_FORMS.len()],
    constants: SharedConstants,
    subgroup: u32,
    /// 16-byte elements of a splat's record.
    pub splat_elements: usize,
}

/// A frame: what it shows, its tables and its buffers.
#[derive(Clone, Copy)]
pub struct FastRaysFrame<'f> {
    pub shot: Shot<'f>,
    pub tables: &'f BinTables,
    pub work: &'f FastWorkspace,
    pub grid: BinGrid,
}

/// The constants of the stages beside those of `fast`, and the size of subgroups.
fn constants(fast: &FastPipeline) -> (SharedConstants, u32) {
    let (constants, subgroup) = fast.constants();
    // Depths of rays are those of their camera, whatever orders the splats of pinholes.
    (SharedConstants { by_distance: false, ..*constants }, subgroup)
}

fn blend_constants(constants: &SharedConstants, form: BlockForm) -> BlendConstants {
    let BlockForm { height: block_height, has_ring } = form;
    BlendConstants { block_height, has_ring, ..BlendConstants::of(constants) }
}

impl FastRaysPipeline {
    /// Builds the stages that go with those of `fast`, for scenes of the same layout.
    ///
    /// # Errors
    /// If a pipeline cannot be made.
    pub fn new(device: &Device, options: &Options, layout: &Layout, fast: &FastPipeline) -> Result<Self> {
        let (constants, subgroup) = constants(fast);
        Ok(Self {
            options: *options,
            project: Stage::of_subgroups(device, &ProjectConstants::of(&constants), subgroup)?,
            masks: Stage::of_subgroups(device, &MasksConstants::of(&constants), subgroup)?,
            blend: Default::default(),
            constants,
            subgroup,
            splat_elements: if layout.is_compact(options) { 3 } else { 4 },
        })
    }

    /// A fingerprint of all stages that go with those of `fast`, and of `fast`.
    ///
    /// # Errors
    /// If a shader cannot be compiled at run time.
    pub fn fingerprint(device: &Device, fast: &FastPipeline) -> Result<blake3::Hash> {
        let (constants, subgroup) = constants(fast);
        let mut stages = vec![
            fast.fingerprint(device)?,
            Stage::<Project>::fingerprint(device, &ProjectConstants::of(&constants), subgroup)?,
            Stage::<Masks>::fingerprint(device, &MasksConstants::of(&constants), subgroup)?,
        ];
        for form in fast.forms() {
            let constants = blend_constants(&constants, BLOCK_FORMS[form]);
            stages.push(Stage::<Blend>::fingerprint(device, &constants, subgroup)?);
        }
        let mut hasher = blake3::Hasher::new();
        stages.iter().for_each(|stage| _ = hasher.update(stage.as_bytes()));
        Ok(hasher.finalize())
    }

    /// Makes the blend pipeline for pictures of this size.
    ///
    /// # Errors
    /// If the pipeline cannot be made.
    pub fn prepare(&mut self, device: &Device, grid: BinGrid) -> Result<()> {
        let blend = &mut self.blend[grid.form_index];
        if blend.is_none() {
            let constants = blend_constants(&self.constants, BLOCK_FORMS[grid.form_index]);
            *blend = Some(Stage::of_subgroups(device, &constants, self.subgroup)?);
        }
        Ok(())
    }

    /// Records one frame, like [`FastPipeline::record`], whose stages `fast` are used between these.
    ///
    /// # Panics
    /// If [`prepare`](Self::prepare) was not called for this size.
    pub fn record(&self, cmd: &mut Commands, fast: &FastPipeline, frame: FastRaysFrame, target: Target) {
        let FastRaysFrame { work, grid, .. } = frame;
        cmd.scope("project", |cmd| self.project(cmd, frame));
        between_stages(cmd);
        cmd.scope("list", |cmd| fast.list(cmd, work, grid));
        between_stages(cmd);
        fast.order_lists(cmd, work, grid);
        between_stages(cmd);
        cmd.scope("masks", |cmd| self.masks(cmd, frame));
        between_stages(cmd);
        cmd.scope("blend", |cmd| self.blend(cmd, frame, target));
    }

    /// The fewest bytes that each stage moves through device memory, as [`FastPipeline::least_bytes`].
    pub fn least_bytes(&self, fast: &FastPipeline, shot: Shot, totals: &Totals) -> Vec<(&'static str, u64)> {
        let more = 16 * (self.splat_elements - fast.splat_elements()) as u64 * u64::from(totals.visible_kept);
        let pixels: u64 = shot.size().iter().map(|side| u64::from(*side)).product();
        let mut stages = fast.least_bytes(shot, totals);
        for (stage, bytes) in &mut stages {
            match *stage {
                "project" | "masks" => *bytes += more,
                "blend" => *bytes += more + 12 * pixels,
                _ => {}
            }
        }
        stages
    }

    /// Projects the Gaussians that rays may meet, and finds the bins of each splat.
    pub fn project(&self, cmd: &mut Commands, FastRaysFrame { shot, tables, work, grid }: FastRaysFrame) {
        let scene = shot.scene;
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
            lens_table: &tables.table,
            footprints: &tables.lens.footprints.table,
            cells: &tables.cells.cells,
        };
        let keys = depth_keys(shot, &self.options);
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

    /// Marks the blocks of its bin that have a ray which every entry's splat meets.
    pub fn masks(&self, cmd: &mut Commands, FastRaysFrame { shot, tables, work, grid }: FastRaysFrame) {
        let bindings = MasksBindings {
            segment_bins: &work.segment_bins,
            bins: &work.bins,
            splat_ids: &work.splat_ids,
            splats: &work.splats,
            masks: &work.masks,
            dispatches: &work.dispatches,
            lens_table: &tables.table,
        };
        let push = MasksPush {
            block_height: grid.block_height,
            is_parallel: shot.camera.is_parallel().into(),
            size_px: shot.camera.size_px,
        };
        let groups = offset_of!(FastDispatches, over_segments);
        cmd.dispatch_indirect(&self.masks, bindings, push, &work.dispatches, groups);
    }

    /// Blends every block front to back along the rays of its pixels.
    fn blend(&self, cmd: &mut Commands, frame: FastRaysFrame, target: Target) {
        let FastRaysFrame { shot, tables, work, grid } = frame;
        let bindings = BlendBindings {
            bins: &work.bins,
            bin_order: &work.bin_order,
            splat_ids: &work.splat_ids,
            splats: &work.splats,
            masks: &work.masks,
            image: target.image,
            rays: &tables.lens.rays,
        };
        let push = BlendPush {
            size_px: target.image.size(),
            bins_x: grid.bins[0],
            bins: grid.count(),
            background: target.background.colour(),
            is_parallel: shot.camera.is_parallel().into(),
        };
        let blend = self.blend[grid.form_index].as_ref().expect("`prepare` made it");
        let lanes = u64::from(grid.count()) * u64::from(BLOCKS * self.subgroup);
        cmd.dispatch(blend, bindings, push, DispatchSize::Invocations(lanes));
    }
}
