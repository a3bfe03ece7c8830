//! The stages of the fast path that are other ones in slabs: begin, list, blend, finish.

use anyhow::Result;

use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Image, Stage};
use crate::render::fast::{BLOCK_FORMS, BinGrid, FastFrame, FastPipeline, FastWorkspace, between_stages};
use crate::render::frame::Target;
use crate::render::shaders::SharedConstants;
use crate::render::shaders::fast::{BLOCKS, MAX_BINS};
use crate::render::shaders::slabs::*;
use crate::rules::Background;

/// The stages, built for one set of options and one layout of a scene.
pub struct FastStages {
    list: Stage<List>,
    /// One for each of [`BLOCK_FORMS`], made when the first picture needs it.
    blend: [Option<Stage<Blend>>; BLOCK_FORMS.len()],
    begin: Stage<Begin>,
    finish: Stage<Finish>,
    constants: SharedConstants,
    subgroup: u32,
}

/// The open bins before and after a slab, a bit each.
pub struct OpenBins(pub [Buffer<u32>; 2]);

impl OpenBins {
    pub fn new(device: &Device) -> Result<Self> {
        let bits = |name: &str| Buffer::new(device, name, MAX_BINS.div_ceil(32) as usize);
        Ok(Self([bits("open bins")?, bits("open bins 2")?]))
    }
}

impl FastStages {
    pub fn new(device: &Device, fast: &FastPipeline) -> Result<Self> {
        let (constants, subgroup) = fast.constants();
        Ok(Self {
            list: Stage::of_subgroups(device, &ListConstants::of(constants), subgroup)?,
            blend: Default::default(),
            begin: Stage::new(device, &BeginConstants::of(constants))?,
            finish: Stage::new(device, &FinishConstants::of(constants))?,
            constants: *constants,
            subgroup,
        })
    }

    /// Makes the blend for pictures of this grid.
    pub fn prepare(&mut self, device: &Device, grid: BinGrid) -> Result<()> {
        let (blend, form) = (&mut self.blend[grid.form_index], BLOCK_FORMS[grid.form_index]);
        if blend.is_none() {
            let constants = BlendConstants { block_height: form.height, ..BlendConstants::of(&self.constants) };
            *blend = Some(Stage::of_subgroups(device, &constants, self.subgroup)?);
        }
        Ok(())
    }

    /// Sets the state of every pixel before the first slab: no colour, full transmittance. Pixels of bins that are not
    /// open have stopped.
    pub fn begin(&self, cmd: &mut Commands, image: &Image, grid: BinGrid, open_bins: &Buffer<u32>) {
        let push = BeginPush { size_px: image.size(), bin_px: grid.bin_px(), bins_x: grid.bins[0] };
        cmd.dispatch(&self.begin, BeginBindings { image, open_bins }, push, over(image));
    }

    /// Blends the background behind the states, which become the picture.
    pub fn finish(&self, cmd: &mut Commands, Target { image, background, .. }: Target) {
        let push = FinishPush { size_px: image.size(), background: background.colour() };
        cmd.dispatch(&self.finish, FinishBindings { image }, push, over(image));
    }

    /// Records the stages after the projection: the lists of the open bins, and their blend on top of the states.
    pub fn list_and_blend(&self, cmd: &mut Commands, frame: &FastFrame, [open, still_open]: [&Buffer<u32>; 2]) {
        let FastFrame { work, grid, .. } = *frame;
        between_stages(cmd);
        cmd.scope("list", |cmd| self.list(cmd, work, grid, open));
        between_stages(cmd);
        frame.pipeline.sort_lists(cmd, work, grid);
        cmd.fill(still_open, 0);
        cmd.barrier(Access::SHADER_WRITE | Access::COPY_WRITE, Access::SHADER);
        cmd.scope("blend", |cmd| self.blend(cmd, work, grid, frame.target.image, still_open));
    }

    fn list(&self, cmd: &mut Commands, work: &FastWorkspace, grid: BinGrid, open_bins: &Buffer<u32>) {
        let bindings = ListBindings {
            counters: &work.counters,
            span_ranges: &work.span_ranges,
            spans: &work.spans,
            listed_in_bins: &work.listed_in_bins,
            list_starts: &work.list_starts,
            unsorted: &work.unsorted,
            open_bins,
        };
        let push = ListPush {
            bins_x: grid.bins[0],
            bins: grid.count(),
            visible_capacity: work.visible_capacity(),
            entry_capacity: work.entry_capacity(),
        };
        let groups = DispatchSize::Groups(work.bin_chunks(grid).into());
        cmd.dispatch(&self.list, bindings, push, groups);
    }

    fn blend(&self, cmd: &mut Commands, work: &FastWorkspace, grid: BinGrid, image: &Image, open_bins: &Buffer<u32>) {
        let bindings = BlendBindings {
            bins: &work.bins,
            bin_order: &work.bin_order,
            splat_ids: &work.splat_ids,
            splats: &work.splats,
            masks: &work.masks,
            image,
            open_bins,
            depth_keys: &work.depth_keys,
            stop_keys: &work.stop_keys,
        };
        // The background is added at the end.
        let background = Background::Transparent.colour();
        let push = BlendPush {
            size_px: image.size(),
            bins_x: grid.bins[0],
            bins: grid.count(),
            background,
            top_px: grid.top_px,
        };
        let blend = self.blend[grid.form_index].as_ref().expect("`prepare` made it");
        let lanes = u64::from(grid.count()) * u64::from(BLOCKS * self.subgroup);
        cmd.dispatch(blend, bindings, push, DispatchSize::Invocations(lanes));
    }
}

fn over(image: &Image) -> DispatchSize {
    DispatchSize::Invocations(image.size().iter().map(|side| u64::from(*side)).product())
}
