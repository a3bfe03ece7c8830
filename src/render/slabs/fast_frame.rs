//! The loop that draws a frame slab by slab.

use std::ops::Range;

use anyhow::Result;

use super::fast_stages::{FastStages, OpenBins};
use super::input::{Cells, Supply, listed_at_first};
use super::partition::{Place, place_of, slab};
use super::progress::{Course, Drawn};
use crate::camera::Camera;
use crate::gpu::{Access, Buffer, Commands, Device, Image, InFlight, Readback};
use crate::host_memory::OutOfMemory;
use crate::options::Options;
use crate::render::capacity::Capacity;
use crate::render::fast::{BinGrid, FastPipeline, FastWorkspace};
use crate::render::frame::{DepthKeys, Shot, Target};
use crate::render::lod::Chooser;
use crate::render::pages::{Count, Element, Listed, PageProjection, first_page, number_of_pages, views_of};
use crate::render::scene::GpuScene;
use crate::render::shaders::Totals;
use crate::render::shaders::fast::{BIN_CHUNKS, BIN_STRETCH};

/// What drawing in slabs keeps from one frame to the next.
pub struct Slabs {
    project: PageProjection,
    stages: FastStages,
    open_bins: OpenBins,
    /// The views, then the pages.
    listed: Buffer<Element>,
    /// The indices of Gaussians and the words of levels, where no page has them.
    no_indices: Buffer<u32>,
    /// The splats that the first slab of the next frame is meant to have.
    target: f64,
    /// The grid that the buffers of the slabs were made for.
    cells: u32,
}

/// The most splats of a slab that there is room for: more would take memory for no time saved.
pub(crate) const MOST_SPLATS: u64 = 4 << 20;
/// The part of the free memory that the buffers of slabs may take.
pub(crate) const PART: f64 = 0.5;

impl Slabs {
    pub fn new(device: &Device, fast: &FastPipeline, scene: &GpuScene) -> Result<Self> {
        Ok(Self {
            project: PageProjection::new(device, fast, None)?,
            stages: FastStages::new(device, fast)?,
            open_bins: OpenBins::new(device)?,
            listed: listed_at_first(device, scene)?,
            no_indices: Buffer::new(device, "no indices", 1)?,
            target: f64::INFINITY,
            cells: 0,
        })
    }

    /// Makes the buffers of slabs of a grid as large as the free memory allows, unless they are there.
    ///
    /// # Errors
    /// [`OutOfMemory`] if there is too little for the least slab.
    pub fn fit(
        &mut self,
        device: &Device,
        work: &mut FastWorkspace,
        fast: &FastPipeline,
        grid: BinGrid,
        gaussians: usize,
    ) -> Result<()> {
        if self.cells >= grid.count() && work.capacity.cells >= grid.count() as usize {
            return Ok(());
        }
        let elements = fast.splat_elements();
        *work = FastWorkspace::new(device, Capacity::default(), elements)?; // frees the old buffers first
        *work = FastWorkspace::new(device, slab_capacity(device.free_bytes(), elements, grid, gaussians), elements)?;
        self.cells = grid.count();
        Ok(())
    }

    /// Draws a frame with the capacity of `work`, in as many slabs as that takes.
    ///
    /// # Errors
    /// [`OutOfMemory`] if the capacity is too small for a single splat, or a page cannot be read.
    pub fn draw(
        &mut self,
        device: &Device,
        (fast, work, options): (&FastPipeline, &FastWorkspace, &Options),
        chooser: Option<&mut Chooser>,
        Shot { scene, camera }: Shot,
        target: Target,
    ) -> Result<Drawn> {
        let grid = fast.grid(camera.size_px, scene.drawn_len(options));
        self.stages.prepare(device, grid)?;
        let keys = DepthKeys::of(camera, options, &scene.extent);
        let end = place_of(keys.limit()) + place_of(1);
        let cells = Cells { side_px: grid.bin_px(), count: grid.bins, largest_key: keys.limit() };
        let chosen = chooser.map(|chooser| chooser.chosen(device, scene, camera, options)).transpose()?;
        let mut supply = Supply::of(scene, camera, options, (keys, cells), chosen.as_ref());
        let mut course = Course::begin(&mut supply, end, scene.placed_len(), self.target);
        course.chose(chosen.as_ref());
        let mut cmd = Commands::new(device)?;
        let views = views_of(scene, camera, &options.rules);
        cmd.upload(&self.listed, 0, views.len(), |memory| memory.copy_from_slice(&views))?;
        cmd.fill(&self.open_bins.0[0], u32::MAX);
        // A frame that failed may have left counts behind.
        cmd.fill(&work.counters, 0);
        cmd.fill(&work.listed_in_bins, 0);
        cmd.scope("begin", |cmd| self.stages.begin(cmd, target.image));
        let _begun = cmd.submit()?;
        let frame = Frame { device, fast, work, options, scene, camera, grid, image: target.image };
        let mut before = 0;
        while let Some(next) = course.ends.next() {
            let Some(slab) = self.start_slab(&frame, &mut supply, &next, before)? else {
                // No page has anything to add here.
                course.ends.drawn(&next, 0.0);
                continue;
            };
            if let Some(following) = course.ends.after(next.end) {
                // While the device draws, the pages of the slab that probably follows are read.
                // A page that cannot be read is reported when it is needed.
                _ = supply.read_ahead(device, &following);
            }
            let results = slab.commands.wait()?;
            course.took(results.timings());
            let totals = results.view(&slab.totals)[0];
            let filled = filled(&totals, work, fast);
            if filled > 1.0 {
                if !course.ends.shorten(&next, filled) {
                    return Err(no_room(work).into());
                }
                continue;
            }
            course.blended(&next, filled, &totals);
            before = 1 - before;
            if supply.close(results.view(&slab.open_bins)) {
                break;
            }
            if supply.has_closed_many() {
                course.ends.renew(supply.estimate(end));
            }
        }
        let mut cmd = Commands::new(device)?;
        cmd.scope("finish", |cmd| self.stages.finish(cmd, target.image, target.background));
        let results = cmd.submit()?.wait()?;
        course.took(results.timings());
        let (drawn, target) = course.end(&supply);
        self.target = target;
        Ok(drawn)
    }

    /// Submits one slab, which is blended on top of the states if its demand fits. `None` if it has no page.
    fn start_slab(
        &self,
        frame: &Frame,
        supply: &mut Supply,
        range: &Range<Place>,
        before: usize,
    ) -> Result<Option<StartedSlab>> {
        let Frame { device, fast, work, options, scene, camera, grid, image } = *frame;
        let [indices, levels] = scene.indices_and_lod(&self.no_indices);
        let first = first_page(scene);
        let listed = Listed { scene, elements: &self.listed, first_page: first, indices, levels };
        let project = |cmd: &mut Commands, pages: usize| {
            let listed = (&listed, Count::Known(pages));
            cmd.scope("project", |cmd| {
                self.project.record(cmd, listed, (camera, options), slab(range), work, grid);
            });
        };
        let (mut cmd, mut earlier) = (Commands::new(device)?, Vec::new());
        match supply {
            Supply::Whole(_) => project(&mut cmd, self.listed.len() - first as usize),
            Supply::Paged(paged) => {
                let mut wanted = paged.wanted(range);
                if wanted.is_empty() {
                    return Ok(None);
                }
                let batches = paged.batches(&mut wanted, self.listed.len() - first as usize);
                let last = batches.len() - 1;
                for (number, batch) in batches.into_iter().enumerate() {
                    let pages = paged.bring(device, &wanted[batch])?;
                    cmd.upload(&self.listed, first as usize - 1, 1 + pages.len(), |memory| {
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
        self.stages.list_and_blend(&mut cmd, fast, work, grid, image, open);
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        let (totals, open_bins) = (cmd.read(&work.totals)?, cmd.read(open[1])?);
        Ok(Some(StartedSlab { commands: cmd.submit()?, _earlier: earlier, totals, open_bins }))
    }
}

/// A slab on the GPU.
struct StartedSlab {
    commands: InFlight,
    /// The batches of pages before the last. Dropped, they would be waited for.
    _earlier: Vec<InFlight>,
    totals: Readback<Totals>,
    open_bins: Readback<u32>,
}

/// What all slabs of a frame share.
struct Frame<'a> {
    device: &'a Device,
    fast: &'a FastPipeline,
    work: &'a FastWorkspace,
    options: &'a Options,
    scene: &'a GpuScene,
    camera: &'a Camera,
    grid: BinGrid,
    image: &'a Image,
}

/// The capacity of slabs whose buffers take about a part of `free` bytes.
fn slab_capacity(free: u64, splat_elements: usize, grid: BinGrid, gaussians: usize) -> Capacity {
    let cells = u64::from(grid.count());
    // Per bin: its place in every chunk's row of shares, itself, a run, a stretch of masks.
    let fixed = cells * (4 * u64::from(BIN_CHUNKS + BIN_STRETCH) + 64) + (1 << 20);
    // Per splat: ids, keys, ranges, one span, the splat, and two and a half entries of 16 bytes.
    let each = 4 + 4 + 8 + 4 + 16 * splat_elements as u64 + 40;
    let bytes = (PART * free as f64) as u64;
    let visible = (bytes.saturating_sub(fixed) / each).clamp(1024, MOST_SPLATS).min(gaussians.max(1024) as u64);
    let listed = (visible * 5 / 2).max(2 * cells);
    Capacity { gaussians, visible, spans: visible.max(1024), listed, cells: cells as usize }
}

/// The part of the capacity that a slab demanded; above 1, it was not drawn.
fn filled(totals: &Totals, work: &FastWorkspace, fast: &FastPipeline) -> f64 {
    let demand = Capacity::of(totals, 0, 0);
    let parts = [
        (demand.visible, u64::from(work.visible_capacity())),
        (demand.spans, work.spans.len() as u64),
        (demand.listed, u64::from(work.entry_capacity())),
        (u64::from(totals.longest_list), u64::from(work.longest_list().min(fast.longest_list()))),
    ];
    parts.map(|(demand, room)| demand as f64 / room.max(1) as f64).into_iter().fold(0.0, f64::max)
}

fn no_room(work: &FastWorkspace) -> OutOfMemory {
    let reason = format!("one splat touches more than {} bins", work.entry_capacity());
    OutOfMemory { name: "entries of bins".to_owned(), bytes: None, reason }
}
