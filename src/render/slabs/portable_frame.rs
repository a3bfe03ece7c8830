//! A frame of the portable path, drawn slab by slab: a picture, a certificate or depths.
//!
//! The portable path orders splats of equal depth by the order in which they are projected. In slabs, this is the order
//! of pages, so splats are sorted by their indices first. All pages of a slab must be resident at once.

use std::mem::offset_of;
use std::ops::Range;

use anyhow::Result;

use super::buffers::{MEMORY_FRACTION, MOST_SPLATS, SlabBuffers};
use super::input::{CellGrid, SlabInput};
use super::progress::{FrameProgress, SlabbedFrame};
use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Results, Stage};
use crate::host_memory::OutOfMemory;
use crate::options::Options;
use crate::render::capacity::Capacity;
use crate::render::frame::{DepthKeys, Shot, SortPosition, Target, position_of, slab, tiles};
use crate::render::inspect::Inspector;
use crate::render::lod::LodSelector;
use crate::render::pages::{first_page, number_of_pages, views_of};
use crate::render::portable::{PortablePipeline, PortableWorkspace, Walk};
use crate::render::scene::GpuScene;
use crate::render::shaders::pages::PAGE;
use crate::render::shaders::slabs::*;
use crate::render::shaders::{PortableDispatches, Totals};
use crate::rules::TILE;

/// The stages and buffers that draw frames of the portable path in slabs.
pub struct PortableSlabs {
    cull: Stage<CullTiles>,
    project: Stage<ProjectTiles>,
    index: Stage<IndexSplats>,
    rank: Stage<RankDepths>,
    shade_depths: Stage<ShadeDepths>,
    buffers: SlabBuffers,
}

/// A frame of the portable path: the stages and the buffers that draw it, and what it shows.
#[derive(Clone, Copy)]
pub struct PortableFrame<'a> {
    pub pipeline: &'a PortablePipeline,
    pub work: &'a PortableWorkspace,
    /// The options of the frame. Their LOD limits may differ from those that the pipeline was built with.
    pub options: &'a Options,
    pub shot: Shot<'a>,
    pub target: Target<'a>,
    /// Set if the frame shows depths.
    pub inspector: Option<&'a Inspector>,
}

impl PortableFrame<'_> {
    fn depth_keys(&self) -> DepthKeys {
        self.pipeline.depth_keys(self.shot.scene, self.shot.camera)
    }
}

impl PortableSlabs {
    pub fn new(device: &Device, pipeline: &PortablePipeline, scene: &GpuScene) -> Result<Self> {
        let constants = pipeline.projecting();
        Ok(Self {
            cull: Stage::new(device, &CullTilesConstants::of(constants))?,
            project: Stage::new(device, &ProjectTilesConstants::of(constants))?,
            index: Stage::new(device, &())?,
            rank: Stage::new(device, &())?,
            shade_depths: Stage::new(device, &())?,
            buffers: SlabBuffers::new(device, scene)?,
        })
    }

    /// Makes the buffers of slabs of a picture of this size as large as the free memory allows, unless they fit the
    /// size already.
    ///
    /// # Errors
    /// [`OutOfMemory`] if there is too little for the smallest slab.
    pub fn fit(
        &mut self,
        device: &Device,
        work: &mut PortableWorkspace,
        size: [u32; 2],
        scene: &GpuScene,
    ) -> Result<()> {
        let cells: u32 = tiles(size).iter().product();
        if self.buffers.cells >= cells && work.capacity.cells >= cells as usize {
            return Ok(());
        }
        *work = PortableWorkspace::new(device, Capacity::default())?; // frees the old buffers first
        let gaussians = self.buffers.page_capacity(scene) * PAGE as usize;
        *work = PortableWorkspace::new(device, slab_capacity(device, gaussians, cells, scene.placed_len()))?;
        self.buffers.cells = cells;
        Ok(())
    }

    /// Draws a frame with the capacity of its workspace, in as many slabs as that takes.
    ///
    /// # Errors
    /// [`OutOfMemory`] if the capacity is too small for a single splat or its pages, or a page cannot be read.
    pub fn draw(
        &mut self,
        device: &Device,
        frame: &PortableFrame,
        selector: Option<&mut LodSelector>,
    ) -> Result<SlabbedFrame> {
        let PortableFrame { pipeline, work, options, shot, .. } = *frame;
        let scene = shot.scene;
        let keys = frame.depth_keys();
        let end = position_of(keys.limit());
        let (cell_px, cells, top_px) = ([TILE, TILE], tiles(shot.size()), shot.band.top);
        let cells = CellGrid { cell_px, cells, top_px, keys, largest_key: keys.limit() - 1 };
        let selection = selector.map(|selector| selector.select(device, shot, options)).transpose()?;
        let mut input = SlabInput::of(shot, options, cells, selection.as_ref());
        let mut progress =
            FrameProgress::begin(&mut input, end, scene.placed_len(), self.buffers.target, selection.as_ref());
        let mut goes_on = false;
        while let Some(next) = progress.partition.next() {
            let filled = match self.list_slab(device, frame, &mut input, &next)? {
                SlabLists::Empty => {
                    progress.partition.advance(&next, 0.0);
                    continue;
                }
                SlabLists::TooManyPages(filled) => filled,
                SlabLists::Counted(totals, results) => {
                    progress.add_timings(results.timings());
                    let filled = filled(&totals, work);
                    if filled <= 1.0 {
                        // A list has at most all splats of the slab.
                        let passes = pipeline.passes(totals.listed_kept.min(totals.visible_kept));
                        let walk = Walk { passes, goes_on, is_last: false };
                        let (totals, results) = submit_walk(device, frame, walk)?;
                        progress.add_timings(results.timings());
                        progress.add_slab(&next, filled, &totals);
                        goes_on = true;
                        continue;
                    }
                    filled
                }
            };
            if !progress.partition.shorten(&next, filled) {
                let reason = "the Gaussians at one depth do not fit: raise the limit of memory".to_owned();
                return Err(OutOfMemory { name: "slab".to_owned(), bytes: None, reason }.into());
            }
        }
        let (totals, results) = finish(device, frame, goes_on)?;
        progress.add_timings(results.timings());
        progress.add_totals(&totals);
        let (drawn, next_target) = progress.end(&input);
        self.buffers.target = next_target;
        Ok(drawn)
    }

    /// Projects the Gaussians of a slab and makes the lists of its tiles, which are complete if its demand fits.
    fn list_slab(
        &self,
        device: &Device,
        frame: &PortableFrame,
        input: &mut SlabInput,
        range: &Range<SortPosition>,
    ) -> Result<SlabLists> {
        let PortableFrame { pipeline, work, options, shot, .. } = *frame;
        let Shot { scene, camera, band, .. } = shot;
        let (keys, listed) = (frame.depth_keys(), &self.buffers.listed);
        let mut cmd = Commands::new(device)?;
        let mut elements = views_of(scene, camera, &options.rules);
        let first_page = first_page(scene);
        let capacity = self.buffers.page_capacity(scene);
        let pages = match input {
            SlabInput::Whole(_) => {
                elements.push(number_of_pages(capacity));
                capacity
            }
            SlabInput::Paged(paged) => {
                let needed = paged.needed(range);
                if needed.is_empty() {
                    return Ok(SlabLists::Empty);
                }
                let slots = (paged.distinct(&needed).len() as u64, paged.cache.capacity() as u64);
                let filled = SlabBuffers::filled([(needed.len() as u64, capacity as u64), slots]);
                if filled > 1.0 {
                    return Ok(SlabLists::TooManyPages(filled));
                }
                elements.push(number_of_pages(needed.len()));
                elements.extend(paged.load(device, &needed)?);
                needed.len()
            }
        };
        cmd.upload(listed, 0, elements.len(), |memory| memory.copy_from_slice(&elements))?;
        cmd.barrier(Access::COPY_WRITE, Access::SHADER_READ);
        let [indices, levels] = scene.indices_and_lod(&self.buffers.no_words);
        pipeline.clear(&mut cmd, work);
        cmd.scope("cull", |cmd| {
            let bindings = CullTilesBindings {
                bounds: &scene.bounds,
                visible_masks: &work.visible_masks,
                chunk_counts: &work.chunk_counts,
                draw_list: listed,
                indices,
                levels,
            };
            let push = CullTilesPush {
                slab: slab(range),
                focal_px: camera.focal_px.as_vec2().to_array(),
                centre_px: camera.centre_px.as_vec2().to_array(),
                size_px: camera.size_px,
                band: band.word(),
                near: options.rules.near,
                first_page,
                pages: pages as u32,
                depth_limit: keys.limit() - 1,
                depth_shift: keys.shift,
                gaussians: scene.nodes as u32,
            };
            cmd.dispatch(&self.cull, bindings, push, DispatchSize::Groups(pages as u64));
            cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
            pipeline.compact_chunks(cmd, pages as u32, work);
        });
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER | Access::INDIRECT);
        cmd.scope("project", |cmd| self.project(cmd, frame));
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        let by_depth = cmd.scope("sort depths", |cmd| self.sort(cmd, frame, indices));
        pipeline.list(&mut cmd, shot, work, by_depth);
        if frame.inspector.is_some() {
            let bindings = ShadeDepthsBindings {
                totals: &work.totals,
                gaussian_from_splat: &work.gaussian_from_splat,
                bounds: &scene.bounds,
                draw_list: listed,
                splats: &work.splats,
            };
            let push = ShadeDepthsPush {
                focal_px: camera.focal_px.as_vec2().to_array(),
                centre_px: camera.centre_px.as_vec2().to_array(),
                size_px: camera.size_px,
                band: band.word(),
                first_page,
            };
            cmd.dispatch_indirect(&self.shade_depths, bindings, push, &work.dispatches, over_visible());
        }
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        let totals = cmd.read(&work.totals)?;
        let results = cmd.submit()?.wait()?;
        Ok(SlabLists::Counted(results.view(&totals)[0], results))
    }

    fn project(&self, cmd: &mut Commands, frame: &PortableFrame) {
        let PortableFrame { work, options, shot, .. } = *frame;
        let Shot { scene, camera, band, .. } = shot;
        let keys = frame.depth_keys();
        let bindings = ProjectTilesBindings {
            gaussian_from_splat: &work.gaussian_from_splat,
            bounds: &scene.bounds,
            grids: &scene.grids,
            shapes: scene.shape_planes(),
            sh: scene.sh_planes(),
            splats: &work.splats,
            // The order of the indices takes the first pair.
            depth_keys: &work.depths.keys[1],
            span_ranges: &work.span_ranges,
            tile_counts: &work.tile_counts,
            spans: &work.spans,
            totals: &work.totals,
            draw_list: &self.buffers.listed,
            levels: scene.indices_and_lod(&self.buffers.no_words)[1],
        };
        let push = ProjectTilesPush {
            focal_px: camera.focal_px.as_vec2().to_array(),
            centre_px: camera.centre_px.as_vec2().to_array(),
            size_px: camera.size_px,
            band: band.word(),
            near: options.rules.near,
            first_page: first_page(scene),
            span_capacity: work.spans.len() as u32,
            depth_limit: keys.limit(),
            depth_shift: keys.shift,
        };
        cmd.dispatch_indirect(&self.project, bindings, push, &work.dispatches, over_visible());
    }

    /// Sorts the splats by depth, and by index at equal depth; returns the index of the sorted pair of `work.depths`.
    fn sort(&self, cmd: &mut Commands, frame: &PortableFrame, indices: &Buffer<u32>) -> usize {
        let PortableFrame { pipeline, work, shot: Shot { scene, .. }, .. } = *frame;
        let (totals, dispatches) = (&work.totals, &work.dispatches);
        // The buffers of instances are free until splats are listed.
        let pairs = &work.instances;
        let bindings = IndexSplatsBindings {
            totals,
            gaussian_from_splat: &work.gaussian_from_splat,
            draw_list: &self.buffers.listed,
            indices,
            index_keys: &pairs.keys[0],
        };
        cmd.dispatch_indirect(
            &self.index,
            bindings,
            IndexSplatsPush { first_page: first_page(scene), gaussians: scene.nodes as u32 },
            dispatches,
            over_visible(),
        );
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        let sorted = pipeline.sort_visible(cmd, pairs, work, 32, true);
        let bindings = RankDepthsBindings {
            totals,
            splat_from_index: &pairs.values[sorted],
            unordered: &work.depths.keys[1],
            depth_keys: &work.depths.keys[0],
            splats: &work.depths.values[0],
        };
        cmd.dispatch_indirect(&self.rank, bindings, (), dispatches, over_visible());
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        pipeline.sort_visible(cmd, &work.depths, work, frame.depth_keys().bits, false)
    }
}

/// The lists of a slab.
enum SlabLists {
    /// No page has splats in the slab.
    Empty,
    /// The pages of the slab exceed the capacity of the cache or of the list by this factor.
    TooManyPages(f64),
    Counted(Totals, Results),
}

/// Walks the lists that the workspace holds, on top of the states. Returns the counts after that.
fn submit_walk(device: &Device, frame: &PortableFrame, walk: Walk) -> Result<(Totals, Results)> {
    let PortableFrame { pipeline, work, shot, target, inspector, .. } = *frame;
    let splat_ids = pipeline.splat_ids(work, shot.tiles());
    let mut cmd = Commands::new(device)?;
    match inspector {
        None => cmd.scope("blend", |cmd| pipeline.blending.record(cmd, shot, work, splat_ids, target, walk)),
        Some(inspector) => {
            cmd.scope("inspect", |cmd| {
                inspector.walk_slab(cmd, pipeline, work, splat_ids, (target, frame.shot.band), walk)
            });
        }
    }
    cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
    let totals = cmd.read(&work.totals)?;
    let results = cmd.submit()?.wait()?;
    Ok((results.view(&totals)[0], results))
}

/// Turns the states into the picture, by a walk along empty lists.
fn finish(device: &Device, frame: &PortableFrame, goes_on: bool) -> Result<(Totals, Results)> {
    let PortableFrame { pipeline, work, shot, .. } = *frame;
    let mut cmd = Commands::new(device)?;
    pipeline.clear(&mut cmd, work);
    pipeline.order_tiles(&mut cmd, work, shot.tiles());
    let _cleared = cmd.submit()?;
    submit_walk(device, frame, Walk { passes: 1, goes_on, is_last: true })
}

fn over_visible() -> usize {
    offset_of!(PortableDispatches, over_visible)
}

/// The capacity of slabs whose buffers take about [`MEMORY_FRACTION`] of the free memory. `listed`: the number of
/// Gaussians in all pages that the list holds.
fn slab_capacity(device: &Device, listed: usize, cells: u32, gaussians: usize) -> Capacity {
    // Bytes per splat: its id, its record, two pairs, ranges, counts, offsets, two spans, and six instances of two
    // pairs; per Gaussian of a page a bit, per tile its range and its classes.
    let (each, fixed) = (4 + 36 + 16 + 8 + 8 + 8 + 6 * 18, listed as u64 / 4 + 40 * u64::from(cells) + (2 << 20));
    let bytes = (MEMORY_FRACTION * device.free_bytes() as f64) as u64;
    let most = device.capabilities().limits.storage_range / 48;
    let visible = (bytes.saturating_sub(fixed) / each).clamp(1024, MOST_SPLATS).min(most);
    let visible = visible.min(gaussians.max(1024) as u64);
    let instances = (6 * visible).max(2 * u64::from(cells));
    Capacity { gaussians: listed, visible, spans: 2 * visible.max(1024), listed: instances, cells: cells as usize }
}

/// The fraction of the capacity that a slab demanded.
fn filled(totals: &Totals, work: &PortableWorkspace) -> f64 {
    let (demand, capacity) = (Capacity::of(totals, 0, 0), work.capacity);
    SlabBuffers::filled([
        (demand.visible, capacity.visible),
        (demand.spans, capacity.spans),
        (demand.listed, capacity.listed),
    ])
}
