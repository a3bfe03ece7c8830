//! The frame of one rung, stage by stage.

use std::mem::offset_of;
use std::time::Instant;

use anyhow::{Result, bail};
use smalto::camera::Camera;
use smalto::gpu::{Access, Buffer, Commands, Device, DispatchSize, Image, Stage, Staging};
use smalto::options::Options;
use smalto::pixels::Pixels;
use smalto::reference;
use smalto::render::shaders::portable::{DUPLICATE_CHUNK, SCAN_CHUNK, SORT_CHUNK};
use smalto::render::shaders::{PortableDispatches, ladder};
use smalto::render::{Capacity, GpuScene, Pairs, PortableStages, RadixSort, SortRange, Target, Totals};
use smalto::rules::{Background, Footprint, Rules, TILE};

use super::host_stages;
use super::rungs::{Blend, Duplication, Processor, Rung, Sort};
use super::steps::{StageTime, Steps};

/// Columns and rows of tiles of an image.
pub fn tiles(size_px: [u32; 2]) -> [u32; 2] {
    size_px.map(|side| side.div_ceil(TILE))
}

/// Renders pictures of one scene with the stages of a rung.
pub struct Variant<'s> {
    device: Device,
    rung: Rung,
    scene: &'s GpuScene,
    stages: PortableStages<'s>,
    /// The sort by all digits.
    sort: RadixSort,
    scatter: Stage<ladder::Duplicate>,
    gather: Stage<ladder::Gather>,
    /// The pipelines for the first pass over a tile's list and for the others.
    blend: [Stage<ladder::Blend>; 2],
    entries_per_pass: u32,
    extra: Extra,
    image: Image,
    passes: u32,
}

/// Buffers that only some rungs need; their length is 0 for the others.
struct Extra {
    /// The numbers from 0 on, as the order of splats that are not sorted.
    identity: Buffer<u32>,
    cursor: Buffer<u32>,
    /// Depth key and instance; then tile key and splat, in the order of depth.
    by_depth: Pairs,
    masks: Staging<u32>,
    ids: Staging<u32>,
    span_ranges: Staging<[u32; 2]>,
    spans: Staging<u32>,
    tile_keys: Staging<u32>,
    splat_ids: Staging<u32>,
    ranges: Staging<[u32; 2]>,
}

impl Extra {
    fn new(device: &Device, rung: &Rung, stages: &PortableStages) -> Result<Self> {
        let work = &stages.work;
        let (visible, instances) = (work.splats.len(), work.instances.keys[0].len());
        let when = |needed: bool, len: usize| if needed { len } else { 0 };
        let words = |name: &str, needed: bool, len: usize| Staging::<u32>::new(device, name, when(needed, len));
        let pairs = |name: &str, needed: bool, len: usize| Staging::<[u32; 2]>::new(device, name, when(needed, len));
        let (compacts, duplicates) = (rung.compaction == Processor::Cpu, rung.duplication == Duplication::Cpu);
        let (ranges, sorts_all) = (rung.ranges == Processor::Cpu, rung.sort == Sort::AllDigits);
        let identity = Buffer::new(device, "identity", when(sorts_all, visible))?;
        let mut cmd = Commands::new(device)?;
        cmd.upload(&identity, 0, identity.len(), |ids| ids.iter_mut().zip(0..).for_each(|(id, i)| *id = i))?;
        cmd.submit()?.wait()?;
        Ok(Self {
            identity,
            cursor: Buffer::new(device, "cursor", 1)?,
            by_depth: Pairs::new(device, "instance depth", when(sorts_all, instances))?,
            masks: words("host masks", compacts, work.visible_masks.len())?,
            ids: words("host ids", compacts, visible)?,
            span_ranges: pairs("host span ranges", duplicates, visible)?,
            spans: words("host spans", duplicates, work.spans.len())?,
            tile_keys: words("host tile keys", duplicates || ranges, instances)?,
            splat_ids: words("host splat ids", duplicates, instances)?,
            ranges: pairs("host ranges", ranges, work.ranges.len())?,
        })
    }
}

/// Times and counts of a frame.
pub struct VariantFrame {
    pub totals: Totals,
    pub stages: Vec<StageTime>,
    /// Wall time in milliseconds from the begin to the end of the last wait.
    pub wall_ms: f64,
}

/// Sorted tile keys and their splats.
struct Sorted {
    tile_keys: Buffer<u32>,
    splat_ids: Buffer<u32>,
}

/// More attempts than any frame needs: each grows to the requirements of the one before, and an overflow hides those of
/// the stages after it.
const MAX_ATTEMPTS: u32 = 8;

impl<'s> Variant<'s> {
    pub fn new(device: &Device, rung: &Rung, options: &Options, scene: &'s GpuScene) -> Result<Self> {
        let batch = match rung.blend {
            Blend::FromMemory => 0,
            Blend::Batches(batch) => batch,
            Blend::BallotExit | Blend::PixelBlocks => 256,
        };
        let [smallest_subgroup, largest_subgroup] = device.capabilities().subgroup_size;
        let ballot_words = largest_subgroup.div_ceil(32);
        let ballot_exit = rung.blend == Blend::BallotExit;
        let blend = |resume| {
            let rest = ladder::BlendConstants::default();
            Stage::new(device, &ladder::BlendConstants { batch, resume, ballot_exit, ballot_words, ..rest })
        };
        let single_pass = rung.duplication == Duplication::SingleAllocation;
        let extent = if rung.exact_tiles { options.rules.extent } else { Footprint::ThreeSigmaSquares };
        let options = Options { rules: Rules { extent, ..options.rules }, ..*options };
        let stages = PortableStages::new(device, &options, scene)?;
        Ok(Self {
            device: device.clone(),
            rung: *rung,
            scene,
            sort: RadixSort::new(device, smallest_subgroup, ballot_words)?,
            scatter: Stage::new(device, &ladder::DuplicateConstants { single_pass })?,
            gather: Stage::new(device, &())?,
            blend: [blend(false)?, blend(true)?],
            // One iteration per entry, and less than one for its share of loading a batch.
            entries_per_pass: device.capabilities().loop_limit.map_or(u32::MAX, |limit| limit / 2),
            extra: Extra::new(device, rung, &stages)?,
            stages,
            image: Image::new(device, "image", 1, 1)?,
            passes: 1,
        })
    }

    /// Renders a complete frame; [`Variant::pixels`] reads it.
    ///
    /// # Errors
    /// If rendering fails, or if the frame does not fit after several attempts.
    pub fn render(&mut self, camera: &Camera) -> Result<VariantFrame> {
        let [width, height] = camera.size_px;
        if self.image.size() != camera.size_px {
            self.image = Image::new(&self.device, "image", width, height)?;
        }
        let tiles: u32 = tiles(camera.size_px).iter().product();
        self.grow(Capacity { gaussians: self.scene.len(), cells: tiles as usize, ..Capacity::default() })?;
        for _ in 0..MAX_ATTEMPTS {
            let started = Instant::now();
            let (totals, stages) = self.attempt(camera)?;
            let passes = self.passes_for(totals.longest_list);
            let grew = self.grow(Capacity::of(&totals, self.scene.len(), tiles as usize))?;
            if !grew && passes <= self.passes {
                return Ok(VariantFrame { totals, stages, wall_ms: started.elapsed().as_secs_f64() * 1e3 });
            }
            self.passes = self.passes.max(passes);
        }
        bail!("a frame still overflows its buffers after growing {MAX_ATTEMPTS} times to its own counts")
    }

    /// Reads the picture that was rendered last.
    pub fn pixels(&self) -> Result<Pixels> {
        let size = self.image.size();
        let mut cmd = Commands::new(&self.device)?;
        let rows = cmd.read_rows(&self.image, 0..size[1])?;
        let results = cmd.submit()?.wait()?;
        Ok(Pixels { size, rgba: results.view(&rows).to_vec() })
    }

    fn grow(&mut self, demand: Capacity) -> Result<bool> {
        let grew = self.stages.work.grow(&self.device, demand)?;
        if grew {
            self.extra = Extra::new(&self.device, &self.rung, &self.stages)?;
        }
        Ok(grew)
    }

    fn passes_for(&self, longest_list: u32) -> u32 {
        match self.rung.blend {
            Blend::PixelBlocks => self.stages.passes(longest_list),
            _ => longest_list.div_ceil(self.entries_per_pass).max(1),
        }
    }

    /// Renders a frame with the present buffers. The returned totals tell if they were large enough.
    fn attempt(&mut self, camera: &Camera) -> Result<(Totals, Vec<StageTime>)> {
        let [tiles_x, tiles_y] = tiles(camera.size_px);
        let mut steps = Steps::new(&self.device)?;
        steps.cmd.scope("clear", |cmd| {
            cmd.fill(&self.stages.work.totals, 0);
            cmd.fill(&self.stages.work.ranges, 0);
            cmd.fill(&self.extra.cursor, 0);
        });
        steps.cmd.barrier(Access::COPY_WRITE, Access::SHADER);
        self.compact(&mut steps, camera)?;
        steps.cmd.scope("project", |cmd| self.stages.project(cmd, camera));
        steps.cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        let order = match self.rung.sort {
            Sort::AllDigits => self.extra.identity.clone(),
            Sort::DigitsNeeded => steps.cmd.scope("sort", |cmd| self.stages.sort_depths(cmd, camera).clone()),
        };
        self.duplicate(&mut steps, &order, tiles_x)?;
        let sorted = steps.cmd.scope("sort", |cmd| self.sort(cmd, tiles_x * tiles_y));
        self.ranges(&mut steps, &sorted.tile_keys, tiles_x * tiles_y)?;
        steps.cmd.scope("blend", |cmd| self.blend(cmd, camera, &sorted.splat_ids, tiles_x * tiles_y));
        steps.cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        let totals = steps.flush_and_read(&self.stages.work.totals)?;
        Ok((totals, steps.into_times()))
    }

    fn compact(&mut self, steps: &mut Steps, camera: &Camera) -> Result<()> {
        let (stages, work, extra) = (&self.stages, &self.stages.work, &mut self.extra);
        if self.rung.compaction == Processor::Gpu {
            steps.cmd.scope("cull", |cmd| {
                stages.cull(cmd, camera);
                cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
                stages.compact(cmd);
            });
            steps.cmd.barrier(Access::SHADER_WRITE, Access::SHADER | Access::INDIRECT);
            return Ok(());
        }
        steps.cmd.scope("cull", |cmd| {
            stages.cull(cmd, camera);
            cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
            cmd.download(&work.visible_masks, &extra.masks, extra.masks.len());
        });
        steps.flush()?;
        let visible = steps.on_host("cull", || host_stages::compact(extra.masks.map(), extra.ids.map()));
        let kept = visible.min(extra.ids.len());
        let totals = Totals { visible: visible as u32, visible_kept: kept as u32, ..bytemuck::Zeroable::zeroed() };
        steps.cmd.scope("cull", |cmd| {
            cmd.upload_staged(&extra.ids, &work.gaussian_from_splat, kept);
            set_totals(cmd, stages, totals)
        })?;
        steps.cmd.barrier(Access::COPY_WRITE, Access::SHADER | Access::INDIRECT);
        Ok(())
    }

    fn duplicate(&mut self, steps: &mut Steps, order: &Buffer<u32>, tiles_x: u32) -> Result<()> {
        let (stages, work, extra) = (&self.stages, &self.stages.work, &mut self.extra);
        match self.rung.duplication {
            Duplication::Balanced => {
                steps.cmd.scope("duplicate", |cmd| {
                    stages.scan(cmd, order);
                    cmd.barrier(Access::SHADER_WRITE, Access::SHADER | Access::INDIRECT);
                    stages.duplicate(cmd, order, tiles_x);
                });
                steps.cmd.barrier(Access::SHADER_WRITE, Access::SHADER | Access::INDIRECT);
            }
            kind @ (Duplication::TwoPass | Duplication::SingleAllocation) => {
                // The scan writes the dispatch counts that `project` was dispatched with.
                steps.cmd.barrier(Access::INDIRECT, Access::SHADER_WRITE);
                steps.cmd.scope("duplicate", |cmd| {
                    match kind {
                        Duplication::TwoPass => stages.scan(cmd, order),
                        _ => stages.scan_totals(cmd),
                    }
                    cmd.barrier(Access::SHADER_WRITE, Access::SHADER | Access::INDIRECT);
                    let bindings = ladder::DuplicateBindings {
                        totals: &work.totals,
                        splat_from_rank: order,
                        instance_offsets: &work.instance_offsets,
                        cursor: &extra.cursor,
                        span_ranges: &work.span_ranges,
                        spans: &work.spans,
                        tile_counts: &work.tile_counts,
                        tile_keys: &work.instances.keys[0],
                        splat_ids: &work.instances.values[0],
                    };
                    let groups = offset_of!(PortableDispatches, over_visible);
                    let push = ladder::DuplicatePush { tiles_x };
                    cmd.dispatch_indirect(&self.scatter, bindings, push, &work.dispatches, groups);
                });
                steps.cmd.barrier(Access::SHADER_WRITE, Access::SHADER | Access::INDIRECT);
            }
            Duplication::Cpu => {
                steps.cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
                let totals = steps.flush_and_read(&work.totals)?;
                let visible = totals.visible_kept as usize;
                let spans = (totals.spans as usize).min(work.spans.len());
                steps.cmd.scope("duplicate", |cmd| {
                    cmd.download(&work.span_ranges, &extra.span_ranges, visible);
                    cmd.download(&work.spans, &extra.spans, spans);
                });
                steps.flush()?;
                let made = steps.on_host("duplicate", || {
                    let (ranges, spans) = (&extra.span_ranges.map()[..visible], &extra.spans.map()[..spans]);
                    host_stages::duplicate(ranges, spans, tiles_x, extra.tile_keys.map(), extra.splat_ids.map())
                });
                let kept = made.min(extra.tile_keys.len());
                steps.cmd.scope("duplicate", |cmd| {
                    cmd.upload_staged(&extra.tile_keys, &work.instances.keys[0], kept);
                    cmd.upload_staged(&extra.splat_ids, &work.instances.values[0], kept);
                    set_totals(cmd, stages, Totals { listed_kept: kept as u32, ..totals })
                })?;
                steps.cmd.barrier(Access::COPY_WRITE, Access::SHADER | Access::INDIRECT);
            }
        }
        Ok(())
    }

    /// Sorts the instances by tile and depth. The last command is a barrier.
    fn sort(&self, cmd: &mut Commands, tiles: u32) -> Sorted {
        let (work, by_depth) = (&self.stages.work, &self.extra.by_depth);
        if self.rung.sort == Sort::DigitsNeeded {
            let [tile_keys, splat_ids] = self.stages.sort_tiles(cmd, tiles).map(Buffer::clone);
            return Sorted { tile_keys, splat_ids };
        }
        let (lengths, length_index) = (&work.totals.words(), offset_of!(Totals, listed_kept) / 4);
        let groups = (&work.dispatches, offset_of!(PortableDispatches, sort_instances));
        let gather = |cmd: &mut Commands, indices: &Buffer<u32>, table: &Buffer<u32>, gathered: &Buffer<u32>| {
            let bindings = ladder::GatherBindings { lengths, indices, table, gathered };
            let push = ladder::GatherPush { length_index: length_index as u32 };
            let groups = offset_of!(PortableDispatches, over_instances);
            cmd.dispatch_indirect(&self.gather, bindings, push, &work.dispatches, groups);
        };
        let all = |values_are_indices| SortRange { lengths, length_index, bits: u32::BITS, values_are_indices };
        let [tile_keys, splat_ids] = [&work.instances.keys[0], &work.instances.values[0]];
        gather(cmd, splat_ids, &work.depths.keys[0], &by_depth.keys[0]);
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        let sorted = self.sort.record(cmd, by_depth, &work.sort, all(true), groups);
        let instance_from_place = by_depth.values[sorted].clone();
        // The second sort first writes into the buffer of the permutation, which is no longer needed then.
        let by_tile = Pairs {
            keys: by_depth.keys.clone(),
            values: [by_depth.values[1 - sorted].clone(), instance_from_place.clone()],
        };
        gather(cmd, &instance_from_place, tile_keys, &by_tile.keys[0]);
        gather(cmd, &instance_from_place, splat_ids, &by_tile.values[0]);
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        let sorted = self.sort.record(cmd, &by_tile, &work.sort, all(false), groups);
        Sorted { tile_keys: by_tile.keys[sorted].clone(), splat_ids: by_tile.values[sorted].clone() }
    }

    fn ranges(&mut self, steps: &mut Steps, tile_keys: &Buffer<u32>, tiles: u32) -> Result<()> {
        let (stages, work, extra) = (&self.stages, &self.stages.work, &mut self.extra);
        if self.rung.ranges == Processor::Gpu {
            steps.cmd.scope("ranges", |cmd| stages.ranges(cmd, tile_keys));
            steps.cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
            return Ok(());
        }
        steps.cmd.barrier(Access::SHADER_WRITE | Access::COPY_WRITE, Access::COPY_READ);
        let instances = steps.flush_and_read(&work.totals)?.listed_kept as usize;
        steps.cmd.scope("ranges", |cmd| cmd.download(tile_keys, &extra.tile_keys, instances));
        steps.flush()?;
        steps.on_host("ranges", || {
            let ranges = reference::ranges(&extra.tile_keys.map()[..instances], tiles as usize);
            extra.ranges.map()[..ranges.len()].copy_from_slice(&ranges);
        });
        steps.cmd.scope("ranges", |cmd| cmd.upload_staged(&extra.ranges, &work.ranges, tiles as usize));
        steps.cmd.barrier(Access::COPY_WRITE, Access::SHADER);
        Ok(())
    }

    fn blend(&self, cmd: &mut Commands, camera: &Camera, splat_ids: &Buffer<u32>, tiles: u32) {
        let (work, image) = (&self.stages.work, &self.image);
        if self.rung.blend == Blend::PixelBlocks {
            let target = Target { image, certificate: None, background: Background::BLACK };
            return self.stages.blend(cmd, camera, splat_ids, target, self.passes);
        }
        for pass in 0..self.passes {
            if pass > 0 {
                cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
            }
            let bindings = ladder::BlendBindings {
                ranges: &work.ranges,
                splat_ids,
                splats: &work.splats,
                totals: &work.totals,
                image,
            };
            let push = ladder::BlendPush {
                size_px: image.size(),
                tiles,
                background: Background::BLACK.colour(),
                pass_begin: pass * self.entries_per_pass,
                pass_limit: self.entries_per_pass,
                last_pass: u32::from(pass + 1 == self.passes),
            };
            cmd.dispatch(&self.blend[usize::from(pass > 0)], bindings, push, DispatchSize::Groups(tiles.into()));
        }
    }
}

/// Writes the counts of a frame, and the dispatches over them, from the host.
fn set_totals(cmd: &mut Commands, stages: &PortableStages, totals: Totals) -> Result<()> {
    const WORKGROUP: u32 = 256; // invocations: WORKGROUP in workgroup.glsl
    let groups = |elements: u32, chunk: u32| {
        let [x, y] = DispatchSize::Groups(elements.div_ceil(chunk).into()).groups(1);
        [x, y, 1]
    };
    let (visible, instances) = (totals.visible_kept, totals.listed_kept);
    let dispatches = PortableDispatches {
        over_visible: groups(visible, WORKGROUP),
        sort_visible: groups(visible, SORT_CHUNK),
        scan_visible: groups(visible, SCAN_CHUNK),
        duplicate: groups(instances, DUPLICATE_CHUNK),
        sort_instances: groups(instances, SORT_CHUNK),
        over_instances: groups(instances, WORKGROUP),
    };
    cmd.upload(&stages.work.totals, 0, 1, |memory| memory[0] = totals)?;
    cmd.upload(&stages.work.dispatches, 0, 1, |memory| memory[0] = dispatches)
}
