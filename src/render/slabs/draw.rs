//! The loop that draws a frame slab by slab.

use std::ops::Range;
use std::time::Instant;

use anyhow::Result;

use super::cut::{Cut, Place, place_of, slab};
use super::fast::{FastStages, OpenBins};
use super::listed::{Element, Listed, first_page, views_of};
use super::parts::Parts;
use super::supply::{Cells, Supply, listed_at_first};
use crate::camera::Camera;
use crate::gpu::{Access, Buffer, Commands, Device, Image, InFlight, Readback, Timing};
use crate::host_memory::OutOfMemory;
use crate::options::Options;
use crate::render::capacity::Capacity;
use crate::render::fast::{BinGrid, FastPipeline, FastWorkspace};
use crate::render::frame::{DepthKeys, Shot, Target};
use crate::render::gpu_scene::GpuScene;
use crate::render::shaders::Totals;

/// What drawing in slabs keeps from one frame to the next.
pub struct Slabs {
    stages: FastStages,
    open_bins: OpenBins,
    /// The views, then the pages.
    listed: Buffer<Element>,
    /// The indices of Gaussians, where no page has them.
    no_indices: Buffer<u32>,
    /// The splats that the first slab of the next frame is meant to have.
    target: f64,
    /// The grid that the buffers of the slabs were made for.
    cells: u32,
}

/// The report of a frame that was drawn in slabs.
#[derive(Clone, Debug)]
pub struct Drawn {
    /// The sums over all slabs; the longest list of any.
    pub totals: Totals,
    /// The sums over all slabs, by stage.
    pub timings: Vec<Timing>,
    pub parts: Parts,
}

/// The most splats of a slab that there is room for: more would take memory for no time saved.
pub(super) const MOST_SPLATS: u64 = 4 << 20;
/// The most splats that a slab of a scene in pages is meant to have. After each slab, what is hidden by then is not
/// read any more.
pub(super) const PAGED_SPLATS: f64 = 1.0e6;
/// The part of the free memory that the buffers of slabs may take.
pub(super) const PART: f64 = 0.5;

impl Slabs {
    pub fn new(device: &Device, fast: &FastPipeline, scene: &GpuScene) -> Result<Self> {
        Ok(Self {
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
        Shot { scene, camera }: Shot,
        target: Target,
    ) -> Result<Drawn> {
        let grid = fast.grid(camera.size_px, scene.placed_len());
        self.stages.prepare(device, grid)?;
        let keys = DepthKeys::of(camera, options, &scene.extent);
        let end = place_of(keys.limit()) + place_of(1);
        let mut supply = Supply::of(
            scene,
            camera,
            options,
            keys,
            Cells { side_px: grid.bin_px(), count: grid.bins, largest_key: keys.limit() },
        );
        let estimate = supply.estimate(end);
        let most = if scene.is_paged() { PAGED_SPLATS.max(estimate.splats() / 24.0) } else { f64::INFINITY };
        let mut cut = Cut::new(estimate, scene.placed_len(), self.target, most);
        let mut first_target = None;
        let mut drawn = Drawn { totals: bytemuck::Zeroable::zeroed(), timings: Vec::new(), parts: supply.parts() };
        let begun = Instant::now();
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
        while let Some(next) = cut.next() {
            let Some(slab) = self.start_slab(&frame, &mut supply, &next, before)? else {
                // No page has anything to add here.
                cut.drawn(&next, 0.0);
                continue;
            };
            if let Some(following) = cut.after(next.end) {
                // While the device draws, the pages of the slab that probably follows are read.
                // A page that cannot be read is reported when it is needed.
                _ = supply.read_ahead(device, &following);
            }
            let results = slab.commands.wait()?;
            add_timings(&mut drawn.timings, results.timings());
            let totals = results.view(&slab.totals)[0];
            let filled = filled(&totals, work, fast);
            if filled > 1.0 {
                if !cut.shorten(&next, filled) {
                    return Err(no_room(work).into());
                }
                continue;
            }
            first_target.get_or_insert(cut.target());
            cut.drawn(&next, filled);
            add(&mut drawn.totals, &totals);
            drawn.parts.slabs += 1;
            before = 1 - before;
            if supply.close(results.view(&slab.open_bins)) {
                break;
            }
            if supply.has_closed_many() {
                cut.renew(supply.estimate(end));
            }
        }
        let mut cmd = Commands::new(device)?;
        cmd.scope("finish", |cmd| self.stages.finish(cmd, target.image, target.background));
        let results = cmd.submit()?.wait()?;
        add_timings(&mut drawn.timings, results.timings());
        // The next frame begins with a slab that is likely to fit.
        drawn.parts = Parts { wall_ms: 1e3 * begun.elapsed().as_secs_f64(), ..supply.since(drawn.parts) };
        self.target = if drawn.parts.slabs == 1 { f64::INFINITY } else { first_target.unwrap_or(f64::INFINITY) };
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
        let indices = supply.indices().unwrap_or_else(|| self.no_indices.clone());
        let first = first_page(scene);
        let listed =
            |pages: u32| Listed { scene, elements: &self.listed, pages: first..first + pages, indices: &indices };
        let project = |cmd: &mut Commands, pages: u32| {
            let (listed, slab) = (listed(pages), slab(range));
            cmd.scope("project", |cmd| self.stages.project(cmd, &listed, (camera, options), slab, work, grid));
        };
        let (mut cmd, mut earlier) = (Commands::new(device)?, Vec::new());
        match supply {
            Supply::Whole(_) => project(&mut cmd, self.listed.len() as u32 - first),
            Supply::Paged(paged) => {
                let mut wanted = paged.wanted(range);
                if wanted.is_empty() {
                    return Ok(None);
                }
                let batches = paged.batches(&mut wanted, self.listed.len() - first as usize);
                let last = batches.len() - 1;
                for (number, batch) in batches.into_iter().enumerate() {
                    let pages = paged.bring(device, &wanted[batch])?;
                    cmd.upload(&self.listed, first as usize, pages.len(), |memory| {
                        memory.copy_from_slice(&pages);
                    })?;
                    cmd.barrier(Access::COPY_WRITE, Access::SHADER_READ);
                    project(&mut cmd, pages.len() as u32);
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
    let fixed = cells * (4 * 264 + 64 + 4096) + (1 << 20);
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

pub(super) fn add(sum: &mut Totals, totals: &Totals) {
    sum.visible = sum.visible.saturating_add(totals.visible);
    sum.visible_kept = sum.visible_kept.saturating_add(totals.visible_kept);
    sum.spans = sum.spans.saturating_add(totals.spans);
    let listed = |totals: &Totals| u64::from(totals.listed_high) << 32 | u64::from(totals.listed_low);
    let all = listed(sum) + listed(totals);
    (sum.listed_high, sum.listed_low) = ((all >> 32) as u32, all as u32);
    sum.listed_kept = sum.listed_kept.saturating_add(totals.listed_kept);
    sum.longest_list = sum.longest_list.max(totals.longest_list);
    let long = |low: u32, high: u32| u64::from(high) << 32 | u64::from(low);
    let evaluations =
        long(sum.evaluations_low, sum.evaluations_high) + long(totals.evaluations_low, totals.evaluations_high);
    (sum.evaluations_high, sum.evaluations_low) = ((evaluations >> 32) as u32, evaluations as u32);
    let walked = long(sum.walked_low, sum.walked_high) + long(totals.walked_low, totals.walked_high);
    (sum.walked_high, sum.walked_low) = ((walked >> 32) as u32, walked as u32);
    sum.stopped_pixels += totals.stopped_pixels;
    sum.listed_tiles = sum.listed_tiles.max(totals.listed_tiles);
}

/// Adds the times of the stages of a slab, which become the inner scopes of a frame.
pub(super) fn add_timings(sum: &mut Vec<Timing>, slab: &[Timing]) {
    for timing in slab {
        match sum.iter_mut().find(|known| known.name == timing.name) {
            Some(known) => known.duration_ms += timing.duration_ms,
            None => sum.push(Timing { depth: 1, ..timing.clone() }),
        }
    }
}
