//! The rays path as an engine: its pipeline, its buffers, and the tables of the lens that it drew last.

use anyhow::Result;

use crate::gpu::{Buffer, Commands, Device};
use crate::options::Options;
use crate::render::capacity::{Capacity, length};
use crate::render::frame::{Shot, Target, Variation};
use crate::render::inspect::Inspector;
use crate::render::path::{Limits, Path};
use crate::render::portable::{PortablePipeline, PortableWorkspace};
use crate::render::rays::{RayTables, RaysFrame, RaysPipeline};
use crate::render::shaders::{RaySplat, Totals};

/// The rays path and its buffers.
pub(super) struct RaysEngine {
    pipeline: RaysPipeline,
    pub work: PortableWorkspace,
    splats: Buffer<RaySplat>,
    tables: Option<RayTables>,
    /// Blend dispatches of a frame.
    passes: u32,
}

impl RaysEngine {
    /// Builds the pipeline, and buffers for a scene.
    ///
    /// # Errors
    /// If a pipeline cannot be made, or memory runs out.
    pub fn new(device: &Device, Shot { scene, .. }: Shot, options: &Options, variation: Variation) -> Result<Self> {
        let pipeline = RaysPipeline::new(device, options, scene.layout(), variation)?;
        let (work, splats) = buffers(device, without_spans(Capacity::guess(device, scene.len(), 1)))?;
        Ok(Self { pipeline, work, splats, tables: None, passes: 1 })
    }

    /// Replaces the buffers, and keeps the tables.
    pub fn set_capacity(&mut self, device: &Device, capacity: Capacity) -> Result<()> {
        (self.work, self.splats) = buffers(device, without_spans(capacity))?;
        Ok(())
    }

    /// Makes tables and buffers for a frame.
    ///
    /// # Errors
    /// If memory runs out: frames along rays are not drawn in slabs.
    pub fn prepare(&mut self, device: &Device, shot: Shot, portable: &PortablePipeline) -> Result<Limits> {
        let Shot { scene, camera, band, .. } = shot;
        self.tables = Some(match self.tables.take() {
            Some(tables) if tables.lens.suit(camera, band) => tables,
            kept => RayTables::new(device, (camera, band), kept)?,
        });
        let cells = shot.tiles() as usize;
        self.fit(device, Capacity { gaussians: scene.len(), cells, ..Capacity::default() })?;
        let longest_list = portable.longest_list(self.passes);
        Ok(Limits { path: Path::Rays, in_slabs: false, capacity: self.capacity(), longest_list })
    }

    /// The capacity of a frame. Frames along rays have no spans.
    pub fn capacity(&self) -> Capacity {
        Capacity { spans: u64::MAX, ..self.work.capacity }
    }

    /// Records a frame that was prepared, which shows the quantity of `inspector` instead of colours if there is one.
    pub fn record(
        &self,
        cmd: &mut Commands,
        shot: Shot,
        target: Target,
        portable: &PortablePipeline,
        inspector: Option<&Inspector>,
    ) {
        let (pipeline, frame) = (&self.pipeline, self.frame(shot));
        match inspector {
            None => pipeline.record(cmd, portable, frame, target, self.passes),
            Some(inspector) => inspector.record_rays(cmd, (pipeline, portable), frame, target, self.passes),
        }
    }

    /// The fewest bytes that every stage of a frame moves.
    pub fn least_bytes(&self, shot: Shot, totals: &Totals, portable: &PortablePipeline) -> Vec<(&'static str, u64)> {
        self.pipeline.least_bytes(portable, self.frame(shot), totals)
    }

    /// A frame that was prepared.
    pub fn frame<'f>(&'f self, shot: Shot<'f>) -> RaysFrame<'f> {
        let tables = self.tables.as_ref().expect("a frame along rays was prepared");
        RaysFrame { shot, tables, work: &self.work, splats: &self.splats }
    }

    /// Enlarges the buffers to the demand of a frame that counted `totals`.
    pub fn grow(
        &mut self,
        device: &Device,
        demand: Capacity,
        totals: &Totals,
        portable: &PortablePipeline,
    ) -> Result<()> {
        self.passes = self.passes.max(portable.passes(totals.longest_list));
        self.fit(device, without_spans(demand))
    }

    fn fit(&mut self, device: &Device, demand: Capacity) -> Result<()> {
        let current = self.work.capacity;
        if !demand.fits(current) {
            (self.work, self.splats) = buffers(device, Capacity::default())?; // frees the old ones first
            (self.work, self.splats) = demand.grow(current, |capacity| buffers(device, capacity))?;
        }
        Ok(())
    }

    /// The name and the bytes of every buffer.
    pub fn buffers(&self) -> impl Iterator<Item = (&str, u64)> {
        let tables = self.tables.iter().flat_map(RayTables::buffers);
        self.work.buffers().into_iter().chain([self.splats.footprint()]).chain(tables)
    }
}

fn without_spans(capacity: Capacity) -> Capacity {
    Capacity { spans: 0, ..capacity }
}

fn buffers(device: &Device, capacity: Capacity) -> Result<(PortableWorkspace, Buffer<RaySplat>)> {
    let splats = length("visible splats", capacity.visible)?;
    Ok((PortableWorkspace::with_splats(device, capacity, 0)?, Buffer::new(device, "ray splats", splats)?))
}
