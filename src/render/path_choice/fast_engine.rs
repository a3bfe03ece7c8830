//! The fast path as an engine: its pipeline, its buffers, and what it draws pages and slabs with.

use anyhow::Result;

use crate::gpu::{Commands, Device, Readback};
use crate::host_memory::OutOfMemory;
use crate::options::Options;
use crate::packing::Layout;
use crate::render::capacity::{Capacity, has_memory};
use crate::render::fast::{FastFrame, FastPipeline, FastWorkspace};
use crate::render::frame::{Shot, Target};
use crate::render::inspect::Attribute;
use crate::render::lod::{LodSelector, PagedFrame};
use crate::render::path::{Limits, Path};
use crate::render::shaders::{SelectionState, Totals};
use crate::render::slabs::{FastSlabs, SlabbedFrame};

/// The most splats in a slab of patches, for which memory is made.
const SAMPLED_SPLATS: usize = 1 << 20;

/// The fast path and its buffers.
pub(super) struct FastEngine {
    pub pipeline: FastPipeline,
    pub work: FastWorkspace,
    /// The next frame is drawn in slabs, since the last one did not fit the buffers.
    pub needs_slabs: bool,
    slabs: Option<FastSlabs>,
    /// Draws scenes in pages in one go, without slabs.
    paged: Option<PagedFrame>,
}

impl FastEngine {
    /// Builds the pipeline, and buffers of about `guess`; `None` where the device or the options require the portable
    /// path.
    ///
    /// # Errors
    /// If a pipeline cannot be made.
    pub fn new(device: &Device, options: &Options, layout: &Layout, guess: Capacity) -> Result<Option<Self>> {
        let Some(pipeline) = FastPipeline::new(device, options, layout)? else { return Ok(None) };
        let elements = pipeline.splat_elements();
        let work = match FastWorkspace::new(device, FastWorkspace::guess(device, guess), elements) {
            Err(error) if error.is::<OutOfMemory>() => FastWorkspace::new(device, Capacity::default(), elements)?,
            other => other?,
        };
        Ok(Some(Self { pipeline, work, needs_slabs: false, slabs: None, paged: None }))
    }

    /// Replaces the buffers by ones of this capacity.
    pub fn set_capacity(&mut self, device: &Device, capacity: Capacity) -> Result<()> {
        self.work = FastWorkspace::new(device, capacity, self.pipeline.splat_elements())?;
        Ok(())
    }

    /// Frees the buffers.
    pub fn release(&mut self, device: &Device) -> Result<()> {
        self.set_capacity(device, Capacity::default())
    }

    /// Makes the stages of a frame and buffers that are large enough for it. Slabs draw it if its buffers or its pages
    /// do not fit.
    pub fn prepare(
        &mut self,
        device: &Device,
        shot: Shot,
        options: &Options,
        attribute: Option<Attribute>,
    ) -> Result<Limits> {
        let scene = shot.scene;
        let grid = self.pipeline.grid_of(shot, scene.drawn_len(options));
        let cells = grid.count() as usize;
        let demand = Capacity { gaussians: scene.placed_len(), cells, ..Capacity::default() };
        // The first picture of a scene without levels reads only the pages that are not hidden.
        let is_first = self.slabs.is_none();
        let reads_pages =
            scene.paged().is_some_and(|paged| !options.wants_levels() && (is_first || !paged.cache().fits_all()));
        let is_sample = shot.patches.is_some();
        let in_slabs = is_sample || self.needs_slabs || reads_pages || !has_memory(self.work.grow(device, demand, 0))?;
        if !in_slabs {
            self.pipeline.prepare(device, grid)?;
            if scene.is_paged() && self.paged.as_ref().is_none_or(|paged| paged.attribute != attribute) {
                self.paged = Some(PagedFrame::new(device, &self.pipeline, attribute)?);
            }
        }
        self.needs_slabs = in_slabs;
        let longest_list = self.pipeline.longest_list().min(self.work.longest_list());
        Ok(Limits { path: Path::Fast, in_slabs, capacity: self.work.capacity, longest_list })
    }

    /// Records a frame of a scene in pages, and the state of its selection.
    ///
    /// # Errors
    /// If memory runs out.
    ///
    /// # Panics
    /// If the frame was not prepared.
    pub fn record_paged(
        &self,
        cmd: &mut Commands,
        shot: Shot,
        target: Target,
        options: &Options,
        device: &Device,
        selector: &mut LodSelector,
    ) -> Result<Readback<SelectionState>> {
        let paged = self.paged.as_ref().expect("a frame of a scene in pages was prepared");
        paged.record(cmd, &FastFrame::new(&self.pipeline, &self.work, options, shot, target), device, selector)
    }

    /// Enlarges the buffers to the demand of a frame that counted `totals`, or leaves the next frame to slabs.
    pub fn grow(&mut self, device: &Device, demand: Capacity, totals: &Totals) -> Result<()> {
        let is_too_long = totals.longest_list > self.pipeline.longest_list();
        self.needs_slabs = is_too_long || !has_memory(self.work.grow(device, demand, totals.longest_list))?;
        Ok(())
    }

    /// Makes the buffers of a frame in slabs as large as the free memory allows.
    ///
    /// # Errors
    /// [`OutOfMemory`] if there is too little for the smallest slab.
    pub fn fit_slabs(&mut self, device: &Device, shot: Shot, options: &Options) -> Result<()> {
        let scene = shot.scene;
        let grid = self.pipeline.grid_of(shot, scene.drawn_len(options));
        let slabs = match &mut self.slabs {
            Some(slabs) => slabs,
            none => none.insert(FastSlabs::new(device, &self.pipeline, scene)?),
        };
        let most = if shot.patches.is_some() { SAMPLED_SPLATS } else { usize::MAX };
        slabs.fit(device, &mut self.work, &self.pipeline, grid, scene.placed_len().min(most))
    }

    /// Draws a frame in slabs whose buffers [`fit_slabs`](Self::fit_slabs) made, and waits for it.
    ///
    /// # Errors
    /// If memory runs out or a page cannot be read.
    pub fn draw_slabs(
        &mut self,
        device: &Device,
        shot: Shot,
        target: Target,
        options: &Options,
        selector: Option<&mut LodSelector>,
    ) -> Result<SlabbedFrame> {
        let slabs = self.slabs.as_mut().expect("the buffers of slabs fit");
        let frame = FastFrame::new(&self.pipeline, &self.work, options, shot, target);
        let drawn = slabs.draw(device, &frame, selector)?;
        // A frame that fits into one slab needs none, unless its pages exceed the cache.
        self.needs_slabs = match shot.scene.paged() {
            Some(paged) => drawn.report.pages_in_view > paged.cache().capacity() as u64,
            None => drawn.report.slabs > 1,
        };
        Ok(drawn)
    }
}
