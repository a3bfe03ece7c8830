//! A frame of the fast path, drawn slab by slab.

use std::ops::Range;

use anyhow::Result;

use super::buffers::{MEMORY_FRACTION, MOST_SPLATS, SlabBuffers};
use super::fast_stages::{FastStages, OpenBins};
use super::input::{CellGrid, SlabInput};
use super::progress::{FrameProgress, SlabbedFrame};
use crate::gpu::{Access, Commands, Device, InFlight, Readback};
use crate::host_memory::OutOfMemory;
use crate::render::capacity::Capacity;
use crate::render::fast::{BinGrid, FastFrame, FastPipeline, FastWorkspace};
use crate::render::frame::{Shot, SortPosition, position_of, slab};
use crate::render::lod::LodSelector;
use crate::render::pages::{DrawList, PageCount, PageProjection, first_page, number_of_pages, views_of};
use crate::render::scene::GpuScene;
use crate::render::shaders::Totals;
use crate::render::shaders::fast::{BIN_SEGMENT, BLOCKS, MAX_BIN_CHUNKS, NOT_STOPPED};

/// The stages and buffers that draw frames of the fast path in slabs.
pub struct FastSlabs {
    project: PageProjection,
    stages: FastStages,
    open_bins: OpenBins,
    buffers: SlabBuffers,
}

impl FastSlabs {
    pub fn new(device: &Device, fast: &FastPipeline, scene: &GpuScene) -> Result<Self> {
        Ok(Self {
            project: PageProjection::new(device, fast, None)?,
            stages: FastStages::new(device, fast)?,
            open_bins: OpenBins::new(device)?,
            buffers: SlabBuffers::new(device, scene)?,
        })
    }

    /// Makes the buffers of slabs of a grid as large as the free memory allows, unless they fit the grid already.
    ///
    /// # Errors
    /// [`OutOfMemory`] if there is too little for the smallest slab.
    pub fn fit(
        &mut self,
        device: &Device,
        work: &mut FastWorkspace,
        fast: &FastPipeline,
        grid: BinGrid,
        gaussians: usize,
    ) -> Result<()> {
        let cells = grid.count();
        if self.buffers.cells >= cells && work.capacity.cells >= cells as usize {
            return Ok(());
        }
        let elements = fast.splat_elements();
        *work = FastWorkspace::new(device, Capacity::default(), elements)?; // frees the old buffers first
        *work = FastWorkspace::new(device, slab_capacity(device.free_bytes(), elements, grid, gaussians), elements)?;
        self.buffers.cells = cells;
        Ok(())
    }

    /// Draws a frame with the capacity of its workspace, in as many slabs as that takes.
    ///
    /// # Errors
    /// [`OutOfMemory`] if the capacity is too small for a single splat, or a page cannot be read.
    pub fn draw(
        &mut self,
        device: &Device,
        frame: &FastFrame,
        mut selector: Option<&mut LodSelector>,
    ) -> Result<SlabbedFrame> {
        let FastFrame { work, options, shot, target, grid, .. } = *frame;
        let Shot { scene, camera, .. } = shot;
        self.stages.prepare(device, grid)?;
        let keys = frame.depth_keys();
        let end = position_of(keys.limit()) + position_of(1);
        let cells =
            CellGrid { cell_px: grid.bin_px(), cells: grid.bins, top_px: grid.top_px, keys, largest_key: keys.limit() };
        let selection = selector.as_mut().map(|selector| selector.select(device, shot, options)).transpose()?;
        let mut input = SlabInput::of(shot, options, cells, selection.as_ref());
        let mut progress =
            FrameProgress::begin(&mut input, end, scene.placed_len(), self.buffers.target, selection.as_ref());
        let mut cmd = Commands::new(device)?;
        let views = views_of(scene, camera, &options.rules);
        cmd.upload(&self.buffers.listed, 0, views.len(), |memory| memory.copy_from_slice(&views))?;
        let open = shot.open_cells(grid.bin_px(), grid.bins);
        cmd.upload(&self.open_bins.0[0], 0, open.len(), |memory| memory.copy_from_slice(&open))?;
        cmd.barrier(Access::COPY_WRITE, Access::SHADER_READ);
        // A frame that failed may have left counts behind.
        cmd.fill(&work.counters, 0);
        cmd.fill(&work.listed_in_bins, 0);
        if options.simplifies_hidden() {
            cmd.fill(&work.stop_keys, NOT_STOPPED);
        }
        cmd.scope("begin", |cmd| self.stages.begin(cmd, target.image, grid, &self.open_bins.0[0]));
        let _begun = cmd.submit()?;
        let mut before = 0;
        while let Some(next) = progress.partition.next() {
            let Some(slab) = self.start_slab(device, frame, &mut input, &next, before)? else {
                // No page has splats in the slab.
                progress.partition.advance(&next, 0.0);
                continue;
            };
            if let Some(following) = progress.partition.after(next.end) {
                // The pages of the next slab are read while the device draws. A page that cannot be read is reported
                // when a slab needs it.
                _ = input.load_ahead(device, &following);
            }
            let results = slab.commands.wait()?;
            progress.add_timings(results.timings());
            let totals = results.view(&slab.totals)[0];
            let filled = filled(&totals, frame);
            if filled > 1.0 {
                if !progress.partition.shorten(&next, filled) {
                    return Err(no_room(work).into());
                }
                continue;
            }
            progress.add_slab(&next, filled, &totals);
            before = 1 - before;
            if input.close(results.view(&slab.open_bins)) {
                break;
            }
            if input.has_closed_many() {
                progress.partition.set_estimate(input.estimate(end));
            }
        }
        let mut cmd = Commands::new(device)?;
        cmd.scope("finish", |cmd| self.stages.finish(cmd, target));
        selector.map_or(Ok(()), |selector| selector.occlusion.record(device, &mut cmd, frame))?;
        let results = cmd.submit()?.wait()?;
        progress.add_timings(results.timings());
        let (drawn, next_target) = progress.end(&input);
        self.buffers.target = next_target;
        Ok(drawn)
    }

    /// Submits one slab, which is blended on top of the states if its demand fits. `None` if no page has splats in it.
    /// `before`: the index of the bins that are open before it.
    fn start_slab(
        &self,
        device: &Device,
        frame: &FastFrame,
        input: &mut SlabInput,
        range: &Range<SortPosition>,
        before: usize,
    ) -> Result<Option<StartedSlab>> {
        let (scene, elements) = (frame.shot.scene, &self.buffers.listed);
        let (first, capacity) = (first_page(scene), self.buffers.page_capacity(scene));
        let [indices, levels] = scene.indices_and_lod(&self.buffers.no_words);
        let draw_list = DrawList { elements, first_page: first, indices, levels };
        let project = |cmd: &mut Commands, pages: usize| {
            cmd.scope("project", |cmd| {
                self.project.record(cmd, frame, &draw_list, PageCount::Known(pages), slab(range))
            });
        };
        let (mut cmd, mut earlier) = (Commands::new(device)?, Vec::new());
        match input {
            SlabInput::Whole(_) => project(&mut cmd, capacity),
            SlabInput::Paged(paged) => {
                let mut needed = paged.needed(range);
                if needed.is_empty() {
                    return Ok(None);
                }
                let batches = paged.batches(&mut needed, capacity);
                let last = batches.len() - 1;
                for (number, batch) in batches.into_iter().enumerate() {
                    let pages = paged.load(device, &needed[batch])?;
                    cmd.upload(elements, first as usize - 1, 1 + pages.len(), |memory| {
                        memory[0] = number_of_pages(pages.len());
                        memory[1..].copy_from_slice(&pages);
                    })?;
                    cmd.barrier(Access::COPY_WRITE, Access::SHADER_READ);
                    project(&mut cmd, pages.len());
                    if number < last {
                        // The pages of the next batch take the slots of these.
                        earlier.push(cmd.submit()?);
                        cmd = Commands::new(device)?;
                    }
                }
            }
        }
        let open = [&self.open_bins.0[before], &self.open_bins.0[1 - before]];
        self.stages.list_and_blend(&mut cmd, frame, open);
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        let (totals, open_bins) = (cmd.read(&frame.work.totals)?, cmd.read(open[1])?);
        Ok(Some(StartedSlab { commands: cmd.submit()?, _earlier: earlier, totals, open_bins }))
    }
}

/// A slab on the GPU.
struct StartedSlab {
    commands: InFlight,
    /// The batches of pages before the last. Dropping them waits for them.
    _earlier: Vec<InFlight>,
    totals: Readback<Totals>,
    open_bins: Readback<u32>,
}

/// The capacity of slabs whose buffers take about [`MEMORY_FRACTION`] of `free` bytes.
fn slab_capacity(free: u64, splat_elements: usize, grid: BinGrid, gaussians: usize) -> Capacity {
    let cells = u64::from(grid.count());
    // Bytes per bin: the begin of each chunk list, its record, a run, a segment of masks, the stop keys of its blocks.
    let fixed = cells * (4 * u64::from(MAX_BIN_CHUNKS + BIN_SEGMENT + BLOCKS) + 64) + (1 << 20);
    // Bytes per splat: ids, keys, ranges, one span, its record, and two and a half entries of 16 bytes.
    let each = 4 + 4 + 8 + 4 + 16 * splat_elements as u64 + 40;
    let bytes = (MEMORY_FRACTION * free as f64) as u64;
    let visible = (bytes.saturating_sub(fixed) / each).clamp(1024, MOST_SPLATS).min(gaussians.max(1024) as u64);
    let listed = (visible * 5 / 2).max(2 * cells);
    Capacity { gaussians, visible, spans: visible.max(1024), listed, cells: cells as usize }
}

/// The fraction of the capacity that a slab demanded.
fn filled(totals: &Totals, FastFrame { pipeline, work, .. }: &FastFrame) -> f64 {
    let demand = Capacity::of(totals, 0, 0);
    SlabBuffers::filled([
        (demand.visible, u64::from(work.visible_capacity())),
        (demand.spans, work.spans.len() as u64),
        (demand.listed, u64::from(work.entry_capacity())),
        (u64::from(totals.longest_list), u64::from(work.longest_list().min(pipeline.longest_list()))),
    ])
}

fn no_room(work: &FastWorkspace) -> OutOfMemory {
    let reason = format!("one splat touches more than {} bins", work.entry_capacity());
    OutOfMemory { name: "entries of bins".to_owned(), bytes: None, reason }
}
