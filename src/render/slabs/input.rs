//! Where the Gaussians of a slab come from: planes that hold the whole scene, or pages that are brought when they are
//! needed.

use std::ops::Range;
use std::sync::MutexGuard;

use anyhow::Result;
use rayon::prelude::*;

use super::partition::{Estimate, Place, place_of};
use super::report::Parts;
use crate::camera::Camera;
use crate::gpu::{Buffer, Commands, Device};
use crate::options::Options;
use crate::render::frame::DepthKeys;
use crate::render::lod::{Chosen, ChosenPage, part};
use crate::render::pages::{
    Element, ListedPage, Open, PlacedCamera, Sight, VisiblePage, first_page, number_of_pages, room_for_pages,
};
use crate::render::scene::{GpuScene, PagesRead, Pool};
use crate::render::shaders::pages::PAGE;

/// What splats are listed in: bins, or tiles.
#[derive(Clone, Copy)]
pub struct Cells {
    /// Width and height, px.
    pub side_px: [u32; 2],
    /// Columns and rows.
    pub count: [u32; 2],
    /// The largest depth key of a splat in one.
    pub largest_key: u32,
}

/// A buffer for the views and the pages that slabs list. A scene that is there as a whole is listed once.
pub fn listed_at_first(device: &Device, scene: &GpuScene) -> Result<Buffer<Element>> {
    let page = |slot: u32| {
        let rest = scene.len() as u32 - slot * PAGE;
        ListedPage { slot, limits: 0, view: 0, filled: rest.min(PAGE), has_indices: false }.element()
    };
    let all = if scene.is_paged() { 0 } else { scene.len().div_ceil(PAGE as usize) as u32 };
    let pages: Vec<Element> = (0..all).map(page).collect();
    let first = first_page(scene) as usize;
    let listed = Buffer::new(device, "listed pages", first + room_for_pages(scene))?;
    let mut cmd = Commands::new(device)?;
    cmd.upload(&listed, first - 1, 1 + pages.len(), |memory| {
        memory[0] = number_of_pages(pages.len());
        memory[1..].copy_from_slice(&pages);
    })?;
    cmd.submit()?.wait()?;
    Ok(listed)
}

/// The Gaussians of one frame.
pub enum Supply<'a> {
    /// All are in device memory: this many.
    Whole(usize),
    Paged(Box<Paged<'a>>),
}

/// The pages of one frame.
pub struct Paged<'a> {
    pub pool: MutexGuard<'a, Pool>,
    /// In the order of their nearest depth.
    visible: Vec<VisiblePage>,
    open: Open,
    /// Open bins at the last estimate.
    open_then: u32,
    bins: [u32; 2],
    /// For each page of the scene, a number that is [`NONE`] between two calls.
    noted: Vec<u32>,
}

/// An estimate is renewed when this part of its open bins is left.
const RENEWED: f64 = 0.9;

/// No slot and no batch.
const NONE: u32 = u32::MAX;

/// Pages that a thread looks at at a time.
const LOOKED_AT: usize = 4096;

impl<'a> Supply<'a> {
    /// `chosen`: the pages of a scene in pages.
    pub fn of(
        scene: &'a GpuScene,
        camera: &Camera,
        options: &Options,
        (keys, cells): (DepthKeys, Cells),
        chosen: Option<&Chosen>,
    ) -> Self {
        let (Some(paged), Some(chosen)) = (scene.paged(), chosen) else { return Self::Whole(scene.len()) };
        let pool = paged.cache();
        let alpha_min = pool.pages().alpha_min();
        let sight = Sight {
            rules: &options.rules,
            alpha_min,
            keys,
            bin_px: cells.side_px,
            bins: cells.count,
            largest_key: cells.largest_key,
        };
        let pages = pool.pages().pages();
        let cameras: Vec<_> = scene.transforms().iter().map(|place| PlacedCamera::of(camera, place)).collect();
        let levels = pool.pages().levels();
        let seen = |chosen: &ChosenPage| {
            let ChosenPage { page, view, limits } = *chosen;
            let (number, page) = (page, &pages[page as usize]);
            let place = sight.page(number, page, view, &cameras[view as usize])?;
            let drawn = levels.map_or(1.0, |levels| part(&levels[number as usize], limits)) * f64::from(page.count);
            let limits = u32::from(limits[0]) | u32::from(limits[1]) << 16;
            Some(VisiblePage { limits, drawn: drawn.ceil() as u32, ..place })
        };
        let mut visible: Vec<_> = chosen.pages.par_iter().with_min_len(1024).filter_map(seen).collect();
        visible.par_sort_unstable_by_key(|page| (page.keys[0], page.view, page.page));
        let all = vec![u32::MAX; cells.count.iter().product::<u32>().div_ceil(32) as usize];
        let (open, noted) = (Open::of(&all, cells.count), vec![NONE; pages.len()]);
        Self::Paged(Box::new(Paged { pool, visible, open, open_then: 0, bins: cells.count, noted }))
    }

    /// True if the scene is in pages.
    pub fn is_paged(&self) -> bool {
        matches!(self, Self::Paged(_))
    }

    /// Where the splats are expected that may still be seen; `end`: the place behind the last.
    pub fn estimate(&mut self, end: Place) -> Estimate {
        match self {
            Self::Whole(gaussians) => Estimate::uniform(end, *gaussians as f64),
            Self::Paged(paged) => {
                paged.open_then = paged.open.count();
                let seen = paged.visible.iter().filter(|page| paged.open.meets(page));
                Estimate::of(end, seen.map(|page| (page.keys, page.drawn)))
            }
        }
    }

    /// True if many bins were closed since the last estimate.
    pub fn has_closed_many(&self) -> bool {
        match self {
            Self::Whole(_) => false,
            Self::Paged(paged) => f64::from(paged.open.count()) < RENEWED * f64::from(paged.open_then),
        }
    }

    /// The report of a frame that begins: `since` ends it.
    pub fn parts(&self) -> Parts {
        let Self::Paged(paged) = self else { return Parts::default() };
        let PagesRead { pages, bytes } = paged.pool.read;
        let pages_in_view = paged.visible.len() as u64;
        Parts { pages_in_view, pages_read: pages, bytes_read: bytes, ..Parts::default() }
    }

    /// What was read since the frame began.
    pub fn since(&self, begin: Parts) -> Parts {
        let Self::Paged(paged) = self else { return begin };
        let PagesRead { pages, bytes } = paged.pool.read;
        Parts { pages_read: pages - begin.pages_read, bytes_read: bytes - begin.bytes_read, ..begin }
    }

    /// Notes which bins are still open after a slab. True if nothing behind it can be seen any more.
    pub fn close(&mut self, open_bins: &[u32]) -> bool {
        match self {
            Self::Whole(_) => open_bins.iter().all(|word| *word == 0),
            Self::Paged(paged) => {
                paged.open = Open::of(open_bins, paged.bins);
                // What is hidden now stays hidden.
                let open = &paged.open;
                let visible = std::mem::take(&mut paged.visible).into_par_iter().with_min_len(LOOKED_AT);
                paged.visible = visible.filter(|page| open.meets(page)).collect();
                paged.open.count() == 0
            }
        }
    }

    /// Reads pages that a slab will probably need.
    pub fn read_ahead(&mut self, device: &Device, slab: &Range<Place>) -> Result<()> {
        let Self::Paged(paged) = self else { return Ok(()) };
        if paged.pool.has_all() {
            return Ok(());
        }
        let wanted = paged.wanted(slab);
        let most = paged.pool.capacity() / 2;
        let first = batches(&wanted, most.max(1), usize::MAX, &mut paged.noted).next();
        let numbers = paged.different(&wanted[first.unwrap_or(0..0)]);
        paged.pool.bring(device, &numbers).map(drop)
    }
}

impl Paged<'_> {
    /// The pages that may have splats in a slab which touch an open bin.
    pub fn wanted(&self, slab: &Range<Place>) -> Vec<VisiblePage> {
        let nearer = self.visible.partition_point(|page| place_of(page.keys[0]) < slab.end);
        let pages = self.visible[..nearer].par_iter().with_min_len(LOOKED_AT);
        pages.filter(|page| page.is_in(slab) && self.open.meets(page)).copied().collect()
    }

    /// Parts of the wanted pages that are drawn by one dispatch each, which lists at most `room` pages. A page may be
    /// wanted at many placements, and needs one slot for all of them.
    pub fn batches(&mut self, wanted: &mut [VisiblePage], room: usize) -> Vec<Range<usize>> {
        if !self.pool.has_all() {
            // Each page is brought once for all of its placements. With one placement, the order stays that of depths.
            if wanted.iter().any(|page| page.view != wanted[0].view) {
                wanted.par_sort_unstable_by_key(|page| (page.page, page.view));
            }
        }
        batches(wanted, self.pool.capacity(), room, &mut self.noted).collect()
    }

    /// Brings the pages of a batch to the device, and lists them.
    pub fn bring(&mut self, device: &Device, batch: &[VisiblePage]) -> Result<Vec<Element>> {
        let numbers = self.different(batch);
        let slots = self.pool.bring(device, &numbers)?;
        numbers.iter().zip(&slots).for_each(|(number, slot)| self.noted[*number as usize] = *slot);
        let listed = |page: &VisiblePage| {
            let VisiblePage { page, view, limits, count, .. } = *page;
            let slot = self.noted[page as usize];
            ListedPage { slot, limits, view, filled: count, has_indices: true }.element()
        };
        let listed = batch.iter().map(listed).collect();
        numbers.iter().for_each(|number| self.noted[*number as usize] = NONE);
        Ok(listed)
    }

    /// The numbers of these pages, each once.
    pub fn different(&mut self, pages: &[VisiblePage]) -> Vec<u32> {
        let mut numbers = Vec::new();
        for page in pages {
            let noted = &mut self.noted[page.page as usize];
            if *noted == NONE {
                *noted = 0;
                numbers.push(page.page);
            }
        }
        numbers.iter().for_each(|number| self.noted[*number as usize] = NONE);
        numbers
    }
}

/// Cuts a list of pages into stretches with at most `different` different pages and `room` pages. `noted` has an entry
/// for each page of the scene: [`NONE`] before and after.
fn batches(
    pages: &[VisiblePage],
    different: usize,
    room: usize,
    noted: &mut [u32],
) -> std::vec::IntoIter<Range<usize>> {
    let mut found: Vec<Range<usize>> = Vec::new();
    let (mut begin, mut those) = (0, 0);
    for (place, page) in pages.iter().enumerate() {
        let is_new = noted[page.page as usize] != found.len() as u32;
        if place - begin == room || (is_new && those == different) {
            found.push(begin..place);
            (begin, those) = (place, 0);
        }
        let noted = &mut noted[page.page as usize];
        if *noted != found.len() as u32 {
            *noted = found.len() as u32;
            those += 1;
        }
    }
    if begin < pages.len() {
        found.push(begin..pages.len());
    }
    pages.iter().for_each(|page| noted[page.page as usize] = NONE);
    found.into_iter()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(pages: &[u32], different: usize, room: usize) -> Vec<Range<usize>> {
        let page = |page: &u32| VisiblePage {
            page: *page,
            view: 0,
            keys: [0, 0],
            columns: [0, 1],
            rows: [0, 1],
            count: 1,
            drawn: 1,
            limits: 0,
        };
        let pages: Vec<_> = pages.iter().map(page).collect();
        let mut noted = vec![NONE; 10];
        let found = batches(&pages, different, room, &mut noted).collect();
        assert_eq!(noted, [NONE; 10]);
        found
    }

    #[test]
    fn a_batch_has_as_many_pages_as_slots_and_as_many_entries_as_room() {
        assert_eq!(cut(&[], 2, 3), []);
        assert_eq!(cut(&[0, 1, 2, 3, 4], 2, 9), [0..2, 2..4, 4..5]);
        assert_eq!(cut(&[7, 7, 7, 7, 7], 1, 2), [0..2, 2..4, 4..5]);
        assert_eq!(cut(&[0, 1, 0, 1, 2, 1, 0], 2, 9), [0..4, 4..6, 6..7]);
        assert_eq!(cut(&[0, 0, 1, 1, 2, 2], 2, 3), [0..3, 3..6]);
        assert_eq!(cut(&[3, 4, 5], 9, 9).first(), Some(&(0..3)));
    }
}
