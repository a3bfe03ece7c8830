//! The portable path as an engine: its pipeline, its buffers, and what it draws slabs with.

use anyhow::Result;

use crate::gpu::{Commands, Device};
use crate::host_memory::OutOfMemory;
use crate::options::Options;
use crate::packing::Layout;
use crate::render::capacity::{Capacity, has_memory};
use crate::render::frame::{Shot, Target, Variation};
use crate::render::inspect::Inspector;
use crate::render::lod::LodSelector;
use crate::render::path::{Limits, Path};
use crate::render::portable::{PortablePipeline, PortableWorkspace};
use crate::render::shaders::Totals;
use crate::render::slabs::{PortableFrame, PortableSlabs, SlabbedFrame};

/// The portable path and its buffers.
pub(crate) struct PortableEngine {
    /// Made for the first frame that it draws: beside the fast path it is seldom needed.
    pipeline: Option<PortablePipeline>,
    pub work: PortableWorkspace,
    variation: Variation,
    layout: Layout,
    /// Blend dispatches of a frame.
    passes: u32,
    /// The next frame is drawn in slabs, since the last one did not fit the buffers.
    needs_slabs: bool,
    slabs: Option<PortableSlabs>,
}

impl PortableEngine {
    /// Makes buffers of about this capacity, and no pipeline yet.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn new(device: &Device, layout: &Layout, variation: Variation, guess: Capacity) -> Result<Self> {
        let work = match PortableWorkspace::new(device, guess) {
            Err(error) if error.is::<OutOfMemory>() => PortableWorkspace::new(device, Capacity::default())?,
            other => other?,
        };
        let layout = layout.clone();
        Ok(Self { pipeline: None, work, variation, layout, passes: 1, needs_slabs: false, slabs: None })
    }

    /// Makes the pipeline, if there is none yet.
    pub fn make(&mut self, device: &Device, options: &Options) -> Result<()> {
        if self.pipeline.is_none() {
            self.pipeline = Some(PortablePipeline::varied(device, options, &self.layout, self.variation)?);
        }
        Ok(())
    }

    /// The pipeline.
    ///
    /// # Panics
    /// If no frame was prepared yet.
    pub fn pipeline(&self) -> &PortablePipeline {
        self.pipeline.as_ref().expect("a frame on the portable path was prepared")
    }

    /// Replaces the buffers by ones of this capacity.
    pub fn set_capacity(&mut self, device: &Device, capacity: Capacity) -> Result<()> {
        self.work = PortableWorkspace::new(device, capacity)?;
        Ok(())
    }

    /// Frees the buffers.
    pub fn release(&mut self, device: &Device) -> Result<()> {
        self.set_capacity(device, Capacity::default())
    }

    /// Replaces the buffers, and forgets what earlier frames of other scenes demanded.
    pub fn reset(&mut self, device: &Device, capacity: Capacity) -> Result<()> {
        (self.passes, self.needs_slabs) = (1, false);
        self.set_capacity(device, capacity)
    }

    /// Makes the pipeline and buffers that are large enough for a frame. Slabs draw it if they do not fit.
    pub fn prepare(&mut self, device: &Device, shot: Shot, options: &Options) -> Result<Limits> {
        let (scene, cells) = (shot.scene, shot.tiles() as usize);
        let demand = Capacity { gaussians: scene.placed_len(), cells, ..Capacity::default() };
        let is_sample = shot.patches.is_some();
        let in_slabs =
            is_sample || self.needs_slabs || scene.is_paged() || !has_memory(self.work.grow(device, demand).map(drop))?;
        self.make(device, options)?;
        let longest_list = self.pipeline().longest_list(self.passes);
        Ok(Limits { path: Path::Portable, in_slabs, capacity: self.work.capacity, longest_list })
    }

    /// Records a frame, which shows the quantity of `inspector` instead of colours if there is one.
    pub fn record(&self, cmd: &mut Commands, shot: Shot, target: Target, inspector: Option<&Inspector>) {
        match inspector {
            None => self.pipeline().record(cmd, shot, &self.work, target, self.passes),
            Some(inspector) => inspector.record(cmd, self.pipeline(), shot, &self.work, target, self.passes),
        }
    }

    /// Enlarges the buffers to the demand of a frame that counted `totals`, or leaves the next frame to slabs.
    pub fn grow(&mut self, device: &Device, demand: Capacity, totals: &Totals) -> Result<()> {
        self.needs_slabs = !has_memory(self.work.grow(device, demand).map(drop))?;
        let passes = self.pipeline.as_ref().map_or(1, |pipeline| pipeline.passes(totals.longest_list));
        self.passes = self.passes.max(passes);
        Ok(())
    }

    /// Makes the buffers of a frame in slabs as large as the free memory allows.
    ///
    /// # Errors
    /// [`OutOfMemory`] if there is too little for the smallest slab.
    pub fn fit_slabs(&mut self, device: &Device, shot: Shot) -> Result<()> {
        let pipeline = self.pipeline.as_ref().expect("a frame on the portable path was prepared");
        let slabs = match &mut self.slabs {
            Some(slabs) => slabs,
            none => none.insert(PortableSlabs::new(device, pipeline, shot.scene)?),
        };
        slabs.fit(device, &mut self.work, shot.size(), shot.scene)
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
        inspector: Option<&Inspector>,
    ) -> Result<SlabbedFrame> {
        let pipeline = self.pipeline.as_ref().expect("a frame on the portable path was prepared");
        let slabs = self.slabs.as_mut().expect("the buffers of slabs fit");
        let frame = PortableFrame { pipeline, work: &self.work, options, shot, target, inspector };
        let drawn = slabs.draw(device, &frame, selector)?;
        self.needs_slabs = drawn.report.slabs > 1;
        Ok(drawn)
    }
}
