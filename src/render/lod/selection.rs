//! The pages that a picture draws, chosen on the GPU: those in view, and of levels of detail those of the cut.
//!
//! Every page decides for itself. Where the options ask for a number of nodes or a predicted error, the limit is
//! searched before, in rounds: each adds up what seven limits would leave of all pages in view, in whole numbers, so
//! that every run and every amount of memory finds the same limit.

use std::mem::offset_of;

use anyhow::Result;

use super::tables::{STEPS, errors_of_pages, page_box, steps};
use super::target::{Detailed, Wanted};
use crate::camera::Camera;
use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, InFlight, Readback, Results, Stage, Staging};
use crate::options::Options;
use crate::pagefile::{PARTS, SAMPLES};
use crate::render::pages::{Element, first_page, views_of};
use crate::render::scene::{GpuScene, Paged};
use crate::render::shaders::lod::{self, *};
use crate::render::shaders::{CutState, PageBox, PageErrors};

// The shaders read the table of a file.
const _: () = assert!(PARTS == lod::PARTS as usize && SAMPLES == lod::SAMPLES as usize);

/// The stages, and the table of the pages of a scene.
pub struct Chooser {
    cull_pages: Stage<CullPages>,
    search_limit: Stage<SearchLimit>,
    select_pages: Stage<SelectPages>,
    finalize: Stage<Finalize>,
    /// The pages of the scene.
    pub paged: Paged,
    boxes: Buffer<PageBox>,
    errors: Buffer<PageErrors>,
    steps: Buffer<u32>,
    seen: Buffer<Element>,
    /// The views, the number of pages, the pages, as page.glsl has them.
    pub listed: Buffer<Element>,
    /// The number of each listed page.
    pages: Buffer<u32>,
    pub state: Buffer<CutState>,
    /// By page, the least limits: [`Family`](crate::render::streaming::Family).
    floors: Buffer<u32>,
    /// Pages that a picture wanted and that are missing, and their priorities.
    demand: Buffer<[u32; 2]>,
    /// What the next picture is asked about pages.
    pub asked: Asked,
    has_levels: bool,
}

/// What a picture is asked about pages.
#[derive(Clone, Copy, Debug, Default)]
pub struct Asked {
    /// Its number among others, from 1 on; 0: nothing is asked.
    pub stamp: u16,
    /// Of the missing pages that it lists.
    pub least_priority: u32,
    /// Steps of codes by which all pages matter less.
    pub later: u32,
}

/// Pages in view that there is room for at first.
const ROOM: usize = 1 << 18;

/// The pages of a picture, on the host.
pub struct Chosen {
    pub results: Results,
    pub pages: Vec<ChosenPage>,
    /// Set if it is drawn by levels of detail.
    pub detail: Option<Detailed>,
}

/// A page that a picture draws.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChosenPage {
    pub page: u32,
    /// The number of the placed view that sees it.
    pub view: u32,
    /// Limits of errors, as codes: of its nodes, of their parents.
    pub limits: [u16; 2],
}

impl Chooser {
    /// # Errors
    /// If memory runs out.
    pub fn new(device: &Device, scene: &GpuScene, paged: &Paged) -> Result<Self> {
        let pool = paged.cache();
        let pages = pool.pages();
        let count = pages.pages().len();
        let (seen, listed, numbers) = lists(device, scene, ROOM.min(count * scene.transforms().len()))?;
        let chooser = Self {
            cull_pages: Stage::new(device, &())?,
            search_limit: Stage::new(device, &())?,
            select_pages: Stage::new(device, &())?,
            finalize: Stage::new(device, &())?,
            paged: paged.clone(),
            boxes: Buffer::new(device, "boxes of pages", count)?,
            errors: Buffer::new(device, "errors of pages", count)?,
            steps: Buffer::new(device, "steps of codes", STEPS)?,
            seen,
            listed,
            pages: numbers,
            state: Buffer::new(device, "state of the cut", 1)?,
            floors: Buffer::new(device, "floors of pages", count)?,
            demand: Buffer::new(device, "missing pages", 1)?,
            asked: Asked::default(),
            has_levels: pages.levels().is_some(),
        };
        let mut cmd = Commands::new(device)?;
        cmd.upload(&chooser.boxes, 0, count, |memory| {
            let boxes = (0..count).map(|number| page_box(pages, number));
            memory.iter_mut().zip(boxes).for_each(|(to, from)| *to = from);
        })?;
        cmd.upload(&chooser.errors, 0, count, |memory| {
            memory.copy_from_slice(&errors_of_pages(pages));
        })?;
        cmd.fill(&chooser.floors, 0);
        cmd.upload(&chooser.steps, 0, STEPS, |memory| memory.copy_from_slice(&steps()))?;
        cmd.submit()?.wait()?;
        Ok(chooser)
    }

    /// True if the scene is drawn by levels of detail.
    pub fn has_levels(&self) -> bool {
        self.has_levels
    }

    /// Every buffer's name and bytes.
    pub fn buffers(&self) -> [(&str, u64); 9] {
        let Self { boxes, errors, steps, seen, listed, pages, state, floors, demand, .. } = self;
        [
            boxes.footprint(),
            errors.footprint(),
            steps.footprint(),
            seen.footprint(),
            listed.footprint(),
            pages.footprint(),
            state.footprint(),
            floors.footprint(),
            demand.footprint(),
        ]
    }

    /// True if there was room for all pages in view of a picture. If not, there is for the next.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn has_room(&mut self, device: &Device, scene: &GpuScene, state: &CutState) -> Result<bool> {
        let seen = state.seen as usize;
        if seen <= self.seen.len() {
            return Ok(true);
        }
        self.make_room(device, scene, seen + seen / 8)?;
        Ok(false)
    }

    /// Makes room for so many pages in view.
    pub fn make_room(&mut self, device: &Device, scene: &GpuScene, room: usize) -> Result<()> {
        (self.seen, self.listed, self.pages) = lists(device, scene, room)?;
        Ok(())
    }

    /// Makes room for so many missing pages.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn make_demand(&mut self, device: &Device, room: usize) -> Result<()> {
        self.demand = Buffer::new(device, "missing pages", room)?;
        Ok(())
    }

    /// The missing pages of the picture recorded last, and their priorities, in any order.
    pub fn demand(&self) -> &Buffer<[u32; 2]> {
        &self.demand
    }

    /// Sets the least limits of all pages, which `write` writes into a word for each.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn set_floors(&self, device: &Device, write: impl FnOnce(&mut [u32])) -> Result<InFlight> {
        let mut cmd = Commands::new(device)?;
        cmd.upload(&self.floors, 0, self.floors.len(), write)?;
        cmd.barrier(Access::COPY_WRITE, Access::SHADER_READ);
        cmd.submit()
    }

    /// The fewest bytes that each stage moves: only the first has to look at all pages.
    pub fn least_bytes(&self) -> [(&'static str, u64); 3] {
        [("look", (self.boxes.len() * size_of::<PageBox>()) as u64), ("count", 0), ("choose", 0)]
    }

    /// Lists the pages of a picture. Those that are not in device memory are listed without a Gaussian, and counted.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn record(&self, cmd: &mut Commands, scene: &GpuScene, camera: &Camera, options: &Options) -> Result<()> {
        self.record_asked(cmd, scene, camera, options, self.asked)
    }

    /// As [`Chooser::record`], with another question about pages than [`Chooser::asked`].
    ///
    /// # Errors
    /// If memory runs out.
    pub fn record_asked(
        &self,
        cmd: &mut Commands,
        scene: &GpuScene,
        camera: &Camera,
        options: &Options,
        asked: Asked,
    ) -> Result<()> {
        let views = views_of(scene, camera, &options.rules);
        // Frames before this one read and write these buffers.
        cmd.barrier(Access::SHADER | Access::INDIRECT | Access::COPY_READ, Access::COPY_WRITE);
        cmd.fill(&self.state, 0);
        cmd.upload(&self.listed, 0, views.len(), |memory| memory.copy_from_slice(&views))?;
        cmd.barrier(Access::COPY_WRITE, Access::SHADER);
        cmd.scope("look", |cmd| self.cull_pages(cmd, scene, camera));
        let wanted = if self.has_levels { Wanted::of(options) } else { Wanted::default() };
        let pixels = camera.size_px.iter().product();
        if wanted.searches != 0 {
            cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
            cmd.scope("count", |cmd| {
                for round in 0..ROUNDS {
                    if round > 0 {
                        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
                    }
                    self.search_limit(cmd, wanted, pixels, round);
                }
            });
        }
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        cmd.scope("choose", |cmd| self.select_pages(cmd, scene, wanted, pixels, asked));
        Ok(())
    }

    /// Finds the pages in view.
    fn cull_pages(&self, cmd: &mut Commands, scene: &GpuScene, camera: &Camera) {
        let bindings = CullPagesBindings {
            boxes: &self.boxes,
            errors: &self.errors,
            listed: &self.listed,
            seen: &self.seen,
            state: &self.state,
        };
        let focal = camera.focal_px.max_element();
        let push = CullPagesPush {
            focal_px: camera.focal_px.as_vec2().to_array(),
            centre_px: camera.centre_px.as_vec2().to_array(),
            size_px: camera.size_px,
            per_focal_squared: (1.0 / (focal * focal)) as f32,
            pages: self.boxes.len() as u32,
            views: scene.transforms().len() as u32,
            room: self.seen.len() as u32,
        };
        let pairs = self.boxes.len() as u64 * scene.transforms().len() as u64;
        cmd.dispatch(&self.cull_pages, bindings, push, DispatchSize::Invocations(pairs));
    }

    /// Adds up what the limits of a round leave of all pages in view.
    fn search_limit(&self, cmd: &mut Commands, wanted: Wanted, pixels: u32, round: u32) {
        let bindings =
            SearchLimitBindings { errors: &self.errors, steps: &self.steps, seen: &self.seen, state: &self.state };
        let Wanted { given_squared, searches, most_nodes, most_energy, fade } = wanted;
        let room = self.seen.len() as u32;
        let push = SearchLimitPush { given_squared, searches, most_nodes, most_energy, pixels, room, round, fade };
        let lanes = u64::from(CANDIDATES + 1) * u64::from(room);
        cmd.dispatch(&self.search_limit, bindings, push, DispatchSize::Invocations(lanes));
    }

    /// Lists the pages that the limit leaves.
    fn select_pages(&self, cmd: &mut Commands, scene: &GpuScene, wanted: Wanted, pixels: u32, asked: Asked) {
        let first_page = first_page(scene);
        let bindings = SelectPagesBindings {
            errors: &self.errors,
            steps: &self.steps,
            seen: &self.seen,
            state: &self.state,
            slots: &self.paged.slots,
            listed: &self.listed,
            pages: &self.pages,
            floors: &self.floors,
            wanted: &self.paged.last_used,
            demand: &self.demand,
        };
        let Wanted { given_squared, searches, most_nodes, most_energy, fade } = wanted;
        let room = self.seen.len() as u32;
        let push = SelectPagesPush {
            given_squared,
            searches,
            most_nodes,
            most_energy,
            pixels,
            room,
            first_page,
            stamp: asked.stamp.into(),
            demand_room: self.demand.len() as u32,
            least_priority: asked.least_priority,
            fade,
            later: asked.later,
        };
        cmd.dispatch(&self.select_pages, bindings, push, DispatchSize::Invocations(room.into()));
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        let bindings = FinalizeBindings { state: &self.state, listed: &self.listed };
        cmd.dispatch(&self.finalize, bindings, FinalizePush { first_page }, DispatchSize::Groups(1));
    }

    /// Where the dispatch over quarters of the listed pages lies in the state.
    pub fn over_pages() -> usize {
        offset_of!(CutState, over_pages)
    }

    /// Brings the state of the picture to the host.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn read(&self, cmd: &mut Commands) -> Result<Readback<CutState>> {
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        cmd.read(&self.state)
    }

    /// What a picture was drawn with, if it was drawn by levels of detail.
    pub fn detail(state: &CutState, options: &Options) -> Option<Detailed> {
        options.wants_levels().then(|| Detailed::of(state))
    }

    /// Lists the pages of a picture and waits for them. They are in no particular order.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn chosen(&mut self, device: &Device, scene: &GpuScene, camera: &Camera, options: &Options) -> Result<Chosen> {
        let mut cmd = Commands::new(device)?;
        self.record(&mut cmd, scene, camera, options)?;
        let state = self.read(&mut cmd)?;
        let results = cmd.submit()?.wait()?;
        let state = results.view(&state)[0];
        if !self.has_room(device, scene, &state)? {
            return self.chosen(device, scene, camera, options);
        }
        let pages = self.listed_pages(device, scene, &state)?;
        Ok(Chosen { results, pages, detail: Self::detail(&state, options) })
    }

    /// The pages of the picture that was recorded last, if it had this state.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn listed_pages(&self, device: &Device, scene: &GpuScene, state: &CutState) -> Result<Vec<ChosenPage>> {
        let (first, count) = (first_page(scene) as usize, state.listed as usize);
        let mut listed = Staging::new(device, "pages of the cut", first + count)?;
        let mut pages = Staging::new(device, "numbers of pages", count)?;
        let mut cmd = Commands::new(device)?;
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        cmd.download(&self.listed, &listed, first + count);
        cmd.download(&self.pages, &pages, count);
        cmd.submit()?.wait()?;
        let chosen = |(page, element): (&u32, &Element)| {
            let [_, limits, view, _] = *element;
            ChosenPage { page: *page, view, limits: [limits as u16, (limits >> 16) as u16] }
        };
        Ok(pages.map().iter().take(count).zip(&listed.map()[first..]).map(chosen).collect())
    }
}

/// The lists of so many pages: those in view, those of the cut, their numbers.
fn lists(device: &Device, scene: &GpuScene, room: usize) -> Result<(Buffer<Element>, Buffer<Element>, Buffer<u32>)> {
    let seen = Buffer::new(device, "pages in view", room)?;
    let listed = Buffer::new(device, "pages of the cut", first_page(scene) as usize + room)?;
    let numbers = Buffer::new(device, "numbers of pages", room)?;
    // A frame in flight that has other lists may be judged by these: they name pages that exist.
    let mut cmd = Commands::new(device)?;
    cmd.fill(&numbers, 0);
    cmd.submit()?.wait()?;
    Ok((seen, listed, numbers))
}
