//! The choice of the engine that draws each frame.

use std::time::Duration;

use anyhow::Result;

use super::fast_engine::FastEngine;
use super::fast_rays_engine::FastRaysEngine;
use super::portable_engine::PortableEngine;
use super::rays_engine::RaysEngine;
use crate::gpu::{Buffer, Commands, Device, Results};
use crate::host_memory::OutOfMemory;
use crate::options::Options;
use crate::render::capacity::{Capacity, has_memory};
use crate::render::fast::FastPipeline;
use crate::render::fast_rays::FastRaysPipeline;
use crate::render::frame::{Shot, Target, Variation};
use crate::render::inspect::{Attribute, Inspector, Listed};
use crate::render::lod::{LodSelector, Occlusion, load_missing};
use crate::render::path::{Limits, Path, PathPair};
use crate::render::portable::PortablePipeline;
use crate::render::recorded::PagedCounts;
use crate::render::scene::{GpuScene, SELF_TEST_GAUSSIANS};
use crate::render::shaders::Totals;
use crate::render::slabs::SlabbedFrame;
use crate::render::streaming::PageStreamer;
use crate::rules::TILE;
use crate::threads::{self, joined};

/// The engines of the paths and the choice between them: the two paths along rays draw cameras with lenses; the fast
/// path, with or without rays, draws what the device and the options allow it to draw.
pub(crate) struct PathChoice {
    /// The options of the stages, with the LOD limits of the next frame.
    pub options: Options,
    portable: PortableEngine,
    fast: Option<FastEngine>,
    /// Made for the first camera with a lens.
    rays: Option<RaysEngine>,
    /// The same, beside a fast path.
    fast_rays: Option<FastRaysEngine>,
    /// The state of the fast path along rays, which is tested before its first picture.
    rays_test: RaysTest,
    variation: Variation,
    /// Selects the pages of a scene in pages.
    selector: Option<LodSelector>,
    /// Loads pages beside frames that do not wait for them.
    pub streamer: Option<PageStreamer>,
    /// The error limit of the last frame that did not wait for pages, as that of the options.
    pub last_limit: f32,
    /// The next frame repeats one that did not fit. It draws the same resident pages: with more, it might not fit
    /// again.
    pub is_repeated: bool,
    /// The reason why the fast path does not draw although the device has it.
    pub notice: Option<String>,
    /// The duration of the self-test of the fast path, if it ran.
    pub self_test_time: Option<Duration>,
}

/// What is known of the fast path along rays.
#[derive(Clone, Copy, PartialEq, Eq)]
enum RaysTest {
    Due,
    Done,
    Failed,
}

impl PathChoice {
    /// Builds the engines that suit the device, the options and the variation.
    pub fn new(device: &Device, options: &Options, scene: &GpuScene, variation: Variation) -> Result<Self> {
        let layout = scene.layout();
        // A scene in pages is drawn in slabs, whose buffers are made for the first picture.
        let gaussians = if scene.is_paged() { scene.len().min(SELF_TEST_GAUSSIANS) } else { scene.len() };
        let guess = Capacity::guess(device, gaussians, 1);
        // Only the portable path and rays make counts and certificates.
        let fast = match variation {
            Variation::Plain => FastEngine::new(device, options, layout, guess)?,
            Variation::Counting | Variation::Certifying => None,
        };
        // The portable path needs no buffers beside the fast path.
        let guess = if fast.is_some() { Capacity::default() } else { guess };
        let mut portable = PortableEngine::new(device, layout, variation, guess)?;
        if fast.is_none() {
            portable.make(device, options)?;
        }
        let is_left_to_portable =
            variation == Variation::Certifying && FastPipeline::subgroup(device, options).is_some();
        Ok(Self {
            options: *options,
            portable,
            fast,
            rays: None,
            fast_rays: None,
            rays_test: RaysTest::Due,
            variation,
            selector: scene.paged().map(|paged| LodSelector::new(device, scene, paged)).transpose()?,
            streamer: None,
            last_limit: 0.0,
            is_repeated: false,
            notice: is_left_to_portable.then(|| {
                "only the portable path and, along rays, the path rays make certificates, so one of them draws; \
                 without --certificate the fast path draws"
                    .to_owned()
            }),
            self_test_time: None,
        })
    }

    /// The fast path, if it may draw.
    pub fn fast(&self) -> Option<&FastPipeline> {
        self.fast.as_ref().map(|fast| &fast.pipeline)
    }

    /// The frame of `shot`, which was drawn with tile lists, and the pipeline of its sorts.
    pub fn listed<'f>(&'f self, shot: Shot<'f>) -> (&'f PortablePipeline, Listed<'f>) {
        let listed = match self.rays.as_ref().filter(|_| shot.camera.lens.is_some()) {
            Some(rays) => Listed::Rays(rays.frame(shot)),
            None => Listed::Portable(shot, &self.portable.work),
        };
        (self.portable.pipeline(), listed)
    }

    /// Makes the pipelines of both paths and of all forms of blocks at the same time: a driver compiles on the calling
    /// thread.
    pub fn make_all_pipelines(&mut self, device: &Device) -> Result<()> {
        let Self { portable, fast, options, .. } = self;
        threads::scope(|threads| {
            let making = threads.spawn(|| portable.make(device, options))?;
            let blends = fast.as_mut().map_or(Ok(()), |fast| fast.pipeline.make_all_blends(device));
            joined(making)?;
            blends
        })
    }

    /// Makes the pipeline of the portable path, if there is none yet.
    pub fn make_portable(&mut self, device: &Device) -> Result<()> {
        self.portable.make(device, &self.options)
    }

    /// True if the fast path along rays would draw a picture, and was not tested.
    pub fn rays_need_test(&self) -> bool {
        self.fast.is_some() && self.rays_test == RaysTest::Due
    }

    /// A fingerprint of all stages of a fast path; `None` if it does not draw.
    ///
    /// # Errors
    /// If a shader cannot be compiled at run time.
    pub fn fingerprint(&self, device: &Device, pair: PathPair) -> Result<Option<blake3::Hash>> {
        let Some(fast) = &self.fast else { return Ok(None) };
        let fast = &fast.pipeline;
        Ok(Some(match pair {
            PathPair::Projected => fast.fingerprint(device)?,
            PathPair::Rays => FastRaysPipeline::fingerprint(device, fast)?,
        }))
    }

    /// Ends a self-test, and drops the fast path if its picture differs from the other path's by `disagreement`.
    pub fn end_self_test(
        &mut self,
        device: &Device,
        gaussians: usize,
        pair: PathPair,
        disagreement: Option<f32>,
    ) -> Result<()> {
        if let Some(difference) = disagreement {
            let [tested, other] = pair.paths();
            self.notice = Some(format!(
                "the path {tested} is not taken: on this device its picture differs from that of the path {other} by \
                 {difference:.3}"
            ));
        }
        if pair == PathPair::Rays {
            // Buffers of this size suit no other picture.
            (self.rays, self.fast_rays) = (None, None);
            self.rays_test = if disagreement.is_none() { RaysTest::Done } else { RaysTest::Failed };
            return Ok(());
        }
        let mut capacity = Capacity::default();
        if let Some(fast) = &mut self.fast {
            fast.needs_slabs = false;
        }
        if disagreement.is_some() {
            self.fast = None;
            capacity = Capacity::guess(device, gaussians, 1);
        }
        self.portable.reset(device, capacity)
    }

    #[cfg(test)]
    pub fn replace_fast(&mut self, pipeline: FastPipeline) {
        self.fast.as_mut().expect("there is a fast path").pipeline = pipeline;
    }

    /// Draws the next frame in slabs.
    #[cfg(test)]
    pub fn force_slabs(&mut self) {
        self.fast.as_mut().expect("there is a fast path").needs_slabs = true;
    }

    /// Sets the index in `fast::BLOCK_FORMS` for all pictures of the fast path. With `None`, each picture takes the
    /// form that suits it.
    pub fn force_block_form(&mut self, form: Option<usize>) {
        if let Some(fast) = &mut self.fast {
            fast.pipeline.forced_block_form = form;
        }
    }

    /// Replaces the buffers of the preferred path, and of the paths along rays if there are any, by ones of this
    /// capacity.
    pub fn set_capacity(&mut self, device: &Device, capacity: Capacity) -> Result<()> {
        self.fast_rays.as_mut().map_or(Ok(()), |rays| rays.set_capacity(device, capacity))?;
        self.rays.as_mut().map_or(Ok(()), |rays| rays.set_capacity(device, capacity))?;
        match &mut self.fast {
            Some(fast) => fast.set_capacity(device, capacity),
            None => self.portable.set_capacity(device, capacity),
        }
    }

    /// Frees the buffers of both paths.
    pub fn release(&mut self, device: &Device) -> Result<()> {
        (self.rays, self.fast_rays) = (None, None);
        self.portable.release(device)?;
        self.fast.as_mut().map_or(Ok(()), |fast| fast.release(device))
    }

    /// The name and the bytes of every buffer.
    pub fn buffers(&self) -> Vec<(&str, u64)> {
        let fast = self.fast.iter().flat_map(|fast| fast.work.buffers());
        let rays = self.rays.iter().flat_map(RaysEngine::buffers);
        let rays = rays.chain(self.fast_rays.iter().flat_map(FastRaysEngine::buffers));
        let selector = self.selector.iter().flat_map(LodSelector::buffers);
        self.portable.work.buffers().into_iter().chain(fast).chain(rays).chain(selector).collect()
    }

    /// The counts of a frame on `path`.
    pub fn totals(&self, path: Path) -> &Buffer<Totals> {
        match (path, &self.fast, &self.rays, &self.fast_rays) {
            (Path::Fast, Some(fast), ..) => &fast.work.totals,
            (Path::Rays, _, Some(rays), _) => &rays.work.totals,
            (Path::FastRays, .., Some(rays)) => &rays.work.totals,
            _ => &self.portable.work.totals,
        }
    }

    /// The fewest bytes that every stage of a frame on `path` moves.
    pub fn least_bytes(&self, path: Path, shot: Shot, totals: &Totals) -> Vec<(&'static str, u64)> {
        let mut stages = match (path, &self.fast, &self.rays, &self.fast_rays) {
            (Path::Fast, Some(fast), ..) => fast.pipeline.least_bytes(shot, totals),
            (Path::FastRays, Some(fast), _, Some(rays)) => rays.least_bytes(shot, totals, &fast.pipeline),
            (Path::Rays, _, Some(rays), _) => rays.least_bytes(shot, totals, self.portable.pipeline()),
            _ => self.portable.pipeline().least_bytes(shot, totals),
        };
        // Frames in slabs: begin writes the states of pixels, finish reads them and writes the picture.
        let pixels: u64 = shot.size().iter().map(|side| u64::from(*side)).product();
        stages.extend([("begin", 16 * pixels), ("finish", 32 * pixels)]);
        stages.extend(self.selector.iter().flat_map(LodSelector::least_bytes));
        stages
    }

    /// Bands of a picture begin at multiples of this many rows.
    pub fn band_rows(&self, shot: Shot) -> u32 {
        let gaussians = shot.scene.drawn_len(&self.options);
        self.fast().map_or(TILE, |fast| fast.grid(shot.camera.size_px, gaussians).bin_px()[1])
    }

    /// True if the fast path can show attributes, as it does for pages with levels of detail.
    pub fn shows_attributes(&self) -> bool {
        self.fast.is_some() && self.selector.as_ref().is_some_and(LodSelector::has_levels)
    }

    /// Draws the resident levels from now on, and loads pages beside the frames. Does nothing for scenes without levels
    /// and for the portable path, whose frames wait for their pages.
    ///
    /// # Errors
    /// If the coarsest pages cannot be read.
    pub fn enable_page_streaming(&mut self, device: &Device, scene: &GpuScene) -> Result<()> {
        let selector = self.selector.as_mut().filter(|selector| selector.has_levels() && self.fast.is_some());
        if let (Some(selector), Some(paged)) = (selector, scene.paged()) {
            self.streamer = Some(PageStreamer::new(device, paged, selector, self.options.lod_fade > 0.0)?);
            selector.occlusion.follow();
        }
        Ok(())
    }

    /// Chooses the path of a frame and makes its buffers large enough. `needs_tile_lists` requires the portable path;
    /// `attribute` replaces the colours on the fast path.
    pub fn prepare(
        &mut self,
        device: &Device,
        shot: Shot,
        needs_tile_lists: bool,
        attribute: Option<Attribute>,
    ) -> Result<Limits> {
        self.selector.iter_mut().for_each(|selector| selector.occlusion.begin_frame());
        if shot.camera.lens.is_some() {
            return self.prepare_rays(device, shot, needs_tile_lists);
        }
        let Self { fast, portable, options, selector, streamer, .. } = self;
        let gaussians = shot.scene.drawn_len(options);
        let can_draw = |fast: &&mut FastEngine| !needs_tile_lists && fast.pipeline.takes(shot, gaussians);
        let Some(fast) = fast.as_mut().filter(can_draw) else { return portable.prepare(device, shot, options) };
        let limits = fast.prepare(device, shot, options, attribute)?;
        if let (Some(streamer), Some(selector)) = (streamer, selector)
            && !limits.in_slabs
            && !self.is_repeated
        {
            streamer.advance(device, selector, shot.camera)?;
        }
        Ok(limits)
    }

    /// Likewise for a camera with a lens.
    fn prepare_rays(&mut self, device: &Device, shot: Shot, needs_tile_lists: bool) -> Result<Limits> {
        let Self { fast, portable, rays, fast_rays, rays_test, options, variation, .. } = self;
        let can_draw = |fast: &&FastEngine| {
            let is_fast = !needs_tile_lists && *rays_test != RaysTest::Failed;
            is_fast && fast.pipeline.takes(shot, shot.scene.len())
        };
        if let Some(fast) = fast.as_ref().filter(can_draw) {
            let rays = match fast_rays {
                Some(rays) => rays,
                none => none.insert(FastRaysEngine::new(device, shot, options, &fast.pipeline)?),
            };
            if let Some(limits) = rays.prepare(device, shot, &fast.pipeline)? {
                return Ok(limits);
            }
        }
        portable.make(device, options)?;
        let rays = match rays {
            Some(rays) => rays,
            none => none.insert(RaysEngine::new(device, shot, options, *variation)?),
        };
        rays.prepare(device, shot, portable.pipeline())
    }

    /// Records a frame that [`prepare`](Self::prepare) made buffers for. For a scene in pages, returns the counts of
    /// its selection.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn record(
        &mut self,
        device: &Device,
        cmd: &mut Commands,
        shot: Shot,
        target: Target,
        limits: Limits,
        inspector: Option<&Inspector>,
    ) -> Result<Option<PagedCounts>> {
        if let Some(rays) = self.rays.as_ref().filter(|_| limits.path == Path::Rays) {
            rays.record(cmd, shot, target, self.portable.pipeline(), inspector);
            return Ok(None);
        }
        if let (Some(fast), Some(rays), Path::FastRays) = (&self.fast, &self.fast_rays, limits.path) {
            rays.record(cmd, shot, target, &fast.pipeline);
            return Ok(None);
        }
        let Some(fast) = self.fast.as_ref().filter(|_| limits.path == Path::Fast) else {
            self.portable.record(cmd, shot, target, inspector);
            return Ok(None);
        };
        let Some(selector) = self.selector.as_mut().filter(|_| shot.scene.is_paged()) else {
            fast.pipeline.record(cmd, shot, &fast.work, target);
            return Ok(None);
        };
        let state = fast.record_paged(cmd, shot, target, &self.options, device, selector)?;
        let read = |streamer: &PageStreamer| streamer.record_requests(cmd, selector, shot.scene, &self.options);
        Ok(Some(PagedCounts { state, requests: self.streamer.as_ref().map(read).transpose()? }))
    }

    /// Draws a frame in slabs on a path, and waits for it.
    ///
    /// # Errors
    /// If memory runs out, a page cannot be read, or a frame in slabs cannot show the inspected quantity.
    pub fn draw_slabs(
        &mut self,
        device: &Device,
        path: Path,
        shot: Shot,
        target: Target,
        inspector: Option<&Inspector>,
    ) -> Result<SlabbedFrame> {
        let Self { fast, portable, options, selector, .. } = self;
        // The buffers of the other path may leave too little memory.
        if path == Path::Portable {
            ensure_slabs_show(inspector.is_none_or(Inspector::is_of_depths))?;
            if !has_memory(portable.fit_slabs(device, shot))? {
                fast.as_mut().map_or(Ok(()), |fast| fast.release(device))?;
                portable.fit_slabs(device, shot)?;
            }
            return portable.draw_slabs(device, shot, target, options, selector.as_mut(), inspector);
        }
        ensure_slabs_show(inspector.is_none())?;
        let fast = fast.as_mut().expect("a frame in slabs was prepared");
        if !has_memory(fast.fit_slabs(device, shot, options))? {
            portable.release(device)?;
            fast.fit_slabs(device, shot, options)?;
        }
        fast.draw_slabs(device, shot, target, options, selector.as_mut())
    }

    /// True if a frame that counted `totals` kept to its limits. If it did not, the next frame has larger buffers, or
    /// is drawn in slabs.
    pub fn judge(&mut self, device: &Device, totals: &Totals, limits: Limits) -> Result<bool> {
        let demand = Capacity::of(totals, limits.capacity.gaussians, limits.capacity.cells);
        match (&mut self.fast, limits.path) {
            (_, Path::Rays) => {
                let Self { rays, portable, .. } = self;
                rays.as_mut().map_or(Ok(()), |rays| rays.grow(device, demand, totals, portable.pipeline()))?;
            }
            (Some(fast), Path::FastRays) => {
                let rays = &mut self.fast_rays;
                rays.as_mut().map_or(Ok(()), |rays| rays.grow(device, demand, totals, &fast.pipeline))?;
            }
            (Some(fast), Path::Fast) => fast.grow(device, demand, totals)?,
            // The fast path was dropped after this frame was recorded.
            (None, Path::Fast | Path::FastRays) => {}
            (_, Path::Portable) => self.portable.grow(device, demand, totals)?,
        }
        Ok(demand.fits(limits.capacity) && totals.longest_list <= limits.longest_list)
    }

    /// True if a frame of a scene in pages missed no page, or does not wait for pages. The next frame has the missing
    /// pages, or is drawn in slabs.
    ///
    /// # Errors
    /// If a page cannot be read, or memory runs out.
    pub fn judge_pages(
        &mut self,
        device: &Device,
        scene: &GpuScene,
        results: &Results,
        counts: &PagedCounts,
    ) -> Result<bool> {
        let (Some(selector), Some(fast)) = (&mut self.selector, &mut self.fast) else { return Ok(true) };
        let state = &results.view(&counts.state)[0];
        if !selector.ensure_capacity(device, scene, state)? {
            return Ok(false);
        }
        self.last_limit = 255.0 * f32::from_bits(state.limit_squared).sqrt();
        if let Some(requests) = &counts.requests {
            if let Some(streamer) = &mut self.streamer {
                streamer.handle_requests(state, results, requests);
            }
            return Ok(true);
        }
        if state.missing > 0 {
            fast.needs_slabs = !load_missing(device, selector, scene, state)?;
        }
        Ok(state.missing == 0)
    }

    /// True if another streamed frame with the same camera would take the stop depths of its own view.
    pub fn is_behind(&self) -> bool {
        self.selector.as_ref().is_some_and(|selector| selector.occlusion.is_behind())
    }

    /// The stop depths of pictures of a scene in pages on the fast path.
    pub fn occlusion(&mut self) -> Option<&mut Occlusion> {
        self.selector.as_mut().filter(|_| self.fast.is_some()).map(|selector| &mut selector.occlusion)
    }

    /// True if a path still holds the lists of tiles of a frame of these limits.
    pub fn holds(&self, limits: Limits) -> bool {
        match limits.path {
            Path::Portable => self.portable.work.capacity == limits.capacity,
            Path::Rays => self.rays.as_ref().is_some_and(|rays| rays.capacity() == limits.capacity),
            Path::Fast | Path::FastRays => false,
        }
    }
}

/// Fails if a frame in slabs cannot show the inspected quantity.
fn ensure_slabs_show(can_show: bool) -> Result<()> {
    let reason = "this view needs the whole scene and its lists on the device, which has too little memory".to_owned();
    let problem = OutOfMemory { name: "view".to_owned(), bytes: None, reason };
    if can_show { Ok(()) } else { Err(problem.into()) }
}
