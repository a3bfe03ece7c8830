//! Pictures that never wait for pages: they show the levels that are in device memory, while threads read the pages
//! that the cut wants, the most visible first.
//!
//! The GPU notes the pages that a picture wanted, and lists those that are missing (select_pages.comp). The host reads them
//! and brings some before each picture. Where no slot is free, they take those of pages that were not wanted lately, or
//! that matter less. While the view moves, the pages are asked for, too, that it will want a moment later.

use std::cmp::Reverse;
use std::collections::HashSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Result;
use crossbeam_channel::{Receiver, Sender, unbounded};
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::fallback::Family;
use super::prefetch::Trail;
use super::schedule::{Plan, Question};
use crate::camera::Camera;
use crate::gpu::{Access, Commands, Device, InFlight, Readback, Results};
use crate::lod::CODES_PER_OCTAVE;
use crate::options::Options;
use crate::pagefile::{PageLod, Pages};
use crate::render::lod::{Asked, Chooser};
use crate::render::scene::{GpuScene, Paged, Pool, ReadPage};
use crate::render::shaders::CutState;

/// Brings pages while pictures go on.
pub struct Feed {
    paged: Paged,
    pages: Pages,
    family: Arc<Family>,
    /// The changes of the pool that the floors on the device know of.
    known: Option<u64>,
    /// The copy of these to the device.
    telling: Option<InFlight>,
    /// The floors of blocks for the pages that are there.
    target: Vec<u16>,
    /// Those that are shown. Where nodes fade, they fall to those of the pages that are there.
    floors: Vec<u16>,
    /// Set while they fall: the time of the last step, and of the end.
    falling: Option<[Instant; 2]>,
    fades: bool,
    readers: ThreadPool,
    /// Make floors. A picture waits for them, so these threads have no other work.
    workers: ThreadPool,
    sender: Sender<News>,
    receiver: Receiver<News>,
    /// Memory of pages that were brought, for others: to ask the system for it takes time from all threads.
    spare: (Sender<ReadPage>, Receiver<ReadPage>),
    /// The pages that come next are being chosen.
    is_planning: bool,
    /// Pages that are being read.
    reading: HashSet<u32>,
    /// Pages that were read and are not on the device yet, the most visible first.
    arrived: Vec<(u32, ReadPage)>,
    /// Pages that could not be read.
    unreadable: HashSet<u32>,
    /// Why, until somebody asks.
    problem: Option<anyhow::Error>,
    /// Pages that leave for those that are being read.
    leaving: Vec<u32>,
    asked: Asked,
    trail: Trail,
    /// The view that is expected after the next picture, if it moves and pages can be read for it.
    expected: Option<Camera>,
    /// No slot is free: the next picture tells which pages were wanted.
    is_full: bool,
    /// The last picture asked for pages that matter no more than those that are there.
    is_sated: bool,
    missing: u32,
}

/// What threads report.
enum News {
    Plan(Plan),
    Read(u32, Result<ReadPage>),
}

/// What a picture told about pages.
pub struct Demand {
    missing: Readback<[u32; 2]>,
    /// When, and how much, every page was wanted last.
    wanted: Option<Readback<u32>>,
    /// What the view that is expected later would lack.
    later: Option<(Readback<CutState>, Readback<[u32; 2]>)>,
}

/// How far the pages of a picture that never waits are there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Residency {
    /// Pages of the cut that the last picture drew coarser, because they or others are missing.
    pub missing: u32,
    /// Pages that are being read or brought.
    pub coming: usize,
    /// Pages that are there.
    pub there: usize,
    /// Pages that fit.
    pub fitting: usize,
    /// The next picture asks for more, or shows more of what is there.
    pub is_asking: bool,
}

impl Residency {
    /// True if nothing more comes for this picture.
    pub fn is_settled(&self) -> bool {
        self.coming == 0 && !self.is_asking
    }
}

/// Missing pages that a picture lists at most.
const DEMANDED: usize = 8192;
/// The coarsest pages, which are always there. The last pages of a file are the coarsest.
const COARSEST: usize = 64;
/// Pages that are read at a time, or wait to be brought.
const COMING: usize = 512;
/// Pages that come at which no more are read ahead.
const ENOUGH: usize = COMING / 4;
/// Steps of codes by which a page matters less that is wanted later: two powers of two.
const LATER: u32 = 2 * CODES_PER_OCTAVE as u32;
/// Threads that read, and threads that make floors.
const THREADS: usize = 8;
/// The time in which a floor falls by a power of two.
const OCTAVE: Duration = Duration::from_millis(60);
/// The time after which floors are where they fall to: what is above the limits of nodes cannot be seen.
const FALL: Duration = Duration::from_millis(400);

impl Feed {
    /// Brings the coarsest pages. With `fades`, pages that are brought later fade in.
    ///
    /// # Errors
    /// If they cannot be read.
    ///
    /// # Panics
    /// If the scene has no levels of detail.
    pub fn new(device: &Device, paged: &Paged, chooser: &mut Chooser, fades: bool) -> Result<Self> {
        let mut pool = paged.cache();
        let pages = pool.pages().clone();
        let always: Vec<u32> = coarsest(&pool).collect();
        pool.bring(device, &always)?;
        chooser.make_demand(device, DEMANDED)?;
        let (sender, receiver) = unbounded();
        let threads = std::thread::available_parallelism().map_or(1, usize::from).min(THREADS);
        Ok(Self {
            paged: paged.clone(),
            family: Arc::new(Family::of(levels(&pages))),
            pages,
            known: None,
            telling: None,
            target: Vec::new(),
            floors: Vec::new(),
            falling: None,
            fades,
            readers: ThreadPoolBuilder::new().num_threads(threads).build()?,
            workers: ThreadPoolBuilder::new().num_threads(threads).build()?,
            sender,
            receiver,
            spare: unbounded(),
            is_planning: false,
            reading: HashSet::new(),
            arrived: Vec::new(),
            unreadable: HashSet::new(),
            problem: None,
            leaving: Vec::new(),
            asked: Asked { stamp: 1, ..Asked::default() },
            trail: Trail::default(),
            expected: None,
            is_full: false,
            is_sated: false,
            missing: 0,
        })
    }

    /// Brings pages that were read, and tells the chooser which levels are there. Call it before each picture, with its
    /// view.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn advance(&mut self, device: &Device, chooser: &mut Chooser, camera: &Camera) -> Result<()> {
        self.receive();
        let is_busy = self.is_planning || self.reading.len() + self.arrived.len() > ENOUGH;
        self.expected = self.trail.follow(Instant::now(), camera).filter(|_| !is_busy);
        let paged = self.paged.clone();
        let mut pool = paged.cache();
        let coming = self.arrived.len().min(pool.room());
        let mut read: Vec<_> = self.arrived.drain(..coming).filter(|(page, _)| !pool.has(*page)).collect();
        if !read.is_empty() {
            read.sort_unstable_by_key(|(page, _)| *page);
            let leave = self.leaving.len().min(read.len().saturating_sub(pool.free()));
            let leaving: Vec<u32> = self.leaving.drain(..leave).collect();
            pool.put(device, &read, &leaving)?;
            // Both ends are here, so this does not fail.
            read.into_iter().for_each(|(_, words)| drop(self.spare.0.send(words)));
        }
        let has_changed = self.known != Some(pool.changes());
        if has_changed {
            self.known = Some(pool.changes());
            let are_there = pool.are_there();
            self.target = self.workers.install(|| self.family.floors(|page| are_there[page as usize]));
        }
        if has_changed || self.falling.is_some() {
            self.fall(has_changed);
            // What was told before was submitted before the last picture, so this hardly waits.
            let write = |words: &mut [u32]| self.workers.install(|| self.family.words(&self.floors, words));
            self.telling = Some(chooser.set_floors(device, write)?);
        }
        // After the last stamp comes the first, which is below all that shaders noted: what they noted goes.
        self.asked.stamp = self.asked.stamp.checked_add(1).unwrap_or(1);
        if self.asked.stamp == 1 {
            let mut cmd = Commands::new(device)?;
            cmd.fill(&paged.last_used, 0);
            cmd.submit()?.wait()?;
        }
        chooser.asked = self.asked;
        Ok(())
    }

    /// Brings the floors that are shown nearer to those of the pages that are there.
    fn fall(&mut self, has_changed: bool) {
        let now = Instant::now();
        let is_first = self.floors.is_empty();
        let [before, end] = match self.falling {
            Some([before, end]) => [before, if has_changed { now + FALL } else { end }],
            None => [now, now + FALL],
        };
        if is_first || !self.fades || now >= end {
            self.floors.clone_from(&self.target);
            self.falling = None;
            return;
        }
        let step = (CODES_PER_OCTAVE * (now - before).div_duration_f64(OCTAVE)) as u16;
        for (shown, floor) in self.floors.iter_mut().zip(&self.target) {
            *shown = shown.saturating_sub(step).max(*floor);
        }
        self.falling = Some([now, end]);
    }

    /// Brings what a recorded picture tells to the host. The chooser then chooses for the view that is expected later.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn read(&self, cmd: &mut Commands, chooser: &Chooser, scene: &GpuScene, options: &Options) -> Result<Demand> {
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        let missing = cmd.read(chooser.demand())?;
        let mut later = None;
        if let Some(camera) = &self.expected {
            let asked = Asked { later: LATER, ..self.asked };
            cmd.scope("ahead", |cmd| chooser.record_asked(cmd, scene, camera, options, asked))?;
            later = Some((chooser.read(cmd)?, cmd.read(chooser.demand())?));
        }
        let wanted = self.is_full.then(|| cmd.read(&self.paged.last_used)).transpose()?;
        Ok(Demand { missing, wanted, later })
    }

    /// Begins to read the pages that a finished picture was lacking.
    pub fn take(&mut self, state: &CutState, results: &Results, demand: &Demand) {
        self.receive();
        self.missing = state.missing;
        let listed = |state: &CutState| (state.demanded as usize).min(DEMANDED);
        let mut demanded: Vec<[u32; 2]> = results.view(&demand.missing)[..listed(state)].to_vec();
        demanded.sort_unstable_by_key(|[_, word]| Reverse(word & 0xffff));
        // Of a list that is too long the next picture lists those that matter most.
        let place = DEMANDED * DEMANDED / (2 * (state.demanded as usize).max(1));
        let least = demanded.get(place).filter(|_| state.demanded as usize > DEMANDED);
        self.asked.least_priority = least.map_or(0, |[_, word]| word & 0xffff);
        let pool = self.paged.cache();
        self.is_full = pool.free() == 0;
        if self.is_planning {
            return;
        }
        if let Some((state, missing)) = &demand.later {
            let later = &results.view(missing)[..listed(&results.view(state)[0])];
            demanded.extend(later);
        }
        let coming: HashSet<u32> =
            self.arrived.iter().map(|(page, _)| *page).chain(self.reading.iter().copied()).collect();
        let question = Question {
            demanded,
            wanted: demand.wanted.as_ref().map(|wanted| results.view(wanted).to_vec()),
            stamp: self.asked.stamp,
            is_there: pool.are_there().to_vec(),
            unreadable: self.unreadable.clone(),
            kept: coarsest(&pool).chain(self.leaving.iter().copied()).collect(),
            free: pool.free().saturating_sub(coming.len().saturating_sub(self.leaving.len())),
            most: COMING.saturating_sub(coming.len()),
            coming,
        };
        self.is_planning = true;
        let (family, sender) = (self.family.clone(), self.sender.clone());
        rayon::spawn(move || drop(sender.send(News::Plan(Plan::of(&family, &question)))));
    }

    /// Begins what was planned.
    fn follow(&mut self, plan: Plan) {
        self.is_planning = false;
        self.is_sated = plan.is_sated;
        self.leaving.extend(plan.leave);
        for page in plan.read {
            self.reading.insert(page);
            let (pages, sender, spare) = (self.pages.clone(), self.sender.clone(), self.spare.1.clone());
            self.readers.spawn_fifo(move || {
                let memory = spare.try_recv().ok();
                // The receiver may be gone: then nobody wants the page.
                _ = sender.send(News::Read(page, ReadPage::read(&pages, page, memory)));
            });
        }
    }

    /// Takes in what was planned and read.
    fn receive(&mut self) {
        while let Ok(news) = self.receiver.try_recv() {
            match news {
                News::Plan(plan) => self.follow(plan),
                News::Read(page, read) => {
                    self.reading.remove(&page);
                    match read {
                        Ok(words) => self.arrived.push((page, words)),
                        Err(problem) => {
                            self.unreadable.insert(page);
                            self.problem.get_or_insert(problem);
                        }
                    }
                }
            }
        }
    }

    /// True if another picture would show more, or tell more.
    pub fn has_news(&mut self) -> bool {
        self.receive();
        !self.arrived.is_empty() || self.falling.is_some() || self.is_asking() && !self.is_planning
    }

    /// True if pages are asked for, of this picture or the next.
    fn is_asking(&self) -> bool {
        self.is_planning || self.missing > 0 && self.reading.is_empty() && !self.is_sated
    }

    /// Why a page could not be read, once.
    pub fn take_problem(&mut self) -> Option<anyhow::Error> {
        self.problem.take()
    }

    pub fn residency(&self) -> Residency {
        let pool = self.paged.cache();
        Residency {
            missing: self.missing,
            coming: self.reading.len() + self.arrived.len(),
            there: pool.capacity() - pool.free(),
            fitting: pool.capacity(),
            is_asking: self.is_asking() || self.falling.is_some(),
        }
    }
}

/// The pages that are always there.
fn coarsest(pool: &Pool) -> impl Iterator<Item = u32> + use<> {
    let (pages, most) = (pool.pages().pages().len(), COARSEST.min(pool.capacity().div_ceil(4)));
    (pages.saturating_sub(most)..pages).map(|page| page as u32)
}

fn levels(pages: &Pages) -> &[PageLod] {
    pages.levels().expect("the scene has levels of detail")
}
