//! The choice of a path for each frame, and the buffers of both paths.

mod engines;

use std::panic::resume_unwind;
use std::time::Duration;

use anyhow::Result;

use crate::camera::Camera;
use crate::gpu::{Buffer, Commands, Device};
use crate::host_memory::OutOfMemory;
use crate::options::Options;
use crate::packing::Layout;
use crate::render::capacity::{Capacity, has_memory};
use crate::render::fast::{FastPipeline, FastWorkspace};
use crate::render::frame::{Shot, Target, Variation, tiles};
use crate::render::inspect::{Attribute, Inspector};
use crate::render::lod::{AtOnce, Chooser};
use crate::render::path::{Limits, Path};
use crate::render::portable::{PortablePipeline, PortableWorkspace};
use crate::render::recorded::OfPages;
use crate::render::scene::{GpuScene, TRIAL};
use crate::render::shaders::Totals;
use crate::render::slabs::{PortableSlabs, Slabs};
use crate::render::streaming::Feed;

/// The portable path, which draws everything, and the fast path where the device and the options allow it.
pub(crate) struct PathChoice {
    /// Made when it draws for the first time: where the fast path draws, it is seldom needed.
    portable: Option<PortablePipeline>,
    variation: Variation,
    /// Those that the stages were made for, with limits of levels of their own.
    pub options: Options,
    layout: Layout,
    pub work: PortableWorkspace,
    /// Blend dispatches of a frame on the portable path.
    passes: u32,
    /// The last frame on the portable path did not fit at once.
    needs_slabs: bool,
    slabs: Option<PortableSlabs>,
    /// Chooses the pages of a scene in pages.
    chooser: Option<Chooser>,
    /// Brings the pages of pictures that do not wait for them.
    pub feed: Option<Feed>,
    /// The next frame repeats one that did not fit. It shows the same pages: with more, it might not fit again.
    pub is_repeated: bool,
    fast: Option<Fast>,
    /// Why the fast path is not taken although the device has it.
    pub notice: Option<String>,
    /// The time that the trial of the fast path took, if there was one.
    pub trial_time: Option<Duration>,
}

/// The fast path and its buffers.
struct Fast {
    pipeline: FastPipeline,
    work: FastWorkspace,
    /// The last frame did not fit at once.
    needs_slabs: bool,
    slabs: Option<Slabs>,
    /// Draws scenes in pages at once.
    at_once: Option<AtOnce>,
}

impl PathChoice {
    /// Builds the paths that suit the device, the options and the variation.
    pub fn new(device: &Device, options: &Options, scene: &GpuScene, variation: Variation) -> Result<Self> {
        let layout = scene.layout();
        // Counts, certificates and inspections are those of the portable path.
        let fast = match variation {
            Variation::Plain => FastPipeline::new(device, options, layout)?,
            Variation::Counting | Variation::Certifying => None,
        };
        // A scene in pages is drawn in slabs, whose buffers are made for the first picture.
        let gaussians = if scene.is_paged() { scene.len().min(TRIAL) } else { scene.len() };
        let guess = Capacity::guess(device, gaussians, 1);
        let fast = fast.map(|pipeline| {
            let guess = FastWorkspace::guess(device, guess);
            let elements = pipeline.splat_elements();
            let work = match FastWorkspace::new(device, guess, elements) {
                Err(error) if error.is::<OutOfMemory>() => FastWorkspace::new(device, Capacity::default(), elements)?,
                other => other?,
            };
            anyhow::Ok(Fast { pipeline, work, needs_slabs: false, slabs: None, at_once: None })
        });
        let fast = fast.transpose()?;
        let portable = || PortablePipeline::varied(device, options, layout, variation);
        Ok(Self {
            portable: if fast.is_some() { None } else { Some(portable()?) },
            variation,
            options: *options,
            layout: layout.clone(),
            // Where the fast path draws, the portable one needs no buffers.
            work: match PortableWorkspace::new(device, if fast.is_some() { Capacity::default() } else { guess }) {
                Err(error) if error.is::<OutOfMemory>() => PortableWorkspace::new(device, Capacity::default())?,
                other => other?,
            },
            passes: 1,
            needs_slabs: false,
            slabs: None,
            chooser: scene.paged().map(|paged| Chooser::new(device, scene, paged)).transpose()?,
            feed: None,
            is_repeated: false,
            fast,
            notice: (variation == Variation::Certifying && FastPipeline::subgroup(device, options).is_some()).then(|| {
                "the portable path draws, since only it makes certificates; without --certificate the fast path draws"
                    .to_owned()
            }),
            trial_time: None,
        })
    }

    /// The fast path, if it may draw.
    pub fn fast(&self) -> Option<&FastPipeline> {
        self.fast.as_ref().map(|fast| &fast.pipeline)
    }

    /// Makes the pipelines of both paths and of all block heights at the same time: a driver compiles on the thread
    /// that asks for a pipeline.
    pub fn make_all_pipelines(&mut self, device: &Device) -> Result<()> {
        let Self { portable, fast, options, layout, variation, .. } = self;
        std::thread::scope(|threads| {
            let making = portable
                .is_none()
                .then(|| threads.spawn(|| PortablePipeline::varied(device, options, layout, *variation)));
            let heights = fast.as_mut().map_or(Ok(()), |fast| fast.pipeline.make_all_heights(device));
            if let Some(making) = making {
                *portable = Some(making.join().unwrap_or_else(|panic| resume_unwind(panic))?);
            }
            heights
        })
    }

    /// Makes the pipelines of the portable path, if there are none yet.
    pub fn make_portable(&mut self, device: &Device) -> Result<()> {
        if self.portable.is_none() {
            self.portable = Some(PortablePipeline::varied(device, &self.options, &self.layout, self.variation)?);
        }
        Ok(())
    }

    /// The portable path.
    ///
    /// # Panics
    /// If no frame on it was prepared yet.
    pub fn portable(&self) -> &PortablePipeline {
        self.portable.as_ref().expect("a frame on the portable path was prepared")
    }

    /// Ends a trial of the fast path, and drops that if its picture differs from the portable path's by `disagreement`.
    pub fn end_trial(&mut self, device: &Device, gaussians: usize, disagreement: Option<f32>) -> Result<()> {
        (self.passes, self.needs_slabs) = (1, false);
        let mut capacity = Capacity::default();
        if let Some(fast) = &mut self.fast {
            fast.needs_slabs = false;
        }
        if let Some(difference) = disagreement {
            self.fast = None;
            capacity = Capacity::guess(device, gaussians, 1);
            self.notice = Some(format!(
                "the fast path is not taken: on this device its picture differs from the portable path's by \
                 {difference:.3}"
            ));
        }
        self.work = PortableWorkspace::new(device, capacity)?;
        Ok(())
    }

    #[cfg(test)]
    pub fn replace_fast(&mut self, pipeline: FastPipeline) {
        self.fast.as_mut().expect("there is a fast path").pipeline = pipeline;
    }

    /// Sets the index in `fast::BLOCK_HEIGHTS` for all pictures of the fast path. With `None`, each
    /// picture takes the height that suits it.
    pub fn force_block_height(&mut self, height: Option<usize>) {
        if let Some(fast) = &mut self.fast {
            fast.pipeline.forced_block_height = height;
        }
    }

    /// Replaces the buffers by ones of this capacity.
    pub fn set_capacity(&mut self, device: &Device, capacity: Capacity) -> Result<()> {
        match &mut self.fast {
            Some(fast) => fast.work = FastWorkspace::new(device, capacity, fast.pipeline.splat_elements())?,
            None => self.work = PortableWorkspace::new(device, capacity)?,
        }
        Ok(())
    }

    /// Frees the buffers of both paths.
    pub fn release(&mut self, device: &Device) -> Result<()> {
        self.work = PortableWorkspace::new(device, Capacity::default())?;
        if let Some(fast) = &mut self.fast {
            fast.work = FastWorkspace::new(device, Capacity::default(), fast.pipeline.splat_elements())?;
        }
        Ok(())
    }

    /// Every buffer's name and bytes.
    pub fn buffers(&self) -> Vec<(&str, u64)> {
        let fast = self.fast.iter().flat_map(|fast| fast.work.buffers());
        let chooser = self.chooser.iter().flat_map(Chooser::buffers);
        self.work.buffers().into_iter().chain(fast).chain(chooser).collect()
    }

    /// The counts of a frame on `path`.
    pub fn totals(&self, path: Path) -> &Buffer<Totals> {
        match &self.fast {
            Some(fast) if path == Path::Fast => &fast.work.totals,
            _ => &self.work.totals,
        }
    }

    /// The fewest bytes that every stage of a frame on `path` moves.
    pub fn least_bytes(&self, path: Path, shot: Shot, totals: &Totals) -> Vec<(&'static str, u64)> {
        let mut stages = match &self.fast {
            Some(fast) if path == Path::Fast => fast.pipeline.least_bytes(shot, totals),
            _ => self.portable().least_bytes(shot, totals),
        };
        // Of frames in slabs: the states of pixels out; in, and out as the picture.
        let pixels: u64 = shot.camera.size_px.iter().map(|side| u64::from(*side)).product();
        stages.extend([("begin", 16 * pixels), ("finish", 32 * pixels)]);
        stages.extend(self.chooser.iter().flat_map(Chooser::least_bytes));
        stages
    }

    /// True if the fast path shows attributes: of scenes with levels of detail, whose pages it draws.
    pub fn shows_attributes(&self) -> bool {
        self.fast.is_some() && self.chooser.as_ref().is_some_and(Chooser::has_levels)
    }

    /// Chooses the path of a frame of this size and makes its buffers large enough for it. `needs_tile_lists` rules the
    /// fast path out; `attribute` is what that shows in place of colours.
    pub fn prepare(
        &mut self,
        device: &Device,
        scene: &GpuScene,
        camera: &Camera,
        needs_tile_lists: bool,
        attribute: Option<Attribute>,
    ) -> Result<Limits> {
        let size = camera.size_px;
        let (gaussians, is_paged) = (scene.placed_len(), scene.is_paged());
        let wants_levels = self.options.wants_levels();
        let demand = |cells: u32| Capacity { gaussians, cells: cells as usize, ..Capacity::default() };
        let crowd = scene.drawn_len(&self.options);
        let is_possible = |fast: &&mut Fast| !needs_tile_lists && fast.pipeline.takes(size, crowd);
        if let Some(fast) = self.fast.as_mut().filter(is_possible) {
            let grid = fast.pipeline.grid(size, crowd);
            // The first picture of a scene without levels reads only the pages that are not hidden.
            let is_first = fast.slabs.is_none();
            let reads_pages =
                scene.paged().is_some_and(|paged| !wants_levels && (is_first || !paged.cache().fits_all()));
            let in_slabs =
                fast.needs_slabs || reads_pages || !has_memory(fast.work.grow(device, demand(grid.count()), 0))?;
            if !in_slabs {
                fast.pipeline.prepare(device, grid)?;
                if is_paged && fast.at_once.as_ref().is_none_or(|at_once| at_once.attribute != attribute) {
                    fast.at_once = Some(AtOnce::new(device, &fast.pipeline, attribute)?);
                }
                if let (Some(feed), Some(chooser), false) = (&mut self.feed, &mut self.chooser, self.is_repeated) {
                    feed.advance(device, chooser, camera)?;
                }
            }
            fast.needs_slabs = in_slabs;
            let longest_list = fast.pipeline.longest_list().min(fast.work.longest_list());
            let capacity = fast.work.capacity;
            return Ok(Limits { path: Path::Fast, in_slabs, capacity, longest_list });
        }
        let in_slabs = self.needs_slabs
            || is_paged
            || !has_memory(self.work.grow(device, demand(tiles(size).iter().product())).map(drop))?;
        self.make_portable(device)?;
        let longest_list = self.portable().longest_list(self.passes);
        Ok(Limits { path: Path::Portable, in_slabs, capacity: self.work.capacity, longest_list })
    }

    /// Records a frame that [`prepare`](Self::prepare) made buffers for. Of a scene in pages, returns how its pages
    /// were chosen.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn record(
        &self,
        cmd: &mut Commands,
        shot: Shot,
        target: Target,
        limits: Limits,
        inspector: Option<&Inspector>,
    ) -> Result<Option<OfPages>> {
        match (&self.fast, inspector) {
            (Some(fast), _) if limits.path == Path::Fast => {
                let of_pages = self.chooser.as_ref().zip(fast.at_once.as_ref()).filter(|_| shot.scene.is_paged());
                if let Some((chooser, at_once)) = of_pages {
                    let fast = (&fast.pipeline, &fast.work, &self.options);
                    let state = at_once.record(cmd, fast, chooser, shot, target)?;
                    let demand = self
                        .feed
                        .as_ref()
                        .map(|feed| feed.read(cmd, chooser, shot.scene, &self.options))
                        .transpose()?;
                    return Ok(Some(OfPages { state, demand }));
                }
                fast.pipeline.record(cmd, shot, &fast.work, target);
            }
            (_, None) => self.portable().record(cmd, shot, &self.work, target, self.passes),
            (_, Some(inspector)) => inspector.record(cmd, self.portable(), shot, &self.work, target, self.passes),
        }
        Ok(None)
    }

    /// True if a frame that counted `totals` kept to its limits. If it did not, the next frame has larger buffers, or
    /// takes the portable path where the fast one cannot grow.
    pub fn judge(&mut self, device: &Device, totals: &Totals, limits: Limits) -> Result<bool> {
        let demand = Capacity::of(totals, limits.capacity.gaussians, limits.capacity.cells);
        let is_whole = demand.fits(limits.capacity) && totals.longest_list <= limits.longest_list;
        match (&mut self.fast, limits.path) {
            (Some(fast), Path::Fast) => {
                let is_too_long = totals.longest_list > fast.pipeline.longest_list();
                fast.needs_slabs = is_too_long || !has_memory(fast.work.grow(device, demand, totals.longest_list))?;
            }
            // The fast path was dropped after this frame was recorded.
            (None, Path::Fast) => {}
            (_, Path::Portable) => {
                self.needs_slabs = !has_memory(self.work.grow(device, demand).map(drop))?;
                let passes = self.portable.as_ref().map_or(1, |portable| portable.passes(totals.longest_list));
                self.passes = self.passes.max(passes);
            }
        }
        Ok(is_whole)
    }

    /// True if the portable path still holds the lists of a frame of these limits.
    pub fn holds(&self, limits: Limits) -> bool {
        limits.path == Path::Portable && self.work.capacity == limits.capacity
    }
}
