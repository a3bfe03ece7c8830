//! The input of a slab: planes that hold the whole scene, or pages that are loaded when a slab needs them.

use std::ops::Range;
use std::sync::MutexGuard;

use anyhow::Result;
use rayon::prelude::*;

use super::partition::Estimate;
use super::report::SlabReport;
use crate::gpu::Device;
use crate::options::Options;
use crate::render::frame::{DepthKeys, Shot, SortPosition, position_of};
use crate::render::lod::{SelectedPage, Selection, drawn_fraction};
use crate::render::pages::{Element, OpenBinTable, PageCuller, PageDraw, PlacedCamera, VisiblePage};
use crate::render::scene::{PageCache, PagesRead};

/// The grid of bins or tiles in which splats are listed.
#[derive(Clone, Copy)]
pub struct CellGrid {
    /// Width and height of a cell, px.
    pub cell_px: [u32; 2],
    /// Columns and rows of cells.
    pub cells: [u32; 2],
    /// The row of the picture with which the first cells begin.
    pub top_px: u32,
    pub keys: DepthKeys,
    /// The largest depth key of a listed splat.
    pub largest_key: u32,
}

/// The Gaussians of one frame.
pub enum SlabInput<'a> {
    /// The number of Gaussians, which are all in device memory.
    Whole(usize),
    Paged(Box<PagedInput<'a>>),
}

/// The pages of one frame.
pub struct PagedInput<'a> {
    pub cache: MutexGuard<'a, PageCache>,
    /// The pages that may be visible, by their nearest depth.
    visible: Vec<VisiblePage>,
    /// The bins that are still open.
    open: OpenBinTable,
    /// The number of open bins at the last estimate.
    estimated_open: u32,
    bins: [u32; 2],
    /// A mark for each page of the scene, [`NONE`] between two calls: while one runs, the slot or batch of the page.
    marks: Vec<u32>,
}

/// The fraction of the open bins of an estimate below which it is renewed.
const RENEWED: f64 = 0.9;

/// The mark of a page without a slot or batch.
const NONE: u32 = u32::MAX;

/// Pages that a thread tests at a time.
const PAGES_PER_TASK: usize = 4096;

impl<'a> SlabInput<'a> {
    /// The input of a frame. For a scene in pages, it has the pages of `selection` that may be visible.
    pub fn of(shot: Shot<'a>, options: &Options, grid: CellGrid, selection: Option<&Selection>) -> Self {
        let Shot { scene, camera, .. } = shot;
        let (Some(paged), Some(selection)) = (scene.paged(), selection) else { return Self::Whole(scene.len()) };
        let cache = paged.cache();
        let alpha_min = cache.pages().alpha_min();
        let culler = PageCuller {
            rules: &options.rules,
            alpha_min,
            keys: grid.keys,
            bin_px: grid.cell_px,
            bins: grid.cells,
            top_px: grid.top_px,
            largest_key: grid.largest_key,
        };
        let pages = cache.pages().pages();
        let cameras: Vec<_> = scene.transforms().iter().map(|place| PlacedCamera::of(camera, place)).collect();
        let levels = cache.pages().levels();
        let seen = |selected: &SelectedPage| {
            let SelectedPage { page, view, error_limits } = *selected;
            let (number, page) = (page, &pages[page as usize]);
            let place = culler.page(number, page, view, &cameras[view as usize])?;
            let drawn = levels.map_or(1.0, |levels| drawn_fraction(&levels[number as usize], error_limits))
                * f64::from(page.count);
            let error_limits = u32::from(error_limits[0]) | u32::from(error_limits[1]) << 16;
            Some(VisiblePage { error_limits, drawn: drawn.ceil() as u32, ..place })
        };
        let mut visible: Vec<_> = selection.pages.par_iter().with_min_len(1024).filter_map(seen).collect();
        visible.par_sort_unstable_by_key(|page| (page.keys[0], page.view, page.page));
        let open = OpenBinTable::of(&shot.open_cells(grid.cell_px, grid.cells), grid.cells);
        let marks = vec![NONE; pages.len()];
        Self::Paged(Box::new(PagedInput { cache, visible, open, estimated_open: 0, bins: grid.cells, marks }))
    }

    /// True if the scene is in pages.
    pub fn is_paged(&self) -> bool {
        matches!(self, Self::Paged(_))
    }

    /// The expected positions of the splats that may still be visible; `end` is behind the last of them.
    pub fn estimate(&mut self, end: SortPosition) -> Estimate {
        match self {
            Self::Whole(gaussians) => Estimate::uniform(end, *gaussians as f64),
            Self::Paged(paged) => {
                paged.estimated_open = paged.open.count();
                let seen = paged.visible.iter().filter(|page| paged.open.touches(page));
                Estimate::of(end, seen.map(|page| (page.keys, page.drawn)))
            }
        }
    }

    /// True if many bins were closed since the last estimate.
    pub fn has_closed_many(&self) -> bool {
        match self {
            Self::Whole(_) => false,
            Self::Paged(paged) => f64::from(paged.open.count()) < RENEWED * f64::from(paged.estimated_open),
        }
    }

    /// The report at the begin of a frame, with the counts of the cache until then: `end_report` subtracts them.
    pub fn begin_report(&self) -> SlabReport {
        let Self::Paged(paged) = self else { return SlabReport::default() };
        let PagesRead { pages, bytes } = paged.cache.read;
        let pages_in_view = paged.visible.len() as u64;
        SlabReport { pages_in_view, pages_read: pages, bytes_read: bytes, ..SlabReport::default() }
    }

    /// The report with the pages that were read since the frame began.
    pub fn end_report(&self, begin: SlabReport) -> SlabReport {
        let Self::Paged(paged) = self else { return begin };
        let PagesRead { pages, bytes } = paged.cache.read;
        SlabReport { pages_read: pages - begin.pages_read, bytes_read: bytes - begin.bytes_read, ..begin }
    }

    /// Takes over the bins that are still open after a slab, a bit each. True if none is: what lies behind is hidden.
    pub fn close(&mut self, open_bins: &[u32]) -> bool {
        match self {
            Self::Whole(_) => open_bins.iter().all(|word| *word == 0),
            Self::Paged(paged) => {
                paged.open = OpenBinTable::of(open_bins, paged.bins);
                // A hidden page stays hidden.
                let open = &paged.open;
                let visible = std::mem::take(&mut paged.visible).into_par_iter().with_min_len(PAGES_PER_TASK);
                paged.visible = visible.filter(|page| open.touches(page)).collect();
                paged.open.count() == 0
            }
        }
    }

    /// Loads pages that a slab will probably need, before its partition is known.
    ///
    /// # Errors
    /// If a page cannot be read.
    pub fn load_ahead(&mut self, device: &Device, slab: &Range<SortPosition>) -> Result<()> {
        let Self::Paged(paged) = self else { return Ok(()) };
        if paged.cache.has_all() {
            return Ok(());
        }
        let needed = paged.needed(slab);
        let most = paged.cache.capacity() / 2;
        let first = batches(&needed, most.max(1), usize::MAX, &mut paged.marks).into_iter().next();
        let numbers = paged.distinct(&needed[first.unwrap_or(0..0)]);
        paged.cache.load(device, &numbers).map(drop)
    }
}

impl PagedInput<'_> {
    /// The pages that may have splats in a slab which touch an open bin.
    pub fn needed(&self, slab: &Range<SortPosition>) -> Vec<VisiblePage> {
        let nearer = self.visible.partition_point(|page| position_of(page.keys[0]) < slab.end);
        let pages = self.visible[..nearer].par_iter().with_min_len(PAGES_PER_TASK);
        pages.filter(|page| page.is_in(slab) && self.open.touches(page)).copied().collect()
    }

    /// Cuts the pages of a slab into batches that one dispatch each draws, of at most `list_capacity` pages. A page may
    /// be listed for many scene instances, and takes one slot for all of them.
    pub fn batches(&mut self, needed: &mut [VisiblePage], list_capacity: usize) -> Vec<Range<usize>> {
        if !self.cache.has_all() {
            // Each page is loaded once for all of its scene instances. With one scene instance, the order stays that of
            // depths.
            if needed.iter().any(|page| page.view != needed[0].view) {
                needed.par_sort_unstable_by_key(|page| (page.page, page.view));
            }
        }
        batches(needed, self.cache.capacity(), list_capacity, &mut self.marks)
    }

    /// Makes the pages of a batch resident, and lists them.
    ///
    /// # Errors
    /// If a page cannot be read.
    pub fn load(&mut self, device: &Device, batch: &[VisiblePage]) -> Result<Vec<Element>> {
        let numbers = self.distinct(batch);
        let slots = self.cache.load(device, &numbers)?;
        numbers.iter().zip(&slots).for_each(|(number, slot)| self.marks[*number as usize] = *slot);
        let listed = |page: &VisiblePage| {
            let VisiblePage { page, view, error_limits, count, .. } = *page;
            let slot = self.marks[page as usize];
            PageDraw { slot, error_limits, view, count, has_indices: true }.element()
        };
        let listed = batch.iter().map(listed).collect();
        numbers.iter().for_each(|number| self.marks[*number as usize] = NONE);
        Ok(listed)
    }

    /// The numbers of these pages, each once.
    pub fn distinct(&mut self, pages: &[VisiblePage]) -> Vec<u32> {
        let mut numbers = Vec::new();
        for page in pages {
            let mark = &mut self.marks[page.page as usize];
            if *mark == NONE {
                *mark = 0;
                numbers.push(page.page);
            }
        }
        numbers.iter().for_each(|number| self.marks[*number as usize] = NONE);
        numbers
    }
}

/// Cuts a list of pages into batches of at most `distinct` different pages and `capacity` entries. `marks` has an entry
/// for each page of the scene: [`NONE`] before and after.
fn batches(pages: &[VisiblePage], distinct: usize, capacity: usize, marks: &mut [u32]) -> Vec<Range<usize>> {
    let mut found: Vec<Range<usize>> = Vec::new();
    let (mut begin, mut count) = (0, 0);
    for (entry, page) in pages.iter().enumerate() {
        let is_new = marks[page.page as usize] != found.len() as u32;
        if entry - begin == capacity || (is_new && count == distinct) {
            found.push(begin..entry);
            (begin, count) = (entry, 0);
        }
        let mark = &mut marks[page.page as usize];
        if *mark != found.len() as u32 {
            *mark = found.len() as u32;
            count += 1;
        }
    }
    if begin < pages.len() {
        found.push(begin..pages.len());
    }
    pages.iter().for_each(|page| marks[page.page as usize] = NONE);
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(pages: &[u32], distinct: usize, capacity: usize) -> Vec<Range<usize>> {
        let page = |page: &u32| VisiblePage {
            page: *page,
            view: 0,
            keys: [0, 0],
            columns: [0, 1],
            rows: [0, 1],
            count: 1,
            drawn: 1,
            error_limits: 0,
        };
        let pages: Vec<_> = pages.iter().map(page).collect();
        let mut marks = vec![NONE; 10];
        let found = batches(&pages, distinct, capacity, &mut marks);
        assert_eq!(marks, [NONE; 10]);
        found
    }

    #[test]
    fn a_batch_has_at_most_as_many_pages_as_slots_and_as_many_entries_as_the_list() {
        assert!(cut(&[], 2, 3).is_empty());
        assert_eq!(cut(&[0, 1, 2, 3, 4], 2, 9), [0..2, 2..4, 4..5]);
        assert_eq!(cut(&[7, 7, 7, 7, 7], 1, 2), [0..2, 2..4, 4..5]);
        assert_eq!(cut(&[0, 1, 0, 1, 2, 1, 0], 2, 9), [0..4, 4..6, 6..7]);
        assert_eq!(cut(&[0, 0, 1, 1, 2, 2], 2, 3), [0..3, 3..6]);
        assert_eq!(cut(&[3, 4, 5], 9, 9).first(), Some(&(0..3)));
    }
}
