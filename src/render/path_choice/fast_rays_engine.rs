//! The fast path along rays as an engine: its pipeline, its buffers, and the tables of the lens that it drew last.

use anyhow::Result;

use crate::gpu::{Commands, Device};
use crate::options::Options;
use crate::render::capacity::{Capacity, has_memory};
use crate::render::fast::{FastPipeline, FastWorkspace};
use crate::render::fast_rays::{BinTables, FastRaysFrame, FastRaysPipeline};
use crate::render::frame::{Shot, Target};
use crate::render::path::{Limits, Path};
use crate::render::shaders::Totals;

/// The fast path along rays and its buffers. It draws together with the stages of the fast path.
pub(super) struct FastRaysEngine {
    pipeline: FastRaysPipeline,
    pub work: FastWorkspace,
    tables: Option<BinTables>,
    /// A frame had lists that blend cannot walk, or that had no memory: the rays path draws from then on.
    is_left: bool,
}

impl FastRaysEngine {
    /// Builds the pipeline, and buffers for a scene.
    ///
    /// # Errors
    /// If a pipeline cannot be made, or memory runs out.
    pub fn new(device: &Device, Shot { scene, .. }: Shot, options: &Options, fast: &FastPipeline) -> Result<Self> {
        let pipeline = FastRaysPipeline::new(device, options, scene.layout(), fast)?;
        let guess = FastWorkspace::guess(device, Capacity::guess(device, scene.len(), 1));
        let work = FastWorkspace::new(device, guess, pipeline.splat_elements)?;
        Ok(Self { pipeline, work, tables: None, is_left: false })
    }

    /// Replaces the buffers, and keeps the tables.
    pub fn set_capacity(&mut self, device: &Device, capacity: Capacity) -> Result<()> {
        self.work = FastWorkspace::new(device, capacity, self.pipeline.splat_elements)?;
        Ok(())
    }

    /// Makes tables and buffers for a frame; `None` if the rays path must draw it, since the rays of a block of the
    /// lens do not meet a plane, or lists are too long or too many.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn prepare(&mut self, device: &Device, shot: Shot, fast: &FastPipeline) -> Result<Option<Limits>> {
        let Shot { scene, camera, band, .. } = shot;
        if self.is_left {
            return Ok(None);
        }
        let grid = fast.grid_of(shot, scene.len());
        let tables = match self.tables.take() {
            Some(tables) if tables.suit((camera, band), grid) => tables,
            kept => BinTables::new(device, (camera, band), grid, kept)?,
        };
        let tables = self.tables.insert(tables);
        if !tables.have_planes {
            return Ok(None);
        }
        let demand = Capacity { gaussians: scene.len(), cells: grid.count() as usize, ..Capacity::default() };
        self.is_left = !has_memory(self.work.grow(device, demand, 0))?;
        if self.is_left {
            return Ok(None);
        }
        self.pipeline.prepare(device, grid)?;
        let longest_list = fast.longest_list().min(self.work.longest_list());
        Ok(Some(Limits { path: Path::FastRays, in_slabs: false, capacity: self.work.capacity, longest_list }))
    }

    /// Records a frame that was prepared.
    pub fn record(&self, cmd: &mut Commands, shot: Shot, target: Target, fast: &FastPipeline) {
        let tables = self.tables.as_ref().expect("a frame along rays was prepared");
        let grid = fast.grid_of(shot, shot.scene.len());
        self.pipeline.record(cmd, fast, FastRaysFrame { shot, tables, work: &self.work, grid }, target);
    }

    /// The fewest bytes that every stage of a frame moves.
    pub fn least_bytes(&self, shot: Shot, totals: &Totals, fast: &FastPipeline) -> Vec<(&'static str, u64)> {
        self.pipeline.least_bytes(fast, shot, totals)
    }

    /// Enlarges the buffers to the demand of a frame that counted `totals`, or leaves the next frame to the rays path.
    pub fn grow(&mut self, device: &Device, demand: Capacity, totals: &Totals, fast: &FastPipeline) -> Result<()> {
        let is_too_long = totals.longest_list > fast.longest_list();
        self.is_left = is_too_long || !has_memory(self.work.grow(device, demand, totals.longest_list))?;
        Ok(())
    }

    /// The name and the bytes of every buffer.
    pub fn buffers(&self) -> impl Iterator<Item = (&str, u64)> {
        let tables = self.tables.iter().flat_map(BinTables::buffers);
        self.work.buffers().into_iter().chain(tables)
    }
}
