//! Pages in device memory: as many as there is room for, those that were used last.

use std::num::NonZeroUsize;
use std::ops::Range;

use anyhow::{Context, Result};
use lru::LruCache;
use rayon::prelude::*;

use crate::gpu::{Access, Buffer, Commands, Device, InFlight, Staging};
use crate::packing::share;
use crate::pagefile::{PAGE, Pages};
use crate::render::shaders::lod::NO_SLOT;

/// Bytes of host memory that pages are read into at a time. There are two of these, so that one is read while the other
/// is copied to the device.
const STAGED: usize = 24 << 20;

/// Pages that are read in one call at most, if they are neighbours.
const RUN: usize = 32;

/// The pages of a scene that are in device memory.
pub struct Pool {
    pages: Pages,
    /// The planes of the slots: of bounds, shapes, indices, spherical harmonics, and of levels if there are any.
    planes: Vec<Buffer<u32>>,
    /// The words of a page in each plane.
    plane_words: Vec<usize>,
    /// The slot of each page that is there; the page used last comes first.
    slots: LruCache<u32, u32>,
    /// The same for shaders: the slot of every page, or [`NO_SLOT`].
    on_device: Buffer<u32>,
    /// For every page, when it was wanted last, and how much: shaders note it where pages are demanded.
    wanted: Buffer<u32>,
    /// By page: it is there.
    is_there: Vec<bool>,
    /// Number of changes of what is there.
    changes: u64,
    staged: [Staged; 2],
    /// Pages that are read at a time.
    room: usize,
    /// The one of `staged` that is filled next.
    next: usize,
    /// What was read so far.
    pub read: PagesRead,
    /// Seed by which pages are evicted at random.
    #[cfg(test)]
    pub churn: Option<u64>,
    /// Pages that were evicted so, of which shaders do not know it yet.
    forgotten: Vec<u32>,
}

/// Pages and bytes that were read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PagesRead {
    pub pages: u64,
    pub bytes: u64,
}

/// The words of a page in host memory: geometry, colours, levels.
pub struct ReadPage([Vec<u32>; 3]);

impl ReadPage {
    /// Reads a page, into the memory of another of the same scene if there is one.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn read(pages: &Pages, page: u32, memory: Option<Self>) -> Result<Self> {
        let mut words = memory.map_or_else(|| words_of(pages).map(|words| vec![0; words]), |page| page.0);
        read_streams(pages, page as usize..page as usize + 1, words.each_mut().map(Vec::as_mut_slice))?;
        Ok(Self(words))
    }
}

/// Reads the geometry, the colours and the levels of neighbouring pages.
fn read_streams(pages: &Pages, run: Range<usize>, [geometry, sh, levels]: [&mut [u32]; 3]) -> Result<()> {
    pages.read_geometry(run.clone(), geometry)?;
    pages.read_colours(run.clone(), sh)?;
    pages.read_levels(run, levels)
}

/// Host memory for some pages, and their copy to the device.
struct Staged {
    memory: Staging<u32>,
    copy: Option<InFlight>,
}

impl Pool {
    /// Device and host memory that a page takes.
    pub fn bytes_each(pages: &Pages) -> u64 {
        4 * words_of(pages).iter().sum::<usize>() as u64
    }

    /// Makes the pool of a scene around planes with room for `slots` pages.
    ///
    /// # Errors
    /// If there is no memory to read pages into.
    pub fn new(device: &Device, pages: Pages, planes: Vec<Buffer<u32>>, slots: usize) -> Result<Self> {
        let words: usize = words_of(&pages).iter().sum();
        // Under a small limit, what is read at a time takes a small part of it.
        let bytes = STAGED.min(device.free_bytes() as usize / 8);
        let room = (bytes / 4 / words).clamp(1, slots.max(1));
        // Behind the pages come their slots, and that of a page that has none.
        let staged =
            || anyhow::Ok(Staged { memory: Staging::new(device, "pages", room * (words + 1) + 1)?, copy: None });
        let capacity = NonZeroUsize::new(slots).context("a pool has a slot")?;
        let on_device = Buffer::new(device, "slots of pages", pages.pages().len())?;
        let wanted = Buffer::new(device, "wanted pages", pages.pages().len())?;
        let mut cmd = Commands::new(device)?;
        cmd.fill(&on_device, NO_SLOT);
        cmd.fill(&wanted, 0);
        cmd.submit()?.wait()?;
        Ok(Self {
            plane_words: plane_words(&pages),
            is_there: vec![false; pages.pages().len()],
            pages,
            planes,
            slots: LruCache::new(capacity),
            on_device,
            wanted,
            changes: 0,
            staged: [staged()?, staged()?],
            room,
            next: 0,
            read: PagesRead::default(),
            #[cfg(test)]
            churn: None,
            forgotten: Vec::new(),
        })
    }

    /// The slot of every page, as shaders know it.
    pub fn slots(&self) -> &Buffer<u32> {
        &self.on_device
    }

    /// For every page, when it was wanted last, and how much, as select_pages.comp notes it.
    pub fn wanted(&self) -> &Buffer<u32> {
        &self.wanted
    }

    /// A number that is another whenever other pages are there.
    pub fn changes(&self) -> u64 {
        self.changes
    }

    /// True if the page is there.
    pub fn has(&self, page: u32) -> bool {
        self.is_there[page as usize]
    }

    /// By page: true if it is there.
    pub fn are_there(&self) -> &[bool] {
        &self.is_there
    }

    /// Pages that fit beside those that are there.
    pub fn free(&self) -> usize {
        self.capacity() - self.slots.len()
    }

    /// The most pages that [`put`](Self::put) takes.
    pub fn room(&self) -> usize {
        self.room
    }

    /// The scene.
    pub fn pages(&self) -> &Pages {
        &self.pages
    }

    /// True if all pages of the scene fit.
    pub fn fits_all(&self) -> bool {
        self.capacity() == self.pages.pages().len()
    }

    /// Number of pages that fit.
    pub fn capacity(&self) -> usize {
        self.slots.cap().get()
    }

    /// True if all pages are on the device, and stay there.
    pub fn has_all(&self) -> bool {
        #[cfg(test)]
        if self.churn.is_some() {
            return false;
        }
        self.slots.len() == self.pages.pages().len()
    }

    /// Brings pages to the device that are not there yet, and returns the slots of all of them. Commands that are
    /// submitted from now on find them there, until the next call.
    ///
    /// # Errors
    /// If a page cannot be read.
    ///
    /// # Panics
    /// If there are more pages than fit.
    pub fn bring(&mut self, device: &Device, wanted: &[u32]) -> Result<Vec<u32>> {
        assert!(wanted.len() <= self.capacity(), "the pages fit");
        #[cfg(test)]
        self.evict_at_random();
        // Those that are there already become the last to leave.
        let mut missing: Vec<u32> = wanted.iter().copied().filter(|page| self.slots.get(page).is_none()).collect();
        missing.sort_unstable();
        missing.dedup();
        for part in missing.chunks(self.room) {
            self.copy(device, part, read_streams)?;
        }
        let slot = |page: &u32| *self.slots.peek(page).expect("the page was brought");
        Ok(wanted.iter().map(slot).collect())
    }

    /// Brings pages that were read already, in the place of those of `leaving` as far as there are no free slots.
    ///
    /// # Errors
    /// If the copy cannot be submitted.
    ///
    /// # Panics
    /// If the pages are not in ascending order, are there already, or are more than [`room`](Self::room).
    pub fn put(&mut self, device: &Device, read: &[(u32, ReadPage)], leaving: &[u32]) -> Result<()> {
        for page in leaving.iter().rev() {
            self.slots.demote(page);
        }
        let part: Vec<u32> = read.iter().map(|(page, _)| *page).collect();
        assert!(part.len() <= self.room && part.is_sorted() && !part.iter().any(|page| self.has(*page)), "new pages");
        self.copy(device, &part, |_, run, parts| {
            let first = part.binary_search(&(run.start as u32)).expect("the run is of these pages");
            for (words, stream) in parts.into_iter().zip(0..) {
                let each = words.chunks_mut((words.len() / run.len()).max(1));
                each.zip(&read[first..]).for_each(|(to, (_, from))| to.copy_from_slice(&from.0[stream]));
            }
            Ok(())
        })
    }

    /// Fills host memory with some pages, which are in ascending order, and submits their copy to slots. `fill` gets
    /// neighbours, and memory for their geometry, colours and levels.
    fn copy(
        &mut self,
        device: &Device,
        part: &[u32],
        fill: impl Fn(&Pages, Range<usize>, [&mut [u32]; 3]) -> Result<()> + Sync,
    ) -> Result<()> {
        let streams = words_of(&self.pages);
        let each: usize = streams.iter().sum();
        let staged = &mut self.staged[self.next];
        self.next = 1 - self.next;
        if let Some(copy) = staged.copy.take() {
            copy.wait()?;
        }
        // The geometries of all pages come first, then their colours, then their levels.
        let (mut rest, slots_on_device) = staged.memory.map().split_at_mut(part.len() * each);
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
        self.changes += 1;
        self.read.pages += part.len() as u64;
        self.read.bytes += 4 * (part.len() * each) as u64;
        let mut cmd = Commands::new(device)?;
        let mut slots = Vec::new();
        for page in part {
            let (slot, evicted) = take_slot(&mut self.slots, *page);
            slots.push(slot as usize);
            self.is_there[*page as usize] = true;
            evicted.into_iter().for_each(|page| leave(&mut self.is_there, page));
            self.forgotten.extend(evicted);
        }
        slots_on_device[part.len()] = NO_SLOT;
        slots_on_device.iter_mut().zip(&slots).for_each(|(to, slot)| *to = *slot as u32);
        let is_gone = |page: &u32| self.is_there.get(*page as usize) == Some(&false);
        let forgotten = std::mem::take(&mut self.forgotten).into_iter().filter(is_gone);
        let numbers: Vec<_> = (part.iter().enumerate().map(|(k, page)| (k, *page)))
            .chain(forgotten.map(|page| (part.len(), page)))
            .map(|(k, page)| (part.len() * each + k, page as usize, 1))
            .collect();
        cmd.upload_parts(&self.staged[1 - self.next].memory, &self.on_device, &numbers);
        // The stream of a plane, where it begins in a page of the stream, and where the stream begins.
        let (mut stream, mut start, mut first) = (0, 0, 0);
        for (plane, words) in self.planes.iter().zip(&self.plane_words) {
            if start == streams[stream] {
                first += part.len() * streams[stream];
                (stream, start) = (stream + 1, 0);
            }
            let place = |k: usize| first + k * streams[stream] + start;
            let regions: Vec<_> = slots.iter().enumerate().map(|(k, slot)| (place(k), slot * words, *words)).collect();
            cmd.upload_parts(&self.staged[1 - self.next].memory, plane, &regions);
            start += words;
        }
        cmd.barrier(Access::COPY_WRITE, Access::SHADER_READ);
        self.staged[1 - self.next].copy = Some(cmd.submit()?);
        Ok(())
    }

    /// Evicts about a quarter of the pages if `churn` is set.
    #[cfg(test)]
    fn evict_at_random(&mut self) {
        let Some(seed) = &mut self.churn else { return };
        let pages: Vec<u32> = self.slots.iter().map(|(page, _)| *page).collect();
        for page in pages {
            *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            if *seed >> 33 & 3 == 0 {
                // The slot stays taken, by a page that no scene has.
                let slot = self.slots.pop(&page).expect("the page is there");
                self.slots.push(u32::MAX - slot, slot);
                self.slots.demote(&(u32::MAX - slot));
                leave(&mut self.is_there, page);
                self.forgotten.push(page);
            }
        }
    }
}

/// Notes that a page is no longer there. Tests have slots of pages that no scene has.
fn leave(is_there: &mut [bool], page: u32) {
    if let Some(is_there) = is_there.get_mut(page as usize) {
        *is_there = false;
    }
}

/// A slot for a page that has none: a free one, or that of the page that was used longest ago, which is returned, too.
fn take_slot(slots: &mut LruCache<u32, u32>, page: u32) -> (u32, Option<u32>) {
    let (evicted, slot) = if slots.len() < slots.cap().get() {
        (None, slots.len() as u32)
    } else {
        let (evicted, slot) = slots.pop_lru().expect("a pool has a slot");
        (Some(evicted), slot)
    };
    slots.push(page, slot);
    (slot, evicted)
}

/// Ascending page numbers as runs of neighbours.
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

/// The words of a page in each stream: geometry, colours, levels.
fn words_of(pages: &Pages) -> [usize; 3] {
    [pages.geometry_words(), pages.colour_words(), pages.level_words()]
}

/// The words of a page in each plane, in the order in which pages have them.
fn plane_words(pages: &Pages) -> Vec<usize> {
    let layout = pages.layout();
    let planes = |words: usize| (0..words.div_ceil(4)).map(move |plane| 4 * PAGE / share(words, plane));
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
    fn neighbours_are_read_together() {
        let many: Vec<u32> = (7..7 + RUN as u32 + 3).collect();
        assert_eq!(runs_of(&[1, 2, 3, 5, 9, 10]), [1..4, 5..6, 9..11]);
        assert_eq!(runs_of(&many), [7..7 + RUN, 7 + RUN..10 + RUN]);
        assert_eq!(runs_of(&[]), []);
    }

    #[test]
    fn a_full_pool_gives_the_slot_of_the_page_used_longest_ago() {
        let mut slots = LruCache::new(NonZeroUsize::new(3).unwrap());
        assert_eq!([5, 6, 7].map(|page| take_slot(&mut slots, page)), [0, 1, 2].map(|slot| (slot, None)));
        assert_eq!(slots.get(&5), Some(&0));
        assert_eq!(take_slot(&mut slots, 8), (1, Some(6)), "6 was used longest ago");
        assert!(slots.peek(&6).is_none() && slots.len() == 3);
    }
}
