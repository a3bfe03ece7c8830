//! Selection of the pages of a frame on the GPU: pages in view, with levels of detail only pages of the cut.
//!
//! Each page is selected independently, by the error limit of the frame. If the options set a splat budget or a PSNR,
//! the limit is searched first, in rounds: each sums the nodes and errors that remain of all pages in view under seven
//! candidate limits. The sums are of whole numbers, so every run finds the same limit under every memory limit.

use std::mem::offset_of;
use std::ops::Range;

use anyhow::Result;

use super::occlusion::Occlusion;
use super::tables::{STEPS, errors_of_pages, page_box, steps};
use super::target::{LodReport, LodTarget};
use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, InFlight, Readback, Results, Stage, Staging};
use crate::options::Options;
use crate::pagefile::{PARTS, SAMPLES};
use crate::render::frame::Shot;
use crate::render::pages::{Element, first_page, views_of};
use crate::render::scene::{GpuScene, Paged};
use crate::render::shaders::lod::{self, *};
use crate::render::shaders::{PageBox, PageErrors, SelectionState};

// The page table of the shaders has the layout of page files.
const _: () = assert!(PARTS == lod::PARTS as usize && SAMPLES == lod::SAMPLES as usize);

/// The stages of the selection, and the page table of a scene.
pub struct LodSelector {
    cull_pages: Stage<CullPages>,
    search_limit: Stage<SearchLimit>,
    select_pages: Stage<SelectPages>,
    finalize: Stage<Finalize>,
    /// The pages of the scene.
    pub paged: Paged,
    boxes: Buffer<PageBox>,
    errors: Buffer<PageErrors>,
    steps: Buffer<u32>,
    in_view: Buffer<Element>,
    /// The views, the number of pages, the selected pages: page.glsl.
    pub draw_list: Buffer<Element>,
    /// The page number of each page in the draw list.
    page_numbers: Buffer<u32>,
    pub state: Buffer<SelectionState>,
    /// The fallback limits of each page: `FallbackLimits::words` (`streaming/fallback`).
    fallback_limits: Buffer<u32>,
    /// Missing pages of the last selection, with their priorities and error limits.
    requests: Buffer<[u32; 2]>,
    /// What is hidden.
    pub occlusion: Occlusion,
    /// Parameters of the next selection.
    pub params: SelectionParams,
    has_levels: bool,
}

/// Parameters of the page requests of a selection.
#[derive(Clone, Copy, Debug, Default)]
pub struct SelectionParams {
    /// The stamp of a streamed frame, from 1 on; 0: no page is requested.
    pub stamp: u16,
    /// Lowest priority of a request.
    pub min_priority: u32,
    /// Subtracted from all priorities, in steps of error codes.
    pub priority_penalty: u32,
}

/// Initial capacity of the list of pages in view.
const INITIAL_CAPACITY: usize = 1 << 18;

/// The selected pages of a frame, on the host.
pub struct Selection {
    pub results: Results,
    pub pages: Vec<SelectedPage>,
    /// Set if the frame has levels of detail.
    pub detail: Option<LodReport>,
}

/// A page that a frame draws.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SelectedPage {
    pub page: u32,
    /// The number of its placed view.
    pub view: u32,
    /// Error limits, as codes: for its nodes, for their parents.
    pub error_limits: [u16; 2],
}

impl LodSelector {
    /// # Errors
    /// If memory runs out.
    pub fn new(device: &Device, scene: &GpuScene, paged: &Paged) -> Result<Self> {
        let cache = paged.cache();
        let pages = cache.pages();
        let count = pages.pages().len();
        let (in_view, draw_list, page_numbers) =
            lists(device, scene, INITIAL_CAPACITY.min(count * scene.transforms().len()))?;
        let selector = Self {
            cull_pages: Stage::new(device, &())?,
            search_limit: Stage::new(device, &())?,
            select_pages: Stage::new(device, &())?,
            finalize: Stage::new(device, &())?,
            paged: paged.clone(),
            boxes: Buffer::new(device, "boxes of pages", count)?,
            errors: Buffer::new(device, "errors of pages", count)?,
            steps: Buffer::new(device, "steps of codes", STEPS)?,
            in_view,
            draw_list,
            page_numbers,
            state: Buffer::new(device, "state of the cut", 1)?,
            fallback_limits: Buffer::new(device, "fallback limits of pages", count)?,
            requests: Buffer::new(device, "page requests", 1)?,
            occlusion: Occlusion::new(device, scene)?,
            params: SelectionParams::default(),
            has_levels: pages.levels().is_some(),
        };
        let mut cmd = Commands::new(device)?;
        cmd.upload(&selector.boxes, 0, count, |memory| {
            let of_scene =
                |(scene, views): (Range<usize>, Range<u32>)| scene.map(move |number| page_box(pages, number, &views));
            let boxes = pages.scenes().into_iter().zip(scene.views_of_scenes()).flat_map(of_scene);
            memory.iter_mut().zip(boxes).for_each(|(to, from)| *to = from);
        })?;
        cmd.upload(&selector.errors, 0, count, |memory| {
            memory.copy_from_slice(&errors_of_pages(pages));
        })?;
        cmd.fill(&selector.fallback_limits, 0);
        cmd.upload(&selector.steps, 0, STEPS, |memory| memory.copy_from_slice(&steps()))?;
        cmd.submit()?.wait()?;
        Ok(selector)
    }

    /// True if the scene has levels of detail.
    pub fn has_levels(&self) -> bool {
        self.has_levels
    }

    /// Every buffer's name and bytes.
    pub fn buffers(&self) -> [(&str, u64); 11] {
        let Self { boxes, errors, steps, in_view, draw_list, page_numbers, state, fallback_limits, requests, .. } =
            self;
        [
            boxes.footprint(),
            errors.footprint(),
            steps.footprint(),
            in_view.footprint(),
            draw_list.footprint(),
            page_numbers.footprint(),
            state.footprint(),
            fallback_limits.footprint(),
            requests.footprint(),
            self.occlusion.depths.footprint(),
            self.occlusion.views.footprint(),
        ]
    }

    /// True if the lists had the capacity for all pages in view of a frame. Otherwise they grow for the next frame.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn ensure_capacity(&mut self, device: &Device, scene: &GpuScene, state: &SelectionState) -> Result<bool> {
        let in_view = state.in_view as usize;
        if in_view <= self.in_view.len() {
            return Ok(true);
        }
        self.set_capacity(device, scene, in_view + in_view / 8)?;
        Ok(false)
    }

    /// Makes the lists for this number of pages in view.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn set_capacity(&mut self, device: &Device, scene: &GpuScene, capacity: usize) -> Result<()> {
        (self.in_view, self.draw_list, self.page_numbers) = lists(device, scene, capacity)?;
        Ok(())
    }

    /// Makes the list for this number of page requests.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn reserve_requests(&mut self, device: &Device, capacity: usize) -> Result<()> {
        self.requests = Buffer::new(device, "page requests", capacity)?;
        Ok(())
    }

    /// The page requests of the selection recorded last, in any order: page; priority, error limit in the upper half.
    pub fn requests(&self) -> &Buffer<[u32; 2]> {
        &self.requests
    }

    /// Uploads ranges of the fallback limits of all pages, one word per page.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn set_fallback_limits(&self, device: &Device, words: &[u32], ranges: &[Range<usize>]) -> Result<InFlight> {
        let mut cmd = Commands::new(device)?;
        cmd.upload_ranges(&self.fallback_limits, words, ranges)?;
        cmd.barrier(Access::COPY_WRITE, Access::SHADER_READ);
        cmd.submit()
    }

    /// The fewest bytes that each stage moves: only the first stage reads the table of all pages. The bytes of a first
    /// picture are not counted.
    pub fn least_bytes(&self) -> [(&'static str, u64); 5] {
        [
            ("look", (self.boxes.len() * size_of::<PageBox>()) as u64),
            ("count", 0),
            ("choose", 0),
            ("occlusion", 2 * self.occlusion.depths.bytes()),
            ("first picture", 0),
        ]
    }

    /// Records the selection of a frame. Missing pages are in the draw list without a Gaussian, and counted.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn record(&self, cmd: &mut Commands, shot: Shot, options: &Options) -> Result<()> {
        self.record_with(cmd, shot, options, self.params)
    }

    /// Records the selection with other parameters than [`LodSelector::params`].
    ///
    /// # Errors
    /// If memory runs out.
    pub fn record_with(
        &self,
        cmd: &mut Commands,
        shot: Shot,
        options: &Options,
        params: SelectionParams,
    ) -> Result<()> {
        let Shot { scene, camera, .. } = shot;
        let views = views_of(scene, camera, &options.rules);
        // Frames before this one read and write these buffers.
        cmd.barrier(Access::SHADER | Access::INDIRECT | Access::COPY_READ, Access::COPY_WRITE);
        cmd.fill(&self.state, 0);
        cmd.upload(&self.draw_list, 0, views.len(), |memory| memory.copy_from_slice(&views))?;
        cmd.barrier(Access::COPY_WRITE, Access::SHADER);
        cmd.scope("look", |cmd| self.cull_pages(cmd, shot, options));
        let target = if self.has_levels { LodTarget::of(options) } else { LodTarget::default() };
        let pixels = camera.size_px.iter().product();
        if target.searches != 0 {
            cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
            cmd.scope("count", |cmd| {
                for round in 0..ROUNDS {
                    if round > 0 {
                        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
                    }
                    self.search_limit(cmd, target, pixels, round);
                }
            });
        }
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        cmd.scope("choose", |cmd| self.select_pages(cmd, scene, target, pixels, params));
        Ok(())
    }

    /// Lists the pages in view.
    fn cull_pages(&self, cmd: &mut Commands, Shot { scene, camera, band, .. }: Shot, options: &Options) {
        let bindings = CullPagesBindings {
            boxes: &self.boxes,
            errors: &self.errors,
            draw_list: &self.draw_list,
            in_view: &self.in_view,
            state: &self.state,
            stop_depths: &self.occlusion.depths,
            stop_views: &self.occlusion.views,
        };
        let focal = camera.focal_px.max_element();
        let most_views = scene.views_of_scenes().iter().map(ExactSizeIterator::len).max().unwrap_or(0);
        let push = CullPagesPush {
            focal_px: camera.focal_px.as_vec2().to_array(),
            centre_px: camera.centre_px.as_vec2().to_array(),
            size_px: camera.size_px,
            band: band.word(),
            per_focal_squared: (1.0 / (focal * focal)) as f32,
            pages: self.boxes.len() as u32,
            views: most_views as u32,
            capacity: self.in_view.len() as u32,
            occlusion: self.occlusion.words(camera, options),
        };
        let pairs = self.boxes.len() as u64 * most_views as u64;
        cmd.dispatch(&self.cull_pages, bindings, push, DispatchSize::Invocations(pairs));
    }

    /// Sums the nodes and errors that remain of all pages in view under the candidate limits of a round.
    fn search_limit(&self, cmd: &mut Commands, target: LodTarget, pixels: u32, round: u32) {
        let bindings = SearchLimitBindings {
            errors: &self.errors,
            steps: &self.steps,
            in_view: &self.in_view,
            state: &self.state,
        };
        let LodTarget { given_squared, searches, max_nodes, max_error, fade } = target;
        let capacity = self.in_view.len() as u32;
        let push = SearchLimitPush { given_squared, searches, max_nodes, max_error, pixels, capacity, round, fade };
        let lanes = u64::from(CANDIDATES + 1) * u64::from(capacity);
        cmd.dispatch(&self.search_limit, bindings, push, DispatchSize::Invocations(lanes));
    }

    /// Lists the pages with drawn nodes, and sets the dispatch over them.
    fn select_pages(
        &self,
        cmd: &mut Commands,
        scene: &GpuScene,
        target: LodTarget,
        pixels: u32,
        params: SelectionParams,
    ) {
        let first_page = first_page(scene);
        let bindings = SelectPagesBindings {
            errors: &self.errors,
            steps: &self.steps,
            in_view: &self.in_view,
            state: &self.state,
            slots: &self.paged.slots,
            draw_list: &self.draw_list,
            page_numbers: &self.page_numbers,
            fallback_limits: &self.fallback_limits,
            last_used: &self.paged.last_used,
            requests: &self.requests,
        };
        let LodTarget { given_squared, searches, max_nodes, max_error, fade } = target;
        let capacity = self.in_view.len() as u32;
        let push = SelectPagesPush {
            given_squared,
            searches,
            max_nodes,
            max_error,
            pixels,
            capacity,
            first_page,
            stamp: params.stamp.into(),
            max_requests: self.requests.len() as u32,
            min_priority: params.min_priority,
            fade,
            priority_penalty: params.priority_penalty,
        };
        cmd.dispatch(&self.select_pages, bindings, push, DispatchSize::Invocations(capacity.into()));
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        let bindings = FinalizeBindings { state: &self.state, draw_list: &self.draw_list };
        cmd.dispatch(&self.finalize, bindings, FinalizePush { first_page }, DispatchSize::Groups(1));
    }

    /// The byte offset in the state of the dispatch over quarters of the selected pages.
    pub fn page_dispatch() -> usize {
        offset_of!(SelectionState, page_dispatch)
    }

    /// Records the read-back of the state.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn read(&self, cmd: &mut Commands) -> Result<Readback<SelectionState>> {
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        cmd.read(&self.state)
    }

    /// The report of a selection with levels of detail.
    pub fn report(state: &SelectionState, options: &Options) -> Option<LodReport> {
        options.wants_levels().then(|| LodReport::of(state))
    }

    /// Selects the pages of a frame and waits for the result. The pages are in any order.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn select(&mut self, device: &Device, shot: Shot, options: &Options) -> Result<Selection> {
        let scene = shot.scene;
        let mut cmd = Commands::new(device)?;
        self.record(&mut cmd, shot, options)?;
        let state = self.read(&mut cmd)?;
        let results = cmd.submit()?.wait()?;
        let state = results.view(&state)[0];
        if !self.ensure_capacity(device, scene, &state)? {
            return self.select(device, shot, options);
        }
        let pages = self.selected_pages(device, scene, &state)?;
        Ok(Selection { results, pages, detail: Self::report(&state, options) })
    }

    /// Reads the pages of the selection recorded last, which had this state.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn selected_pages(
        &self,
        device: &Device,
        scene: &GpuScene,
        state: &SelectionState,
    ) -> Result<Vec<SelectedPage>> {
        let (first, count) = (first_page(scene) as usize, state.selected as usize);
        let mut draw_list = Staging::new(device, "pages of the cut", first + count)?;
        let mut numbers = Staging::new(device, "numbers of pages", count)?;
        let mut cmd = Commands::new(device)?;
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        cmd.download(&self.draw_list, &draw_list, first + count);
        cmd.download(&self.page_numbers, &numbers, count);
        cmd.submit()?.wait()?;
        let selected = |(page, element): (&u32, &Element)| {
            let [_, limits, view, _] = *element;
            SelectedPage { page: *page, view, error_limits: [limits as u16, (limits >> 16) as u16] }
        };
        Ok(numbers.map().iter().take(count).zip(&draw_list.map()[first..]).map(selected).collect())
    }
}

/// The lists for this number of pages: pages in view, draw list, page numbers.
fn lists(
    device: &Device,
    scene: &GpuScene,
    capacity: usize,
) -> Result<(Buffer<Element>, Buffer<Element>, Buffer<u32>)> {
    let in_view = Buffer::new(device, "pages in view", capacity)?;
    let draw_list = Buffer::new(device, "pages of the cut", first_page(scene) as usize + capacity)?;
    let page_numbers = Buffer::new(device, "numbers of pages", capacity)?;
    // A frame in flight with the former lists may be judged by these, so they need valid page numbers.
    let mut cmd = Commands::new(device)?;
    cmd.fill(&page_numbers, 0);
    cmd.submit()?.wait()?;
    Ok((in_view, draw_list, page_numbers))
}
