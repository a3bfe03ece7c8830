//! The page cache: the resident pages of a scene. It evicts the least recently used page.
//!
//! In streamed frames `streaming/schedule` chooses the pages to evict, by priority; the cache demotes these pages to
//! least recently used.

use std::num::NonZeroUsize;
use std::ops::Range;

use anyhow::{Context, Result};
use lru::LruCache;
use rayon::prelude::*;

use crate::gpu::{Access, Buffer, Commands, Device, InFlight, Staging};
use crate::packing::plane_widths;
use crate::pagefile::{PAGE, Pages};
use crate::render::shaders::lod::NO_SLOT;

/// Bytes of each of the two staging buffers: pages are read into one while the other is copied to the device.
const STAGING_BYTES: usize = 24 << 20;

/// Largest number of consecutive pages in one read.
const RUN: usize = 32;

/// The pages of a scene in device memory.
pub struct PageCache {
    pages: Pages,
    /// The planes with the slots: bounds, shapes, indices, spherical harmonics, and levels of detail if there are any.
    planes: Vec<Buffer<u32>>,
    /// Words per page in each plane.
    plane_words: Vec<usize>,
    /// The slot of each resident page, in order of last use.
    slots: LruCache<u32, u32>,
    /// The slot of each page, or [`NO_SLOT`].
    slots_on_device: Buffer<u32>,
    /// For each page, the stamp of the last streamed frame that used it (upper half), and its priority then.
    last_used: Buffer<u32>,
    /// For each page.
    is_resident: Vec<bool>,
    generation: u64,
    staged: [Staged; 2],
    /// Pages per staging buffer.
    staging_pages: usize,
    /// The one of `staged` to fill next.
    next: usize,
    /// Pages and bytes read since the cache was made.
    pub read: PagesRead,
    /// The state of the random numbers with which pages are evicted before each load.
    #[cfg(test)]
    pub churn: Option<u64>,
    /// Evicted pages that still have a slot in `slots_on_device`.
    stale: Vec<u32>,
}

/// Pages and bytes that were read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PagesRead {
    pub pages: u64,
    pub bytes: u64,
}

/// A page in host memory: the words of its geometry, colours and levels of detail.
pub struct LoadedPage([Vec<u32>; 3]);

impl LoadedPage {
    /// Reads a page, into `memory` of another page of the same scene if given.
    ///
    /// # Errors
    /// If the page cannot be read.
    pub fn read(pages: &Pages, page: u32, memory: Option<Self>) -> Result<Self> {
        let mut words = memory.map_or_else(|| stream_words(pages).map(|words| vec![0; words]), |page| page.0);
        read_streams(pages, page as usize..page as usize + 1, words.each_mut().map(Vec::as_mut_slice))?;
        Ok(Self(words))
    }
}

/// Reads the three streams of consecutive pages: geometry, colours, levels of detail.
fn read_streams(pages: &Pages, run: Range<usize>, [geometry, sh, levels]: [&mut [u32]; 3]) -> Result<()> {
    pages.read_geometry(run.clone(), geometry)?;
    pages.read_colours(run.clone(), sh)?;
    pages.read_levels(run, levels)
}

/// A staging buffer and the last copy from it.
struct Staged {
    memory: Staging<u32>,
    copy: Option<InFlight>,
}

impl PageCache {
    /// Bytes of a page in device memory, as well as in host memory.
    pub fn bytes_each(pages: &Pages) -> u64 {
        4 * stream_words(pages).iter().sum::<usize>() as u64
    }

    /// An empty cache around planes with `slots` slots.
    ///
    /// # Errors
    /// If the staging buffers do not fit.
    pub fn new(device: &Device, pages: Pages, planes: Vec<Buffer<u32>>, slots: usize) -> Result<Self> {
        let words: usize = stream_words(&pages).iter().sum();
        // With a small memory limit, the staging buffers take at most a quarter of the free memory.
        let bytes = STAGING_BYTES.min(device.free_bytes() as usize / 8);
        let staging_pages = (bytes / 4 / words).clamp(1, slots.max(1));
        // The pages are followed by their slots, and one NO_SLOT for all evicted pages.
        let staged = || {
            anyhow::Ok(Staged { memory: Staging::new(device, "pages", staging_pages * (words + 1) + 1)?, copy: None })
        };
        let capacity = NonZeroUsize::new(slots).context("a page cache has a slot")?;
        let slots_on_device = Buffer::new(device, "slots of pages", pages.pages().len())?;
        let last_used = Buffer::new(device, "last use of pages", pages.pages().len())?;
        let mut cmd = Commands::new(device)?;
        cmd.fill(&slots_on_device, NO_SLOT);
        cmd.fill(&last_used, 0);
        cmd.submit()?.wait()?;
        Ok(Self {
            plane_words: plane_words(&pages),
            is_resident: vec![false; pages.pages().len()],
            pages,
            planes,
            slots: LruCache::new(capacity),
            slots_on_device,
            last_used,
            generation: 0,
            staged: [staged()?, staged()?],
            staging_pages,
            next: 0,
            read: PagesRead::default(),
            #[cfg(test)]
            churn: None,
            stale: Vec::new(),
        })
    }

    /// The slot of each page, or [`NO_SLOT`].
    pub fn slots(&self) -> &Buffer<u32> {
        &self.slots_on_device
    }

    /// For each page, the stamp of the last streamed frame that used it in the upper half of the word, and its priority
    /// then in the lower half. Written by select_pages.comp.
    pub fn last_used(&self) -> &Buffer<u32> {
        &self.last_used
    }

    /// The number of changes to the set of resident pages.
    pub fn generation(&self) -> u64 {
        self.generation
    }

    pub fn is_resident(&self, page: u32) -> bool {
        self.is_resident[page as usize]
    }

    /// True for each resident page.
    pub fn residency(&self) -> &[bool] {
        &self.is_resident
    }

    pub fn free_slots(&self) -> usize {
        self.capacity() - self.slots.len()
    }

    /// Largest number of pages per call of [`insert`](Self::insert).
    pub fn max_inserted(&self) -> usize {
        self.staging_pages
    }

    /// The pages of the scene, resident or not.
    pub fn pages(&self) -> &Pages {
        &self.pages
    }

    /// True if all pages of the scene fit.
    pub fn fits_all(&self) -> bool {
        self.capacity() == self.pages.pages().len()
    }

    /// Number of slots.
    pub fn capacity(&self) -> usize {
        self.slots.cap().get()
    }

    /// True if all pages are resident and none is ever evicted.
    pub fn has_all(&self) -> bool {
        #[cfg(test)]
        if self.churn.is_some() {
            return false;
        }
        self.slots.len() == self.pages.pages().len()
    }

    /// Loads the missing ones of these pages, and returns the slots of all of them. They are valid for commands
    /// submitted from now on, until the next call.
    ///
    /// # Errors
    /// If a page cannot be read.
    ///
    /// # Panics
    /// If there are more pages than slots.
    pub fn load(&mut self, device: &Device, pages: &[u32]) -> Result<Vec<u32>> {
        assert!(pages.len() <= self.capacity(), "the pages fit");
        #[cfg(test)]
        self.evict_at_random();
        // The look-up makes resident pages the most recently used, so they are evicted last.
        let mut missing: Vec<u32> = pages.iter().copied().filter(|page| self.slots.get(page).is_none()).collect();
        missing.sort_unstable();
        missing.dedup();
        for part in missing.chunks(self.staging_pages) {
            self.copy(device, part, read_streams)?;
        }
        let slot = |page: &u32| *self.slots.peek(page).expect("the page is resident");
        Ok(pages.iter().map(slot).collect())
    }

    /// Inserts pages that are in host memory. If there are too few free slots, pages of `evicted` lose theirs first.
    ///
    /// # Errors
    /// If the copy cannot be submitted.
    ///
    /// # Panics
    /// If the pages are not in ascending order, are resident already, or are more than
    /// [`max_inserted`](Self::max_inserted).
    pub fn insert(&mut self, device: &Device, loaded: &[(u32, LoadedPage)], evicted: &[u32]) -> Result<()> {
        for page in evicted.iter().rev() {
            self.slots.demote(page);
        }
        let part: Vec<u32> = loaded.iter().map(|(page, _)| *page).collect();
        let are_new = !part.iter().any(|page| self.is_resident(*page));
        assert!(part.len() <= self.staging_pages && part.is_sorted() && are_new, "new pages");
        self.copy(device, &part, |_, run, parts| {
            let first = part.binary_search(&(run.start as u32)).expect("the run is of these pages");
            for (words, stream) in parts.into_iter().zip(0..) {
                let each = words.chunks_mut((words.len() / run.len()).max(1));
                each.zip(&loaded[first..]).for_each(|(to, (_, from))| to.copy_from_slice(&from.0[stream]));
            }
            Ok(())
        })
    }

    /// Stages pages in ascending order and submits their copy to slots, evicting the least recently used pages where no
    /// slot is free. `fill` writes the three streams of consecutive pages.
    fn copy(
        &mut self,
        device: &Device,
        part: &[u32],
        fill: impl Fn(&Pages, Range<usize>, [&mut [u32]; 3]) -> Result<()> + Sync,
    ) -> Result<()> {
        let streams = stream_words(&self.pages);
        let each: usize = streams.iter().sum();
        let staged = &mut self.staged[self.next];
        self.next = 1 - self.next;
        if let Some(copy) = staged.copy.take() {
            copy.wait()?;
        }
        // The geometries of all pages, their colours, and their levels of detail follow each other.
        let (mut rest, staged_slots) = staged.memory.map().split_at_mut(part.len() * each);
        let runs = runs_of(part);
        let mut parts: Vec<Vec<&mut [u32]>> = runs.iter().map(|_| Vec::new()).collect();
        for words in streams {
            for (run, parts) in runs.iter().zip(&mut parts) {
                let (own, others) = rest.split_at_mut(run.len() * words);
                parts.push(own);
                rest = others;
            }
        }
        let pages = &self.pages;
        runs.into_par_iter()
            .zip(parts)
            .try_for_each(|(run, parts)| fill(pages, run, parts.try_into().expect("a page has three streams")))?;
        self.generation += 1;
        self.read.pages += part.len() as u64;
        self.read.bytes += 4 * (part.len() * each) as u64;
        let mut cmd = Commands::new(device)?;
        let mut slots = Vec::new();
        for page in part {
            let (slot, evicted) = allocate_slot(&mut self.slots, *page);
            slots.push(slot as usize);
            self.is_resident[*page as usize] = true;
            evicted.into_iter().for_each(|page| mark_evicted(&mut self.is_resident, page));
            self.stale.extend(evicted);
        }
        staged_slots[part.len()] = NO_SLOT;
        staged_slots.iter_mut().zip(&slots).for_each(|(to, slot)| *to = *slot as u32);
        let is_missing = |page: &u32| self.is_resident.get(*page as usize) == Some(&false);
        let stale = std::mem::take(&mut self.stale).into_iter().filter(is_missing);
        let numbers: Vec<_> = (part.iter().enumerate().map(|(k, page)| (k, *page)))
            .chain(stale.map(|page| (part.len(), page)))
            .map(|(k, page)| (part.len() * each + k, page as usize, 1))
            .collect();
        cmd.upload_parts(&self.staged[1 - self.next].memory, &self.slots_on_device, &numbers);
        // The stream of a plane, its first word in a page of the stream, and the first word of the stream.
        let (mut stream, mut start, mut first) = (0, 0, 0);
        for (plane, words) in self.planes.iter().zip(&self.plane_words) {
            if start == streams[stream] {
                first += part.len() * streams[stream];
                (stream, start) = (stream + 1, 0);
            }
            let word = |k: usize| first + k * streams[stream] + start;
            let regions: Vec<_> = slots.iter().enumerate().map(|(k, slot)| (word(k), slot * words, *words)).collect();
            cmd.upload_parts(&self.staged[1 - self.next].memory, plane, &regions);
            start += words;
        }
        cmd.barrier(Access::COPY_WRITE, Access::SHADER_READ);
        self.staged[1 - self.next].copy = Some(cmd.submit()?);
        Ok(())
    }

    /// Evicts about a quarter of the pages if [`churn`](Self::churn) is set.
    #[cfg(test)]
    fn evict_at_random(&mut self) {
        let Some(seed) = &mut self.churn else { return };
        let pages: Vec<u32> = self.slots.iter().map(|(page, _)| *page).collect();
        for page in pages {
            *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            if *seed >> 33 & 3 == 0 {
                // The slot goes to a page number beyond those of any scene.
                let slot = self.slots.pop(&page).expect("the page is resident");
                self.slots.push(u32::MAX - slot, slot);
                self.slots.demote(&(u32::MAX - slot));
                mark_evicted(&mut self.is_resident, page);
                self.stale.push(page);
            }
        }
    }
}

/// Marks a page as evicted, unless its number is beyond those of the scene.
fn mark_evicted(is_resident: &mut [bool], page: u32) {
    if let Some(is_resident) = is_resident.get_mut(page as usize) {
        *is_resident = false;
    }
}

/// Gives a page a free slot, or the slot of the least recently used page, which is returned as evicted.
fn allocate_slot(slots: &mut LruCache<u32, u32>, page: u32) -> (u32, Option<u32>) {
    let (evicted, slot) = if slots.len() < slots.cap().get() {
        (None, slots.len() as u32)
    } else {
        let (evicted, slot) = slots.pop_lru().expect("a page cache has a slot");
        (Some(evicted), slot)
    };
    slots.push(page, slot);
    (slot, evicted)
}

/// Splits ascending page numbers into runs of consecutive numbers.
fn runs_of(pages: &[u32]) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for page in pages.iter().map(|page| *page as usize) {
        match runs.last_mut() {
            Some(run) if run.end == page && run.len() < RUN => run.end += 1,
            _ => runs.push(page..page + 1),
        }
    }
    runs
}

/// Words per page in each stream: geometry, colours, levels of detail.
fn stream_words(pages: &Pages) -> [usize; 3] {
    [pages.geometry_words(), pages.colour_words(), pages.level_words()]
}

/// Words per page in each plane, in the order of the streams.
fn plane_words(pages: &Pages) -> Vec<usize> {
    let layout = pages.layout();
    let planes = |words: usize| plane_widths(words).map(|width| width * PAGE);
    std::iter::once(4 * PAGE)
        .chain(planes(layout.shape_words()))
        .chain([PAGE])
        .chain(planes(layout.sh_words()))
        .chain(pages.levels().map(|_| pages.level_words()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn consecutive_pages_are_read_together() {
        let many: Vec<u32> = (7..7 + RUN as u32 + 3).collect();
        assert_eq!(runs_of(&[1, 2, 3, 5, 9, 10]), [1..4, 5..6, 9..11]);
        assert_eq!(runs_of(&many), [7..7 + RUN, 7 + RUN..10 + RUN]);
        assert!(runs_of(&[]).is_empty());
    }

    #[test]
    fn a_full_cache_evicts_the_least_recently_used_page() {
        let mut slots = LruCache::new(NonZeroUsize::new(3).unwrap());
        assert_eq!([5, 6, 7].map(|page| allocate_slot(&mut slots, page)), [0, 1, 2].map(|slot| (slot, None)));
        assert_eq!(slots.get(&5), Some(&0));
        assert_eq!(allocate_slot(&mut slots, 8), (1, Some(6)), "6 is the least recently used");
        assert!(slots.peek(&6).is_none() && slots.len() == 3);
    }
}
