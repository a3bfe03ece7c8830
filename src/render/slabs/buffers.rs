//! The buffers and sizes that drawing in slabs keeps from one frame to the next, the same on both paths.

use anyhow::Result;

use crate::gpu::{Buffer, Commands, Device};
use crate::render::pages::{Element, PageDraw, first_page, max_pages, number_of_pages};
use crate::render::scene::GpuScene;
use crate::render::shaders::pages::PAGE;

/// The list of pages that a slab draws, and the sizes that the last frame found.
pub struct SlabBuffers {
    /// The views, then the number of pages, then the pages.
    pub listed: Buffer<Element>,
    /// Bound in place of the indices of Gaussians and of their levels where the scene lacks them.
    pub no_words: Buffer<u32>,
    /// The number of splats that the first slab of the next frame should have.
    pub target: f64,
    /// The number of cells that the workspace was sized for.
    pub cells: u32,
}

/// The most splats of a slab: more would take memory and save no time.
pub const MOST_SPLATS: u64 = 4 << 20;
/// The fraction of the free memory that the buffers of slabs may take.
pub const MEMORY_FRACTION: f64 = 0.5;

impl SlabBuffers {
    /// A scene that is on the device as a whole is listed once, here.
    ///
    /// # Errors
    /// If memory runs out.
    pub fn new(device: &Device, scene: &GpuScene) -> Result<Self> {
        let page = |slot: u32| {
            let rest = scene.len() as u32 - slot * PAGE;
            PageDraw { slot, error_limits: 0, view: 0, count: rest.min(PAGE), has_indices: false }.element()
        };
        let all = if scene.is_paged() { 0 } else { scene.len().div_ceil(PAGE as usize) as u32 };
        let pages: Vec<Element> = (0..all).map(page).collect();
        let first = first_page(scene) as usize;
        let listed = Buffer::new(device, "listed pages", first + max_pages(scene))?;
        let mut cmd = Commands::new(device)?;
        cmd.upload(&listed, first - 1, 1 + pages.len(), |memory| {
            memory[0] = number_of_pages(pages.len());
            memory[1..].copy_from_slice(&pages);
        })?;
        cmd.submit()?.wait()?;
        Ok(Self { listed, no_words: Buffer::new(device, "no indices", 1)?, target: f64::INFINITY, cells: 0 })
    }

    /// The number of pages that fit into the list.
    pub fn page_capacity(&self, scene: &GpuScene) -> usize {
        self.listed.len() - first_page(scene) as usize
    }

    /// The fraction of a capacity that a slab demanded, the largest of these pairs of demand and capacity. Above 1, the
    /// slab was not blended.
    pub fn filled<const N: usize>(pairs: [(u64, u64); N]) -> f64 {
        pairs.map(|(demand, capacity)| demand as f64 / capacity.max(1) as f64).into_iter().fold(0.0, f64::max)
    }
}
