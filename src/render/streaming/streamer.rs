//! Streams pages while frames are drawn: no frame waits for a page. Frames show the levels of detail that are resident,
//! while threads read the requested pages in order of their priority.

use std::cmp::Reverse;
use std::collections::HashSet;
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Result;
use crossbeam_channel::{Receiver, Sender, unbounded};
use rayon::ThreadPool;

use super::fallback::{FallbackLimits, PageHierarchy};
use super::prefetch::{CameraMotion, MotionClock};
use super::schedule::{LoadSchedule, ResidencySnapshot};
use crate::camera::Camera;
use crate::gpu::{Access, Commands, Device, InFlight, Readback, Results};
use crate::host_memory::OutOfMemory;
use crate::lod::CODES_PER_OCTAVE;
use crate::options::Options;
use crate::pagefile::{NO_PAGE, PageLod, Pages};
use crate::render::frame::Shot;
use crate::render::lod::{LodSelector, SelectionParams};
use crate::render::scene::{GpuScene, LoadedPage, PageCache, Paged};
use crate::render::shaders::SelectionState;
use crate::threads::pool;

/// Loads and evicts pages of a scene as its frames request them.
pub struct PageStreamer {
    paged: Paged,
    pages: Pages,
    hierarchy: Arc<PageHierarchy>,
    /// The pages that are always resident.
    pinned: Vec<u32>,
    /// Generation of the page cache for which the fallback limits were last uploaded.
    uploaded_generation: Option<u64>,
    /// The last upload of fallback limits.
    upload: Option<InFlight>,
    fallback_limits: FallbackLimits,
    /// While fallback limits decrease: the time of the last step, and the end.
    fade: Option<[Instant; 2]>,
    has_fading: bool,
    readers: ThreadPool,
    sender: Sender<LoadEvent>,
    receiver: Receiver<LoadEvent>,
    /// Memory of inserted pages, for reuse: an allocation by the system stalls all threads.
    spare_memory: (Sender<LoadedPage>, Receiver<LoadedPage>),
    /// True while a worker computes a load schedule.
    is_scheduling: bool,
    /// Pages that threads are reading.
    loading: HashSet<u32>,
    /// Pages in host memory that await their insertion into the page cache, in order of priority.
    loaded: Vec<(u32, LoadedPage)>,
    /// Pages whose read failed.
    unreadable: HashSet<u32>,
    /// The first such failure, until it is reported.
    problem: Option<anyhow::Error>,
    /// Pages to evict when loading pages are inserted.
    evicting: Vec<u32>,
    params: SelectionParams,
    motion: CameraMotion,
    clock: MotionClock,
    /// The camera to prefetch pages for after the next frame, if it moves and the streamer is not busy.
    predicted: Option<Camera>,
    /// True if no slot is free: the next frame reads back which pages were used last.
    is_full: bool,
    /// True if no requested page has a higher priority than the resident pages.
    has_converged: bool,
    missing: u32,
}

/// A message of a worker.
enum LoadEvent {
    Scheduled(LoadSchedule),
    Read(u32, Result<LoadedPage>),
}

/// The page requests of one frame, read back from the GPU.
pub struct PageRequests {
    missing: Readback<[u32; 2]>,
    /// For each page, the stamp of the last frame that used it, and its priority then.
    last_used: Option<Readback<u32>>,
    /// The requests for the predicted camera.
    prefetch: Option<(Readback<SelectionState>, Readback<[u32; 2]>)>,
}

/// The residency of the pages of a streamed frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Residency {
    /// Selected pages that the last frame drew at a coarser level, because these or related pages are not resident.
    pub missing: u32,
    /// Pages that are read or wait for their insertion.
    pub loading: usize,
    /// Resident pages.
    pub resident: usize,
    /// Number of pages that fit.
    pub capacity: usize,
    /// True if the next frame would request more pages, or show finer levels.
    pub is_pending: bool,
}

impl Residency {
    /// True if further frames with the same camera would show the same.
    pub fn is_settled(&self) -> bool {
        self.loading == 0 && !self.is_pending
    }
}

/// Largest number of requests of a frame.
const MAX_REQUESTS: usize = 8192;
/// Least number of pinned pages: the last pages of a file, which are the coarsest.
const PINNED_PAGES: usize = 64;
/// Largest number of pages that are loading or wait for their insertion.
const MAX_LOADING: usize = 512;
/// With more loading pages than this, nothing is prefetched.
const MAX_LOADING_TO_PREFETCH: usize = MAX_LOADING / 4;
/// Priority that prefetched pages lose, in steps of error codes: two powers of two.
const PREFETCH_PENALTY: u32 = 2 * CODES_PER_OCTAVE as u32;
/// Number of reading threads.
const THREADS: usize = 8;
/// Time in which a fallback limit fades by a power of two.
const FADE_PER_OCTAVE: Duration = Duration::from_millis(60);
/// Time after which a fade ends: fallback limits below the error limits of the selection are invisible by then.
const FADE_TIME: Duration = Duration::from_millis(400);

impl PageStreamer {
    /// Loads the pinned pages. With `has_fading`, finer levels fade in when their pages become resident.
    ///
    /// # Errors
    /// If a pinned page cannot be read.
    ///
    /// # Panics
    /// If the scene has no levels of detail.
    pub fn new(device: &Device, paged: &Paged, selector: &mut LodSelector, has_fading: bool) -> Result<Self> {
        let mut cache = paged.cache();
        let pages = cache.pages().clone();
        let pinned = pinned_pages(&cache)?;
        cache.load(device, &pinned)?;
        selector.reserve_requests(device, MAX_REQUESTS)?;
        let (sender, receiver) = unbounded();
        let threads = std::thread::available_parallelism().map_or(1, usize::from).min(THREADS);
        let hierarchy = Arc::new(hierarchy(&pages));
        Ok(Self {
            paged: paged.clone(),
            fallback_limits: FallbackLimits::new(hierarchy.clone()),
            hierarchy,
            pinned,
            pages,
            uploaded_generation: None,
            upload: None,
            fade: None,
            has_fading,
            readers: pool(threads)?,
            sender,
            receiver,
            spare_memory: unbounded(),
            is_scheduling: false,
            loading: HashSet::new(),
            loaded: Vec::new(),
            unreadable: HashSet::new(),
            problem: None,
            evicting: Vec::new(),
            params: SelectionParams { stamp: 1, ..SelectionParams::default() },
            motion: CameraMotion::default(),
            clock: MotionClock::default(),
            predicted: None,
            is_full: false,
            has_converged: false,
            missing: 0,
        })
    }

    /// Prepares the next frame, with this camera: inserts loaded pages into the page cache and updates the fallback
    /// limits.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn advance(&mut self, device: &Device, selector: &mut LodSelector, camera: &Camera) -> Result<()> {
        self.poll();
        let is_busy = self.is_scheduling || self.loading.len() + self.loaded.len() > MAX_LOADING_TO_PREFETCH;
        self.predicted = self.motion.predict(self.clock.now(), camera).filter(|_| !is_busy);
        let paged = self.paged.clone();
        let mut cache = paged.cache();
        let count = self.loaded.len().min(cache.max_inserted());
        let mut loaded: Vec<_> = self.loaded.drain(..count).filter(|(page, _)| !cache.is_resident(*page)).collect();
        if !loaded.is_empty() {
            loaded.sort_unstable_by_key(|(page, _)| *page);
            let count = self.evicting.len().min(loaded.len().saturating_sub(cache.free_slots()));
            let evicted: Vec<u32> = self.evicting.drain(..count).collect();
            cache.insert(device, &loaded, &evicted)?;
            // This object holds both ends of the channel, so it is never closed.
            loaded.into_iter().for_each(|(_, memory)| drop(self.spare_memory.0.send(memory)));
        }
        let has_changed = self.uploaded_generation != Some(cache.generation());
        if has_changed {
            self.uploaded_generation = Some(cache.generation());
            self.fallback_limits.set_resident(cache.residency());
        }
        if has_changed || self.fade.is_some() {
            self.fade_limits(has_changed);
            let changed = self.fallback_limits.changed();
            if !changed.is_empty() {
                // The previous upload was submitted before the last frame, so this hardly waits for it.
                self.upload = Some(selector.set_fallback_limits(device, self.fallback_limits.words(), &changed)?);
                self.fallback_limits.mark_uploaded();
            }
        }
        // Stamps wrap around to 1, which is less than all stamps recorded by shaders, so these are cleared.
        self.params.stamp = self.params.stamp.checked_add(1).unwrap_or(1);
        if self.params.stamp == 1 {
            let mut cmd = Commands::new(device)?;
            cmd.fill(&paged.last_used, 0);
            cmd.submit()?.wait()?;
        }
        selector.params = self.params;
        Ok(())
    }

    /// Lowers the fallback limits in use towards those of the resident pages.
    fn fade_limits(&mut self, has_changed: bool) {
        let now = Instant::now();
        let [before, end] = match self.fade {
            Some([before, end]) => [before, if has_changed { now + FADE_TIME } else { end }],
            None => [now, now + FADE_TIME],
        };
        let is_last = !self.has_fading || now >= end;
        let step = (CODES_PER_OCTAVE * (now - before).div_duration_f64(FADE_PER_OCTAVE)) as u16;
        self.fallback_limits.fade(if is_last { u16::MAX } else { step });
        self.fade = self.fallback_limits.is_fading().then_some([now, end]);
    }

    /// Records the read-back of a frame's requests, then the selection for the predicted camera and its requests.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn record_requests(
        &self,
        cmd: &mut Commands,
        selector: &LodSelector,
        scene: &GpuScene,
        options: &Options,
    ) -> Result<PageRequests> {
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        let missing = cmd.read(selector.requests())?;
        let mut prefetch = None;
        if let Some(camera) = &self.predicted {
            let params = SelectionParams { priority_penalty: PREFETCH_PENALTY, ..self.params };
            cmd.scope("ahead", |cmd| selector.record_with(cmd, Shot::new(scene, camera), options, params))?;
            prefetch = Some((selector.read(cmd)?, cmd.read(selector.requests())?));
        }
        let last_used = self.is_full.then(|| cmd.read(&self.paged.last_used)).transpose()?;
        Ok(PageRequests { missing, last_used, prefetch })
    }

    /// Handles the requests of a finished frame: a worker computes the load schedule for them, unless it is still busy
    /// with those of an earlier frame.
    pub fn handle_requests(&mut self, state: &SelectionState, results: &Results, requests: &PageRequests) {
        self.poll();
        self.missing = state.missing;
        let count = |state: &SelectionState| (state.requested as usize).min(MAX_REQUESTS);
        let mut requested: Vec<[u32; 2]> = results.view(&requests.missing)[..count(state)].to_vec();
        requested.sort_unstable_by_key(|[_, word]| Reverse(word & 0xffff));
        // If the list overflowed, the next frame lists only the requests of the highest priorities.
        let rank = MAX_REQUESTS * MAX_REQUESTS / (2 * (state.requested as usize).max(1));
        let least = requested.get(rank).filter(|_| state.requested as usize > MAX_REQUESTS);
        self.params.min_priority = least.map_or(0, |[_, word]| word & 0xffff);
        let cache = self.paged.cache();
        self.is_full = cache.free_slots() == 0;
        if self.is_scheduling {
            return;
        }
        if let Some((state, missing)) = &requests.prefetch {
            requested.extend(&results.view(missing)[..count(&results.view(state)[0])]);
        }
        let loading: HashSet<u32> =
            self.loaded.iter().map(|(page, _)| *page).chain(self.loading.iter().copied()).collect();
        let reserved = loading.len().saturating_sub(self.evicting.len());
        let snapshot = ResidencySnapshot {
            requested,
            last_used: requests.last_used.as_ref().map(|last_used| results.view(last_used).to_vec()),
            stamp: self.params.stamp,
            is_resident: cache.residency().to_vec(),
            unreadable: self.unreadable.clone(),
            not_evictable: self.pinned.iter().chain(&self.evicting).copied().collect(),
            free_slots: cache.free_slots().saturating_sub(reserved),
            max_loads: MAX_LOADING.saturating_sub(loading.len()),
            loading,
        };
        self.is_scheduling = true;
        let (hierarchy, sender) = (self.hierarchy.clone(), self.sender.clone());
        rayon::spawn(move || drop(sender.send(LoadEvent::Scheduled(LoadSchedule::of(&hierarchy, &snapshot)))));
    }

    /// Starts the loads of a schedule, and marks its evictions.
    fn start_loads(&mut self, schedule: LoadSchedule) {
        self.is_scheduling = false;
        self.has_converged = schedule.has_converged;
        self.evicting.extend(schedule.evict);
        for page in schedule.load {
            self.loading.insert(page);
            let (pages, sender, spare) = (self.pages.clone(), self.sender.clone(), self.spare_memory.1.clone());
            self.readers.spawn_fifo(move || {
                let memory = spare.try_recv().ok();
                // The channel is closed if the streamer was dropped: then no frame needs the page.
                _ = sender.send(LoadEvent::Read(page, LoadedPage::read(&pages, page, memory)));
            });
        }
    }

    /// Handles the messages of the workers so far.
    fn poll(&mut self) {
        while let Ok(event) = self.receiver.try_recv() {
            self.handle(event);
        }
    }

    fn handle(&mut self, event: LoadEvent) {
        match event {
            LoadEvent::Scheduled(schedule) => self.start_loads(schedule),
            LoadEvent::Read(page, read) => {
                self.loading.remove(&page);
                match read {
                    Ok(memory) => self.loaded.push((page, memory)),
                    Err(problem) => {
                        self.unreadable.insert(page);
                        self.problem.get_or_insert(problem);
                    }
                }
            }
        }
    }

    /// True if another frame with the same camera would show finer levels, or request more pages.
    pub fn needs_frame(&mut self) -> bool {
        self.poll();
        !self.loaded.is_empty() || self.fade.is_some() || self.is_requesting() && !self.is_scheduling
    }

    /// True if requests are being scheduled, or the next frame has some.
    fn is_requesting(&self) -> bool {
        self.is_scheduling || self.missing > 0 && self.loading.is_empty() && !self.has_converged
    }

    /// The first failure of a read since the last call.
    pub fn take_problem(&mut self) -> Option<anyhow::Error> {
        self.problem.take()
    }

    pub fn residency(&self) -> Residency {
        let cache = self.paged.cache();
        Residency {
            missing: self.missing,
            loading: self.loading.len() + self.loaded.len(),
            resident: cache.capacity() - cache.free_slots(),
            capacity: cache.capacity(),
            is_pending: self.is_requesting() || self.fade.is_some(),
        }
    }
}

/// The handles of tests, which make the streamer independent of time.
#[cfg(test)]
impl PageStreamer {
    /// Sets the time of the motion clock, which then stands still.
    pub fn set_motion_time(&mut self, time: Duration) {
        self.clock = MotionClock::Fixed(time);
    }

    /// Waits until the workers have finished: all scheduled pages are in host memory.
    pub fn wait_for_loads(&mut self) {
        while self.is_scheduling || !self.loading.is_empty() {
            let event = self.receiver.recv().expect("this object holds both ends of the channel");
            self.handle(event);
        }
    }
}

/// The pages that are always resident: the last ones of each scene, and those in whose place no coarser page can be
/// drawn, as all of a scene without levels.
///
/// # Errors
/// [`OutOfMemory`] if they leave little of the cache for others.
fn pinned_pages(cache: &PageCache) -> Result<Vec<u32>> {
    let (scenes, levels) = (cache.pages().scenes(), levels(cache.pages()));
    let most = (PINNED_PAGES / scenes.len()).min(cache.capacity().div_ceil(4 * scenes.len())).max(1);
    let is_pinned = |page: usize, end: usize| page + most >= end || levels[page].parent == NO_PAGE;
    let of_scene = |pages: Range<usize>| {
        let end = pages.end;
        pages.filter(move |page| is_pinned(*page, end)).map(|page| page as u32)
    };
    let pinned: Vec<u32> = scenes.into_iter().flat_map(of_scene).collect();
    let leaves_room = pinned.len() <= cache.capacity() - cache.capacity() / 8;
    if cache.capacity() < levels.len() && (pinned.len() > cache.capacity() || !leaves_room) {
        let (fit, all) = (cache.capacity(), pinned.len());
        let reason = format!("{fit} pages fit, and {all} have no coarser pages that could be drawn in their place");
        return Err(OutOfMemory { name: "pages of scenes".to_owned(), bytes: None, reason }.into());
    }
    Ok(pinned)
}

fn hierarchy(pages: &Pages) -> PageHierarchy {
    let scenes = pages.scenes();
    PageHierarchy::new(levels(pages), |page| scenes.partition_point(|of_scene| of_scene.end <= page))
}

fn levels(pages: &Pages) -> &[PageLod] {
    pages.levels().expect("the scene has levels of detail")
}
