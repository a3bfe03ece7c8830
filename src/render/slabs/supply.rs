//! Where the Gaussians of a slab come from: planes that hold the whole scene, or pages that are brought when they are
//! needed.

use std::ops::Range;
use std::sync::MutexGuard;

use anyhow::Result;

use super::cut::{Estimate, Place};
use super::listed::{Element, ListedPage};
use super::parts::Parts;
use super::pool::{PagesRead, Pool};
use super::visible::{Open, PlacedCamera, Sight, VisiblePage};
use crate::camera::Camera;
use crate::gpu::{Buffer, Commands, Device};
use crate::options::Options;
use crate::render::frame::DepthKeys;
use crate::render::gpu_scene::GpuScene;
use crate::render::shaders::slabs::{PAGE, VIEW_ELEMENTS};

/// What splats are listed in: bins, or tiles.
#[derive(Clone, Copy)]
pub struct Cells {
    /// Width and height, px.
    pub side_px: [u32; 2],
    /// Columns and rows.
    pub count: [u32; 2],
}

/// A buffer for the views and the pages that slabs list. A scene that is there as a whole is listed once.
pub fn listed_at_first(device: &Device, scene: &GpuScene) -> Result<Buffer<Element>> {
    let page = |slot: u32| {
        let (first, rest) = (slot * PAGE, scene.len() as u32 - slot * PAGE);
        ListedPage { slot, first, view: 0, filled: rest.min(PAGE), has_indices: false }.element()
    };
    let all = if scene.is_paged() { 0 } else { scene.len().div_ceil(PAGE as usize) as u32 };
    let pages: Vec<Element> = (0..all).map(page).collect();
    let room = scene.pool().map_or(pages.len(), |pool| pool.capacity());
    let listed = Buffer::new(device, "listed pages", VIEW_ELEMENTS as usize + room)?;
    let mut cmd = Commands::new(device)?;
    cmd.upload(&listed, VIEW_ELEMENTS as usize, pages.len(), |memory| memory.copy_from_slice(&pages))?;
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
}

/// An estimate is renewed when this part of its open bins is left.
const RENEWED: f64 = 0.9;

impl<'a> Supply<'a> {
    pub fn of(scene: &'a GpuScene, camera: &Camera, options: &Options, keys: DepthKeys, cells: Cells) -> Self {
        let Some(pool) = scene.pool() else { return Self::Whole(scene.len()) };
        let alpha_min = pool.pages().alpha_min();
        let sight = Sight { rules: &options.rules, alpha_min, keys, bin_px: cells.side_px, bins: cells.count };
        let placed = PlacedCamera { camera: camera.clone(), scale: 1.0 };
        let mut visible = sight.visible(pool.pages().pages(), 0, &placed);
        visible.sort_unstable_by_key(|page| (page.keys[0], page.page));
        let all = vec![u32::MAX; cells.count.iter().product::<u32>().div_ceil(32) as usize];
        Self::Paged(Box::new(Paged { pool, visible, open: Open::of(&all, cells.count), open_then: 0, bins: cells.count }))
    }

    /// Where the splats are expected that may still be seen; `end`: the place behind the last.
    pub fn estimate(&mut self, end: Place) -> Estimate {
        match self {
            Self::Whole(gaussians) => Estimate::uniform(end, *gaussians as f64),
            Self::Paged(paged) => {
                paged.open_then = paged.open.count();
                let seen = paged.visible.iter().filter(|page| paged.open.meets(page));
                Estimate::of(end, seen.map(|page| (page.keys, page.count)))
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
        Parts { pages_in_view: paged.visible.len() as u64, pages_read: pages, bytes_read: bytes, ..Parts::default() }
    }

    /// What was read since the frame began.
    pub fn since(&self, begin: Parts) -> Parts {
        let Self::Paged(paged) = self else { return begin };
        let PagesRead { pages, bytes } = paged.pool.read;
        Parts { pages_read: pages - begin.pages_read, bytes_read: bytes - begin.bytes_read, ..begin }
    }

    /// The indices of Gaussians, if pages have them.
    pub fn indices(&self) -> Option<Buffer<u32>> {
        match self {
            Self::Whole(_) => None,
            Self::Paged(paged) => Some(paged.pool.indices().clone()),
        }
    }

    /// Notes which bins are still open after a slab. True if nothing behind it can be seen any more.
    pub fn close(&mut self, open_bins: &[u32]) -> bool {
        match self {
            Self::Whole(_) => open_bins.iter().all(|word| *word == 0),
            Self::Paged(paged) => {
                paged.open = Open::of(open_bins, paged.bins);
                paged.open.count() == 0
            }
        }
    }

    /// Reads pages that a slab will probably need.
    pub fn read_ahead(&mut self, device: &Device, slab: &Range<Place>) -> Result<()> {
        let Self::Paged(paged) = self else { return Ok(()) };
        let wanted = paged.wanted(slab);
        let most = paged.pool.capacity() / 2;
        let numbers: Vec<u32> = wanted.iter().take(most).map(|page| page.page).collect();
        paged.pool.bring(device, &numbers).map(drop)
    }
}

impl Paged<'_> {
    /// The pages that may have splats in a slab which touch an open bin.
    pub fn wanted(&self, slab: &Range<Place>) -> Vec<VisiblePage> {
        self.visible.iter().filter(|page| page.is_in(slab) && self.open.meets(page)).copied().collect()
    }

    /// Brings pages to the device, at most as many as the pool holds, and lists them.
    pub fn bring(&mut self, device: &Device, batch: &[VisiblePage]) -> Result<Vec<Element>> {
        let numbers: Vec<u32> = batch.iter().map(|page| page.page).collect();
        let slots = self.pool.bring(device, &numbers)?;
        let listed = |(page, slot): (&VisiblePage, &u32)| {
            ListedPage { slot: *slot, first: 0, view: page.view, filled: page.count, has_indices: true }.element()
        };
        Ok(batch.iter().zip(&slots).map(listed).collect())
    }
}
