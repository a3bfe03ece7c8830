//! Frames in slabs on the portable path: pictures, certificates and depths.
//!
//! The portable path orders splats of equal depth by the order in which they are projected. Here they come page by
//! page, so they are sorted by their indices first. All pages of a slab must be on the device at once.

use std::mem::offset_of;
use std::ops::Range;

use anyhow::Result;

use super::fast_frame::{MOST_SPLATS, PART};
use super::input::{Cells, Supply, listed_at_first};
use super::partition::{Place, place_of, slab};
use super::progress::{Course, Drawn};
use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Results, Stage};
use crate::host_memory::OutOfMemory;
use crate::options::Options;
use crate::render::capacity::Capacity;
use crate::render::frame::{DepthKeys, Shot, Target, tiles};
use crate::render::inspect::Inspector;
use crate::render::lod::Chooser;
use crate::render::pages::{Element, first_page, number_of_pages, views_of};
use crate::render::portable::{PortablePipeline, PortableWorkspace, Walk};
use crate::render::scene::GpuScene;
use crate::render::shaders::pages::PAGE;
use crate::render::shaders::slabs::*;
use crate::render::shaders::{PortableDispatches, Totals};
use crate::rules::TILE;

/// The stages of the portable path that differ where a frame is drawn in slabs, and their buffers.
pub struct PortableSlabs {
    cull: Stage<CullTiles>,
    project: Stage<ProjectTiles>,
    index: Stage<IndexSplats>,
    rank: Stage<RankDepths>,
    shade_depths: Stage<ShadeDepths>,
    /// The views, then the pages.
    listed: Buffer<Element>,
    /// The indices of Gaussians and the words of levels, where no page has them.
    no_indices: Buffer<u32>,
    /// The splats that the first slab of the next frame is meant to have.
    target: f64,
    /// The number of tiles that the buffers of the slabs were made for.
    cells: u32,
}

/// What all slabs of a frame share.
#[derive(Clone, Copy)]
struct Frame<'a> {
    device: &'a Device,
    pipeline: &'a PortablePipeline,
    work: &'a PortableWorkspace,
    options: &'a Options,
    shot: Shot<'a>,
    target: Target<'a>,
    keys: DepthKeys,
    inspector: Option<&'a Inspector>,
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
            listed: listed_at_first(device, scene)?,
            no_indices: Buffer::new(device, "no indices", 1)?,
            target: f64::INFINITY,
            cells: 0,
        })
    }

    /// Makes the buffers of slabs of a picture of this size as large as the free memory allows, unless they are there.
    ///
    /// # Errors
    /// [`OutOfMemory`] if there is too little for the least slab.
    pub fn fit(
        &mut self,
        device: &Device,
        work: &mut PortableWorkspace,
        size: [u32; 2],
        scene: &GpuScene,
    ) -> Result<()> {
        let cells: u32 = tiles(size).iter().product();
        if self.cells >= cells && work.capacity.cells >= cells as usize {
            return Ok(());
        }
        *work = PortableWorkspace::new(device, Capacity::default())?; // frees the old buffers first
        let pages = self.listed.len() - first_page(scene) as usize;
        let capacity = slab_capacity(device, pages * PAGE as usize, cells, scene.placed_len());
        *work = PortableWorkspace::new(device, capacity)?;
        self.cells = cells;
        Ok(())
    }

    /// Draws a frame with the capacity of `work`, in as many slabs as that takes.
    ///
    /// # Errors
    /// [`OutOfMemory`] if the capacity is too small for a single splat or its pages, or a page cannot be read.
    pub fn draw(
        &mut self,
        device: &Device,
        (pipeline, work, options): (&PortablePipeline, &PortableWorkspace, &Options),
        chooser: Option<&mut Chooser>,
        shot: Shot,
        target: Target,
        inspector: Option<&Inspector>,
    ) -> Result<Drawn> {
        let Shot { scene, camera } = shot;
        let keys = pipeline.depth_keys(scene, camera);
        let end = place_of(keys.limit());
        let cells = Cells { side_px: [TILE, TILE], count: tiles(camera.size_px), largest_key: keys.limit() - 1 };
        let chosen = chooser.map(|chooser| chooser.chosen(device, scene, camera, options)).transpose()?;
        let mut supply = Supply::of(scene, camera, options, (keys, cells), chosen.as_ref());
        let mut course = Course::begin(&mut supply, end, scene.placed_len(), self.target);
        course.chose(chosen.as_ref());
        let frame = Frame { device, pipeline, work, options, shot, target, keys, inspector };
        let mut goes_on = false;
        while let Some(next) = course.ends.next() {
            let filled = match self.list_slab(&frame, &mut supply, &next)? {
                Listed::Nothing => {
                    course.ends.drawn(&next, 0.0);
                    continue;
                }
                Listed::TooManyPages(filled) => filled,
                Listed::Counted(totals, results) => {
                    course.took(results.timings());
                    let filled = filled(&totals, work);
                    if filled <= 1.0 {
                        // A list has at most all splats of the slab.
                        let passes = pipeline.passes(totals.listed_kept.min(totals.visible_kept));
                        let how = Walk { passes, goes_on, is_last: false };
                        let (totals, results) = self.walk_lists(&frame, how)?;
                        course.took(results.timings());
                        course.blended(&next, filled, &totals);
                        goes_on = true;
                        continue;
                    }
                    filled
                }
            };
            if !course.ends.shorten(&next, filled) {
                let reason = "the Gaussians at one depth do not fit: raise the limit of memory".to_owned();
                return Err(OutOfMemory { name: "slab".to_owned(), bytes: None, reason }.into());
            }
        }
        let (totals, results) = self.finish(&frame, goes_on)?;
        course.took(results.timings());
        course.count(&totals);
        let (drawn, target) = course.end(&supply);
        self.target = target;
        Ok(drawn)
    }

    /// Projects the Gaussians of a slab and makes the lists of its tiles, which hold if its demand fits.
    fn list_slab(&self, frame: &Frame, supply: &mut Supply, range: &Range<Place>) -> Result<Listed> {
        let Frame { device, pipeline, work, options, shot: Shot { scene, camera }, keys, .. } = *frame;
        let mut cmd = Commands::new(device)?;
        let mut elements = views_of(scene, camera, &options.rules);
        let first_page = first_page(scene);
        let pages = match supply {
            Supply::Whole(_) => {
                let all = self.listed.len() - first_page as usize;
                elements.push(number_of_pages(all));
                all
            }
            Supply::Paged(paged) => {
                let wanted = paged.wanted(range);
                if wanted.is_empty() {
                    return Ok(Listed::Nothing);
                }
                let rooms = [self.listed.len() - first_page as usize, paged.pool.capacity()];
                let pages = [wanted.len(), paged.different(&wanted).len()];
                let parts = pages.iter().zip(&rooms).map(|(pages, room)| *pages as f64 / *room as f64);
                let filled = parts.fold(0.0, f64::max);
                if filled > 1.0 {
                    return Ok(Listed::TooManyPages(filled));
                }
                elements.push(number_of_pages(wanted.len()));
                elements.extend(paged.bring(device, &wanted)?);
                wanted.len()
            }
        };
        cmd.upload(&self.listed, 0, elements.len(), |memory| memory.copy_from_slice(&elements))?;
        cmd.barrier(Access::COPY_WRITE, Access::SHADER_READ);
        let [indices, levels] = scene.indices_and_lod(&self.no_indices);
        pipeline.clear(&mut cmd, work);
        cmd.scope("cull", |cmd| {
            let bindings = CullTilesBindings {
                bounds: &scene.bounds,
                visible_masks: &work.visible_masks,
                chunk_counts: &work.chunk_counts,
                listed: &self.listed,
                indices,
                levels,
            };
            let push = CullTilesPush {
                slab: slab(range),
                focal_px: camera.focal_px.as_vec2().to_array(),
                centre_px: camera.centre_px.as_vec2().to_array(),
                size_px: camera.size_px,
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
        pipeline.list(&mut cmd, camera, work, by_depth);
        if frame.inspector.is_some() {
            let bindings = ShadeDepthsBindings {
                totals: &work.totals,
                gaussian_from_splat: &work.gaussian_from_splat,
                bounds: &scene.bounds,
                listed: &self.listed,
                splats: &work.splats,
            };
            let push = ShadeDepthsPush {
                focal_px: camera.focal_px.as_vec2().to_array(),
                centre_px: camera.centre_px.as_vec2().to_array(),
                size_px: camera.size_px,
                first_page,
            };
            cmd.dispatch_indirect(&self.shade_depths, bindings, push, &work.dispatches, over_visible());
        }
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        let totals = cmd.read(&work.totals)?;
        let results = cmd.submit()?.wait()?;
        Ok(Listed::Counted(results.view(&totals)[0], results))
    }

    fn project(&self, cmd: &mut Commands, frame: &Frame) {
        let Frame { work, options, shot: Shot { scene, camera }, keys, .. } = *frame;
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
            listed: &self.listed,
            levels: scene.indices_and_lod(&self.no_indices)[1],
        };
        let push = ProjectTilesPush {
            focal_px: camera.focal_px.as_vec2().to_array(),
            centre_px: camera.centre_px.as_vec2().to_array(),
            size_px: camera.size_px,
            near: options.rules.near,
            first_page: first_page(scene),
            span_capacity: work.spans.len() as u32,
            depth_limit: keys.limit(),
            depth_shift: keys.shift,
        };
        cmd.dispatch_indirect(&self.project, bindings, push, &work.dispatches, over_visible());
    }

    /// Sorts the splats by depth, those of equal depth by index; returns the index of the sorted pair of `work.depths`.
    fn sort(&self, cmd: &mut Commands, frame: &Frame, indices: &Buffer<u32>) -> usize {
        let Frame { pipeline, work, keys, .. } = *frame;
        let (totals, dispatches) = (&work.totals, &work.dispatches);
        // The buffers of instances are free until splats are listed.
        let pairs = &work.instances;
        let bindings = IndexSplatsBindings {
            totals,
            gaussian_from_splat: &work.gaussian_from_splat,
            listed: &self.listed,
            indices,
            index_keys: &pairs.keys[0],
        };
        cmd.dispatch_indirect(
            &self.index,
            bindings,
            IndexSplatsPush { first_page: first_page(frame.shot.scene), gaussians: frame.shot.scene.nodes as u32 },
            dispatches,
            over_visible(),
        );
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        let sorted = pipeline.sort_visible(cmd, pairs, work, (32, true));
        let bindings = RankDepthsBindings {
            totals,
            splat_from_index: &pairs.values[sorted],
            unordered: &work.depths.keys[1],
            depth_keys: &work.depths.keys[0],
            splats: &work.depths.values[0],
        };
        cmd.dispatch_indirect(&self.rank, bindings, (), dispatches, over_visible());
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        pipeline.sort_visible(cmd, &work.depths, work, (keys.bits, false))
    }

    /// Walks the lists that `work` holds, on top of the states. Returns the counts after that.
    fn walk_lists(&self, frame: &Frame, how: Walk) -> Result<(Totals, Results)> {
        let mut cmd = Commands::new(frame.device)?;
        walk(&mut cmd, frame, how);
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        let totals = cmd.read(&frame.work.totals)?;
        let results = cmd.submit()?.wait()?;
        Ok((results.view(&totals)[0], results))
    }

    /// Turns the states into the picture, by a walk along empty lists.
    fn finish(&self, frame: &Frame, goes_on: bool) -> Result<(Totals, Results)> {
        let Frame { device, pipeline, work, shot: Shot { camera, .. }, .. } = *frame;
        let mut cmd = Commands::new(device)?;
        pipeline.clear(&mut cmd, work);
        pipeline.order_tiles(&mut cmd, work, tiles(camera.size_px).iter().product());
        let _cleared = cmd.submit()?;
        self.walk_lists(frame, Walk { passes: 1, goes_on, is_last: true })
    }
}

/// The lists of a slab.
enum Listed {
    /// No page has anything in the slab.
    Nothing,
    /// Its pages take so many times the room that there is.
    TooManyPages(f64),
    Counted(Totals, Results),
}

fn walk(cmd: &mut Commands, frame: &Frame, how: Walk) {
    let Frame { pipeline, work, shot, target, inspector, .. } = *frame;
    let splat_ids = pipeline.splat_ids(work, shot.camera);
    match inspector {
        None => cmd.scope("blend", |cmd| pipeline.blending.record(cmd, shot, work, splat_ids, target, how)),
        Some(inspector) => {
            cmd.scope("inspect", |cmd| inspector.walk_slab(cmd, pipeline, work, splat_ids, target, how));
        }
    }
}

fn over_visible() -> usize {
    offset_of!(PortableDispatches, over_visible)
}

/// The capacity of slabs whose buffers take about a part of the free memory. `listed`: Gaussians of all listed pages.
fn slab_capacity(device: &Device, listed: usize, cells: u32, gaussians: usize) -> Capacity {
    // Per splat: its id, itself, two pairs, ranges, counts, offsets, two spans, and six instances of two pairs; per
    // Gaussian of a page a bit, per tile its range and its classes.
    let (each, fixed) = (4 + 36 + 16 + 8 + 8 + 8 + 6 * 18, listed as u64 / 4 + 40 * u64::from(cells) + (2 << 20));
    let bytes = (PART * device.free_bytes() as f64) as u64;
    let most = device.capabilities().limits.storage_range / 48;
    let visible = (bytes.saturating_sub(fixed) / each).clamp(1024, MOST_SPLATS).min(most);
    let visible = visible.min(gaussians.max(1024) as u64);
    let instances = (6 * visible).max(2 * u64::from(cells));
    Capacity { gaussians: listed, visible, spans: 2 * visible.max(1024), listed: instances, cells: cells as usize }
}

/// The part of the capacity that a slab demanded; above 1, it is not blended.
fn filled(totals: &Totals, work: &PortableWorkspace) -> f64 {
    let (demand, room) = (Capacity::of(totals, 0, 0), work.capacity);
    let parts = [(demand.visible, room.visible), (demand.spans, room.spans), (demand.listed, room.listed)];
    parts.map(|(demand, room)| demand as f64 / room.max(1) as f64).into_iter().fold(0.0, f64::max)
}
